"""How well the scans of a run fit the map.

On the map of another building a filter always finds some pose, and its estimate changes from one to the next. What
distinguishes it is that the beams of many scans end where the map has nothing, or pass through the map's walls.
"""

from __future__ import annotations

from dataclasses import dataclass

from wherry.localization.agreement import ScanAgreement
from wherry.localization.lost import EvidenceModel

# `wherry reproduce maps` measures: on a map of its own a log's fit is 0.8 to 0.98 where the filter finds the pose, on
# another building's mostly below 0.6, but up to 0.84 over a few metres of corridor. `drive_fit` judges whole drives.
MIN_FIT = 0.7  # fit below which a few scans contradict the map
MIN_COVERAGE = 0.5  # fraction of the beams that end where the map is known, below which it lacks most of the place


@dataclass(frozen=True, slots=True)
class MapFit:
    """Fractions of a run's beams by how they agree with the map at the estimated poses.

    Attributes:
        inliers: Sum over the scans of the fraction of beams that end on the map's obstacles.
        blocked: Sum of the fractions of beams that end in the map's free space.
        passed: Sum of the fractions of beams that went through the map's obstacles.
        scans: Number of scans with readings, or the sum of their weights.
    """

    inliers: float = 0.0
    blocked: float = 0.0
    passed: float = 0.0
    scans: float = 0.0

    def with_scan(self, agreement: ScanAgreement, *, decay: float = 1.0) -> MapFit:
        """The fit after one more scan; a scan without readings says nothing.

        Args:
            agreement: Agreement of the scan with the map.
            decay: Factor of the earlier scans' weights, 0 to 1; below 1 for a moving average.
        """
        if not agreement.beam_count:
            return self
        return MapFit(
            decay * self.inliers + agreement.inlier_fraction,
            decay * self.blocked + agreement.blocked_fraction,
            decay * self.passed + agreement.passed_fraction,
            decay * self.scans + 1.0,
        )

    @property
    def value(self) -> float:
        """Inliers ÷ (inliers + passed + w · blocked), 0 to 1; 0 without any.

        A beam that is blocked is weaker evidence than one that passed through a wall, since things are put into
        buildings more often than walls are removed; w is the ratio of their weights in the evidence of being lost.
        Beams that end in unknown space say nothing.
        """
        model = EvidenceModel()
        outliers = self.passed + model.blocked_weight / model.passed_weight * self.blocked
        return self.inliers / (self.inliers + outliers) if self.inliers > 0.0 else 0.0

    @property
    def coverage(self) -> float:
        """Fraction of the beams that end where the map is known, 0 to 1."""
        return (self.inliers + self.blocked + self.passed) / self.scans if self.scans else 0.0

    @property
    def is_fitting(self) -> bool:
        """Whether the scans fit the map."""
        return self.coverage >= MIN_COVERAGE and self.value >= MIN_FIT

    @property
    def mismatch(self) -> str:
        """Why the scans do not fit the map, as a clause; empty if they do."""
        if self.coverage < MIN_COVERAGE:
            return f"it covers only {self.coverage:.0%} of what the lidar sees"
        if self.value < MIN_FIT:
            shown = min(self.value, MIN_FIT - 0.01)  # otherwise 0.699 is printed as 0.70
            return f"fit {shown:.2f}, at least {MIN_FIT:g} on the right map"
        return ""
