"""Placement of a scan on a grid: predicted motions are tried until one is consistent with what was seen before.

The first prediction is only given up if the scan that it leads to shows points in free space, or does not match, and
another prediction leads to a clearly better placement. Where scans show no difference, as in a bare corridor, the first
prediction stays.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from wherry.mapping.correlative import score_at
from wherry.mapping.matching_grid import MatchingGrid
from wherry.mapping.motion_noise import ODOMETRY_NOISE, MotionNoise
from wherry.mapping.point_cloud import PointCloud
from wherry.mapping.refinement import SURFACE_RADIUS, Refinement
from wherry.mapping.scan_matching import MIN_POINTS, SEARCH_POINTS, find_scan, track_scan
from wherry.mapping.visibility import Consistency, ScanView
from wherry.space.pose import IDENTITY, Pose

MIN_CONSISTENCY = 0.9  # share of agreeing points below which a placement is doubted
MIN_PLAUSIBLE_CONSISTENCY = 0.75  # share below which the robot may have moved in any way
MIN_GAIN = 0.1  # gain in consistency or score by which another placement is clearly better
MIN_COMPARED = 40  # points that must be compared to contradict a prediction

# Motion in any direction since the last scan, for the search that is tried last.
UNKNOWN_MOTION_NOISE = MotionNoise(0.4, 0.0, 0.0, math.radians(25.0), 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Prediction:
    """A predicted motion since the last scan.

    Attributes:
        motion: Motion of base_link.
        noise: Noise of the motion.
        is_plausible: Whether a robot can move like this in the time between the scans.
    """

    motion: Pose
    noise: MotionNoise
    is_plausible: bool = True

    @property
    def is_by_odometry(self) -> bool:
        """Whether odometry measured the motion."""
        return self.noise is ODOMETRY_NOISE

    @property
    def is_precise(self) -> bool:
        """Whether the motion is known well enough to refine the predicted pose without a search."""
        return self.noise.distance <= SURFACE_RADIUS


@dataclass(frozen=True, slots=True)
class Placement:
    """A scan at a pose.

    Attributes:
        prediction: The prediction that led to it.
        pose: Pose of base_link in the grid's frame: that of the match, or the predicted one without a match.
        match: The match; None if the scan does not match near the predicted pose.
        consistency: Agreement with the scan that was placed before.
    """

    prediction: Prediction
    pose: Pose
    match: Refinement | None
    consistency: Consistency

    @property
    def is_consistent(self) -> bool:
        """Whether nothing speaks against the placement."""
        return self.match is not None and self.share >= MIN_CONSISTENCY

    @property
    def is_verified(self) -> bool:
        """Whether enough points were compared to contradict odometry by the placement."""
        return self.is_consistent and self.consistency.compared >= MIN_COMPARED

    @property
    def share(self) -> float:
        """Share of the compared points that agree; what cannot be compared is in favour of a plausible motion."""
        if self.consistency.compared < MIN_COMPARED:
            return 1.0 if self.prediction.is_plausible else 0.0
        return self.consistency.share


@dataclass(frozen=True)
class PlacedScan:
    """A scan that was placed before, to compare with.

    Attributes:
        view: The scan's view.
        pose: Pose of base_link in the grid's frame.
    """

    view: ScanView
    pose: Pose

    @property
    def has_points(self) -> bool:
        """Whether the scan has points enough to compare with."""
        return len(self.view.points) >= MIN_POINTS


@dataclass(frozen=True)
class ScanPlacer:
    """Places a scan on a grid.

    Attributes:
        grid: The grid to match to.
        cloud: Points of the scan in the base_link frame.
        view: The scan's view.
        reference: A scan that was placed before.
        last: base_link at the last scan in the grid's frame.
    """

    grid: MatchingGrid
    cloud: PointCloud
    view: ScanView
    reference: PlacedScan
    last: Pose

    def place(self, predictions: Sequence[Prediction], *, is_tracked: bool) -> Placement:
        """Place the scan where the first prediction leads, unless another one is clearly better.

        Args:
            predictions: Predicted motions, the most trusted first.
            is_tracked: Whether the first predicted pose is only refined, without a search.
        """
        first = self._placement(predictions[0], is_tracked=is_tracked)
        if first.is_consistent or len(self.cloud.points) < MIN_POINTS or self.grid.is_empty:
            return first
        others = self._alternatives(predictions, first)
        return next((other for other in others if self._is_clearly_better(other, first)), first)

    def _alternatives(self, predictions: Sequence[Prediction], first: Placement) -> Iterable[Placement]:
        """Where other motions lead; a search is slow, so that a slight doubt only tries the other predictions."""
        if first.match is not None and first.share >= MIN_PLAUSIBLE_CONSISTENCY:
            yield from (self._placement(prediction, is_tracked=False) for prediction in predictions[1:])
            return
        standing = Prediction(IDENTITY, predictions[-1].noise)
        moved_in_any_way = Prediction(IDENTITY, UNKNOWN_MOTION_NOISE)
        for prediction in (*predictions[1:], standing, moved_in_any_way):
            yield self._placement(prediction, is_tracked=False)

    def _placement(self, prediction: Prediction, *, is_tracked: bool) -> Placement:
        """Where a prediction leads."""
        match_scan = track_scan if is_tracked else find_scan
        expected = self.last @ prediction.motion
        match = match_scan(self.grid, self.cloud, expected, prediction.motion, prediction.noise)
        pose = expected if match is None else match.pose
        consistency = self.reference.view.consistency(self.view, pose.relative_to(self.reference.pose))
        return Placement(prediction, pose, match, consistency)

    def _is_clearly_better(self, alternative: Placement, first: Placement) -> bool:
        """Whether a placement agrees better with the scan before, or scores better and agrees as well."""
        if not alternative.is_verified:
            return False
        gain = alternative.share - first.share
        return gain >= MIN_GAIN or (gain >= 0.0 and self._score(alternative) - self._score(first) >= MIN_GAIN)

    def _score(self, placement: Placement) -> float:
        """Mean likelihood of the points, 0 to 1."""
        return score_at(self.grid, self.cloud.subsampled(SEARCH_POINTS).points, placement.pose)
