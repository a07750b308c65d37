"""Localization that knows when it is lost: a particle filter, watched, and started anew from one scan when it fails."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wherry.localization.agreement import Agreement, compare, mean_agreement
from wherry.localization.amcl import Amcl, Estimate
from wherry.localization.lost import LostDetector
from wherry.localization.parameters import AmclParameters
from wherry.localization.refinement import match_scan
from wherry.localization.relocalization import Hypothesis, Relocalizer
from wherry.localization.sensor import choose_beams
from wherry.robot import Odometry, Scan
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose

Floats = NDArray[np.float64]

DOUBTFUL = 0.1  # doubt at which a place is believed in that explains nearly everything, that is
PERFECT = 0.95  # share of the beams
ALARM = 0.9  # suspicion at which any place will do that explains more, though after more scans
LIKELY = 0.5  # probability, as above, of being lost, if every one of the kept scans gave it
SUSPICION = 0.02  # doubt from which on scans are kept, to judge places with
SPACING = 0.5  # s from one kept scan to the next
FEWEST_SCANS = 3  # that must agree on a new place
MOST_SCANS = 6  # that are kept, and must agree on a place that explains no more than most
WIDE_MARGIN = 0.8  # of mean log likelihood, by which such a place must explain them better
MARGIN = 0.2  # likewise, where the robot is certainly lost
BELIEVABLE = -0.5  # evidence of being lost that a new place may leave: one that fits badly, too, is no better
COMPARED_BEAMS = 180
DOUBT = 0.5  # share of the new belief that is spread over all hypotheses alike, in case the scan misleads
UNSEEN = 0.5  # share of the first belief that is spread over the whole map, if the scan is ambiguous
KEPT = 0.5  # share of the belief that a new start leaves as it was: the next scans decide
FLOOR = np.diag([0.05**2, 0.05**2, 0.02**2])  # m, m, rad, of particles around a hypothesis, at least
SLIP_COVARIANCE = np.diag([0.2**2, 0.2**2, 0.15**2])  # m, m, rad, of what wheels may have slipped since the last scan
SLIPS = tuple(  # where searches for a place beside begin, as seen from the estimate
    Pose(*offset)
    for offset in ((0.0, 0.0), (0.3, 0.0), (-0.3, 0.0), (0.0, 0.3), (0.0, -0.3), (0.0, 0.0, 0.2), (0.0, 0.0, -0.2))
)
ODD = 3.0  # standard deviations by which a scan must fit worse than usual to be an odd one
SLIP_MARGIN = 0.5  # of mean log likelihood, by which a place beside must explain a scan better


@dataclass(frozen=True, slots=True)
class Localization:
    """An estimate, and how far to trust it.

    Attributes:
        estimate: The particle filter's.
        lost_probability: That the robot is not where the estimate says, 0 to 1.
        agreement: How the scan agrees with the map there.
        hypotheses: Where else the robot may be, if the scan has just been used for a new start; otherwise empty.
    """

    estimate: Estimate
    lost_probability: float
    agreement: Agreement
    hypotheses: tuple[Hypothesis, ...] = ()

    @property
    def pose(self) -> Pose:
        """base_link in the map frame."""
        return self.estimate.pose


@dataclass(frozen=True, slots=True)
class SuspiciousScan:
    """A scan that did not agree with the map.

    Attributes:
        time: s.
        odometry: base_link in the odom frame.
        ends: [B, 2] m, where the beams ended, base_link frame.
        agreement: With the map, at the estimate.
        lost_probability: That the robot was lost, 0 to 1.
    """

    time: float
    odometry: Pose
    ends: Floats
    agreement: Agreement
    lost_probability: float


class Localizer:
    """`Amcl` with a watch: it says when it is lost, and then starts anew from all the places that explain the scan.

    Args:
        grid: The map.
        lidar: The lidar's pose, base_link frame.
        parameters: The particle filter's.
        rng: Where all randomness comes from.
    """

    def __init__(self, grid: OccupancyGrid, lidar: Pose, parameters: AmclParameters, rng: np.random.Generator) -> None:
        self.amcl = Amcl(grid, lidar, parameters, rng)
        self._lidar = lidar
        self._charted = ~grid.unknown
        self._relocalizer = Relocalizer(grid, lidar, parameters)
        self._detector = LostDetector()
        self._started = True
        self._suspicious: list[SuspiciousScan] = []

    def initialize(self, pose: Pose, covariance: Floats) -> None:
        """See `Amcl.initialize`."""
        self.amcl.initialize(pose, covariance)
        self._detector.reset()
        self._started = True

    def initialize_globally(self) -> None:
        """Start anywhere on the map: the next scan says where that may be.

        Raises:
            InputError: The map has no free space.
        """
        self.amcl.initialize_globally()
        self._detector.reset()
        self._started = False

    def update(self, odometry: Odometry, scan: Scan) -> Localization:
        """Take in one scan, and the odometry of the same instant; see `Amcl.update`."""
        hypotheses: tuple[Hypothesis, ...] = ()
        if not self._started:
            hypotheses = self._start(scan)
        estimate = self.amcl.update(odometry, scan)
        ends = choose_beams(scan, self._lidar, self.amcl.parameters, COMPARED_BEAMS).ends
        agreement = self._compare(ends, estimate.pose)
        lost = self._detector.probability
        if not estimate.problem:
            estimate, agreement = self._put_right(estimate, agreement, ends)
            lost = self._detector.observe(scan.time, agreement)
            kept = self._watch(scan.time, odometry.pose, ends, agreement, converged=estimate.is_at_one_place)
            if kept and self._doubt > DOUBTFUL and len(self._suspicious) >= FEWEST_SCANS:
                hypotheses = self._start_anew(scan, odometry.pose)
        wrong = 1.0 - estimate.weight * (1.0 - lost)
        return Localization(estimate, min(max(wrong, 0.0), 1.0), agreement, hypotheses)

    @property
    def _doubt(self) -> float:
        """The worse of suspicion and probability: to look at other places, either will do."""
        return max(self._detector.suspicion, self._detector.probability)

    def _compare(self, ends: Floats, pose: Pose) -> Agreement:
        return compare(self.amcl.field, self._charted, ends, self._lidar, pose)

    def _put_right(self, estimate: Estimate, agreement: Agreement, ends: Floats) -> tuple[Estimate, Agreement]:
        """Where a scan fits badly and beside it well, the wheels have slipped: believe half in the place beside."""
        if not estimate.is_at_one_place or self._detector.contradiction(agreement) < ODD:
            return estimate, agreement
        sigma = self.amcl.parameters.refine_sigma
        around = [estimate.pose @ slip for slip in SLIPS]
        covariance = estimate.covariance + SLIP_COVARIANCE
        matches = [match_scan(self.amcl.field, ends, estimate.pose, covariance, sigma, start=at) for at in around]
        agreements = [self._compare(ends, match.pose) for match in matches]
        best = max(range(len(matches)), key=lambda index: agreements[index].log_likelihood)
        usual = self._detector.contradiction(agreements[best]) < ODD
        if not usual or agreements[best].log_likelihood < agreement.log_likelihood + SLIP_MARGIN:
            return estimate, agreement
        found = matches[best]
        self.amcl.initialize_at([(found.pose, found.covariance + FLOOR, 1.0)], kept=KEPT)
        return replace(estimate, pose=found.pose), agreements[best]

    def _start(self, scan: Scan) -> tuple[Hypothesis, ...]:
        """Believe in the places that explain the first scan; if there are too many to list them, in all places."""
        found = self._relocalizer.search(scan)
        if found.hypotheses:
            if found.complete:
                self.amcl.initialize_at(_spread(found.hypotheses), elsewhere=UNSEEN if found.ambiguous else 0.0)
            self._started = True
        return found.hypotheses

    def _watch(self, time: float, odometry: Pose, ends: Floats, agreement: Agreement, *, converged: bool) -> bool:
        """Remember the scans since the robot has seemed to be lost; what was seen before may be of another place.

        A belief in several places at once is not lost but still searching, and best left to the filter. Returns whether
        this scan was kept.
        """
        if self._doubt < SUSPICION or not converged:
            self._suspicious.clear()
            return False
        if self._suspicious and time - self._suspicious[-1].time < SPACING:
            return False
        self._suspicious.append(SuspiciousScan(time, odometry, ends, agreement, self._detector.probability))
        del self._suspicious[:-MOST_SCANS]
        return True

    def _start_anew(self, scan: Scan, odometry: Pose) -> tuple[Hypothesis, ...]:
        """Believe in the places that explain the last scans better than where we seem to be, if there are any."""
        here = mean_agreement([seen.agreement for seen in self._suspicious])
        earlier = [(seen.odometry.relative_to(odometry), seen.ends) for seen in self._suspicious]
        surely = self._detector.suspicion > ALARM or all(seen.lost_probability > LIKELY for seen in self._suspicious)
        lost = surely and len(self._suspicious) == MOST_SCANS
        found = self._relocalizer.confirm(self._relocalizer.search(scan).hypotheses, earlier)
        margin, least = (MARGIN, 0.0) if lost else (WIDE_MARGIN, PERFECT)
        better = tuple(
            h
            for h in found
            if h.agreement.log_likelihood > here.log_likelihood + margin
            and h.agreement.explained > least
            and self._detector.model.evidence(h.agreement) < BELIEVABLE
        )
        if better:
            self.amcl.initialize_at(_spread(better), kept=KEPT)
            self._detector.reset()
            self._suspicious.clear()
        return better


def _spread(hypotheses: tuple[Hypothesis, ...]) -> list[tuple[Pose, Floats, float]]:
    """Pose, covariance and share of the belief for every hypothesis."""
    even = DOUBT / len(hypotheses)
    return [(h.pose, h.covariance + FLOOR, (1.0 - DOUBT) * h.probability + even) for h in hypotheses]
