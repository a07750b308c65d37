"""Global relocalization: all poses on a map that are consistent with a single scan.

The search is exhaustive (`wherry.localization.branch_and_bound`), and every pose that it finds is refined by scan
matching. In a building with two identical rooms there are two hypotheses, and the result is ambiguous.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wherry.localization.agreement import ScanAgreement, mean_agreement, scan_agreement
from wherry.localization.branch_and_bound import MAX_LIKELIHOOD, branch_and_bound, window_maxima, with_border
from wherry.localization.parameters import AmclParameters
from wherry.localization.refinement import MAX_MATCHED_BEAMS, match_scan
from wherry.localization.sensor import Beams, valid_beams
from wherry.robot import Scan
from wherry.space.distance_field import DistanceField
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose

# Search
SEARCH_CELL_SIZE = 0.1  # m, side of the cells of the search grid
SEARCH_SIGMA = 0.15  # m, standard deviation of the beam ends around the obstacles
LEVELS = 5  # levels of windows: 1, 2, 4, 8 and 16 cells wide
MIN_HEADINGS, MAX_HEADINGS = 120, 480  # headings of the search grid
MAX_SEARCH_BEAMS = 100  # beams of a scan in the search
MIN_SCORE_FRACTION = 0.8  # fraction of the best score that a hypothesis must reach
MODE_DISTANCE, MODE_ANGLE = 0.5, math.radians(20.0)  # m, rad, differences below which poses are of one mode

# Refinement
MAX_FIELD_DISTANCE = 1.0  # m, distance at which the distance field is truncated
SEARCH_COVARIANCE = np.diag([0.15**2, 0.15**2, math.radians(3.0) ** 2])  # m², m², rad², of a pose from the search
MATCH_SIGMA = 0.05  # m, standard deviation of the beam ends around the obstacles

# Earlier scans
DRIFT_COVARIANCE = np.diag([0.05**2, 0.05**2, math.radians(2.0) ** 2])  # m², m², rad², of odometry without any motion
DRIFT_PER_MOTION = 0.1  # m/m, rad/m and rad/rad, standard deviation of odometry per motion

# Probabilities
INDEPENDENT_BEAMS = 25.0  # independent readings that a scan is worth, a compromise between two buildings
MIN_UNAMBIGUOUS_PROBABILITY = 0.9  # probability that the best hypothesis must reach to be unambiguous
POOR_LOG_LIKELIHOOD = -1.0  # mean log likelihood per beam below which an incomplete search may have missed the pose


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """A pose that is consistent with a scan.

    Attributes:
        pose: Pose of base_link, map frame.
        covariance: [3, 3] m, m, rad, covariance of the pose.
        probability: Probability of this hypothesis among all of the same scan, 0 to 1.
        agreement: Agreement of the scan with the map at the pose.
    """

    pose: Pose
    covariance: Floats
    probability: float
    agreement: ScanAgreement


@dataclass(frozen=True, slots=True)
class Relocalization:
    """Result of a relocalization.

    Attributes:
        hypotheses: All hypotheses, the most probable first; empty if no pose is consistent with the scan.
        is_complete: Whether the search was exhaustive; otherwise it ended at a limit of its effort.
    """

    hypotheses: tuple[Hypothesis, ...]
    is_complete: bool

    @property
    def ambiguity(self) -> float:
        """Probability that the best hypothesis is not the true one, 0 to 1."""
        return 1.0 - self.hypotheses[0].probability if self.hypotheses else 1.0

    @property
    def is_ambiguous(self) -> bool:
        """Whether the best hypothesis is too uncertain to be used alone.

        An incomplete search has still found the poses with the highest scores; it matters only if these agree poorly.
        """
        if not self.hypotheses or self.ambiguity > 1.0 - MIN_UNAMBIGUOUS_PROBABILITY:
            return True
        return not self.is_complete and self.hypotheses[0].agreement.log_likelihood < POOR_LOG_LIKELIHOOD


class Relocalizer:
    """Relocalizes a robot on a map with one scan.

    Args:
        grid: The map.
        lidar: Pose of the lidar, base_link frame.
        parameters: The filter's parameters, of which the range limits and the robot's radius are used.
    """

    def __init__(self, grid: OccupancyGrid, lidar: Pose, parameters: AmclParameters | None = None) -> None:
        self._lidar = lidar
        self._parameters = parameters or AmclParameters()
        self._field = DistanceField.of(grid, MAX_FIELD_DISTANCE)
        self._known = ~grid.unknown
        factor = max(1, round(SEARCH_CELL_SIZE / grid.resolution))
        self._cell_size = grid.resolution * factor
        likelihood = np.exp(-0.5 * np.square(_pool(self._field.distance, factor, np.min) / SEARCH_SIGMA))
        self._levels = window_maxima(np.rint(likelihood * MAX_LIKELIHOOD).astype(np.uint8), LEVELS)
        pad = 1 << (LEVELS - 1)
        free = window_maxima(_pool(grid.free, factor, np.max).astype(np.uint8), LEVELS)
        self._free = np.ascontiguousarray(free[:, pad:, pad:])

    def search(self, scan: Scan) -> Relocalization:
        """Find all poses on the map that are consistent with a scan."""
        return self.search_beams(valid_beams(scan, self._lidar, self._parameters))

    def search_beams(self, beams: Beams) -> Relocalization:
        """Find all poses on the map that are consistent with the valid beams of a scan."""
        ends = beams.evenly_spaced(MAX_MATCHED_BEAMS).ends
        if not len(ends):
            return Relocalization((), is_complete=True)
        poses, is_complete = self._candidates(_subsampled(ends, self._cell_size))
        hypotheses = [self._hypothesis(pose, ends) for pose in poses]
        return Relocalization(_distinct(hypotheses), is_complete)

    def confirm(
        self, hypotheses: Sequence[Hypothesis], earlier: Sequence[tuple[Pose, Floats]]
    ) -> tuple[Hypothesis, ...]:
        """Compare earlier scans with the map at the poses that odometry predicts from each hypothesis.

        Args:
            hypotheses: Hypotheses from `search`.
            earlier: For each earlier scan the pose of base_link relative to its present one, by odometry, and the ends
                of the beams [B, 2] m, base_link frame.

        Returns:
            The hypotheses with the agreement averaged over all scans, the most probable first.
        """
        return _distinct([self._confirmed(hypothesis, earlier) for hypothesis in hypotheses])

    def _confirmed(self, hypothesis: Hypothesis, earlier: Sequence[tuple[Pose, Floats]]) -> Hypothesis:
        """The hypothesis with the agreement averaged over all scans; see `confirm`."""
        agreements = [hypothesis.agreement]
        for offset, ends in earlier:
            covariance = hypothesis.covariance + drift_covariance(offset)
            match = match_scan(self._field, ends, hypothesis.pose @ offset, covariance, MATCH_SIGMA)
            agreements.append(scan_agreement(self._field, self._known, ends, self._lidar, match.pose))
        return replace(hypothesis, agreement=mean_agreement(agreements))

    def _candidates(self, ends: Floats) -> tuple[list[Pose], bool]:
        """Poses on the search grid, one per mode, and whether the search was exhaustive."""
        headings = _headings(ends, self._cell_size)
        cos, sin = np.cos(headings)[:, None], np.sin(headings)[:, None]
        offsets = np.stack([sin * ends[:, 0] + cos * ends[:, 1], cos * ends[:, 0] - sin * ends[:, 1]], axis=2)
        offset_cells = np.floor(offsets / self._cell_size + 0.5).astype(np.int32)
        levels, flat_offsets = with_border(self._levels, offset_cells)
        mode_radius, mode_turn = MODE_DISTANCE / self._cell_size, MODE_ANGLE / math.tau * len(headings)
        found, is_complete = branch_and_bound(
            levels, self._free, flat_offsets, MIN_SCORE_FRACTION, mode_radius, mode_turn
        )
        poses = [
            self._field.origin
            @ Pose((column + 0.5) * self._cell_size, (row + 0.5) * self._cell_size, headings[heading])
            for heading, row, column in found
        ]
        return poses, is_complete

    def _hypothesis(self, pose: Pose, ends: Floats) -> Hypothesis:
        """A pose of the search, refined and compared with the map; its probability is set by `_distinct`."""
        coarse = match_scan(self._field, ends, pose, SEARCH_COVARIANCE, SEARCH_SIGMA)
        fine = match_scan(self._field, ends, coarse.pose, SEARCH_COVARIANCE, MATCH_SIGMA)
        agreement = scan_agreement(self._field, self._known, ends, self._lidar, fine.pose)
        return Hypothesis(fine.pose, fine.covariance, 0.0, agreement)


def drift_covariance(motion: Pose) -> Floats:
    """[3, 3] m, m, rad, covariance of odometry over a motion."""
    distance, turn = math.hypot(motion.x, motion.y), abs(motion.theta)
    sigma, angle_sigma = DRIFT_PER_MOTION * distance, DRIFT_PER_MOTION * (distance + turn)
    covariance: Floats = DRIFT_COVARIANCE + np.diag([sigma**2, sigma**2, angle_sigma**2])
    return covariance


def _distinct(hypotheses: list[Hypothesis]) -> tuple[Hypothesis, ...]:
    """The hypothesis of each mode that agrees best, with its probability, the most probable first."""
    hypotheses = sorted(hypotheses, key=lambda hypothesis: -hypothesis.agreement.log_likelihood)
    kept: list[Hypothesis] = []
    for hypothesis in hypotheses:
        if not any(hypothesis.pose.is_near(better.pose, MODE_DISTANCE, MODE_ANGLE) for better in kept):
            kept.append(hypothesis)
    logits = np.array([INDEPENDENT_BEAMS * hypothesis.agreement.log_likelihood for hypothesis in kept])
    odds = np.exp(logits - logits.max()) if kept else logits
    return tuple(replace(h, probability=float(p)) for h, p in zip(kept, odds / odds.sum(), strict=True))


def _headings(ends: Floats, cell_size: float) -> Floats:
    """[A] rad, headings to search, so close that most beam ends move by less than two cells from one to the next."""
    radius = float(np.quantile(np.hypot(ends[:, 0], ends[:, 1]), 0.8))
    count = int(np.clip(math.tau * radius / (2.0 * cell_size), MIN_HEADINGS, MAX_HEADINGS))
    headings: Floats = np.linspace(-math.pi, math.pi, count, endpoint=False)
    return headings


def _subsampled(ends: Floats, cell_size: float) -> Floats:
    """At most `MAX_SEARCH_BEAMS` beam ends [N, 2] m, one per cell, so that a close wall does not outweigh the rest."""
    _, first = np.unique(np.floor(ends / cell_size).astype(np.int64), axis=0, return_index=True)
    first.sort()
    chosen = first[np.linspace(0, len(first) - 1, min(len(first), MAX_SEARCH_BEAMS)).astype(np.int64)]
    subsampled: Floats = ends[chosen]
    return subsampled


def _pool(values: NDArray[Any], factor: int, reduce: Callable[..., NDArray[Any]]) -> NDArray[Any]:
    """Minima or maxima over blocks of factor × factor values, [⌈H / factor⌉, ⌈W / factor⌉]."""
    height, width = values.shape
    padded = np.pad(values, ((0, -height % factor), (0, -width % factor)), mode="edge")
    return reduce(padded.reshape(padded.shape[0] // factor, factor, -1, factor), axis=(1, 3))
