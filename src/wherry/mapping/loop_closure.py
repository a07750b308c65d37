"""Loop closures: candidate matches of recent scans to old submaps, and the gates that reject false ones.

A match is accepted if its score is high (score gate), no other pose in the search window scores nearly as well
(ambiguity gate), and enough points are inliers of the submap's surfaces (overlap gate). Rejected matches are kept with
the reason.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from wherry.mapping.correlative import WINDOW_SIGMAS, Correlation, SearchWindow, correlate
from wherry.mapping.matching_grid import MatchingGrid
from wherry.mapping.point_cloud import PointCloud
from wherry.mapping.refinement import Refinement, refine
from wherry.mapping.rejections import EXPLANATIONS, Rejection
from wherry.space.pose import Floats, Pose

LOOP_CLOSURE_MIN_SCORE = 0.45  # mean likelihood of the points
LOOP_CLOSURE_MAX_SECOND_BEST = 0.90  # share of the best score that another peak may reach
LOOP_CLOSURE_MIN_OVERLAP = 0.6  # share of the points that must be inliers
MAX_REFINEMENT_DISTANCE = 0.3  # m between the pose that the search found and the refined one
MIN_WINDOW, MAX_WINDOW = 0.5, 8.0  # m to either side
MIN_WINDOW_ANGLE, MAX_WINDOW_ANGLE = math.radians(4.0), math.radians(40.0)  # rad to either side
SEARCH_POINTS = 300  # points of a cloud that are matched in windows up to `FULL_POINTS_WINDOW`
FULL_POINTS_WINDOW = 2.0  # m to either side; wider windows use fewer points, so that time grows linearly with the width


@dataclass(frozen=True)
class LoopClosure:
    """A loop closure that was attempted.

    Attributes:
        time: Time of the keyframe's scan, s.
        keyframe: Index of the keyframe whose surroundings were matched.
        target: Index of the keyframe at the origin of the submap that was matched to.
        measured: Pose of ``keyframe`` in the frame of ``target``.
        information: Information of ``measured`` in the frame of ``target``, [3, 3] m, m, rad.
        score: Mean likelihood of the points, 0 to 1.
        second_best_score: Score of the best other peak, 0 to 1; a lower bound where it passes the ambiguity gate.
        window: Extent of the search window to either side, m.
        rejection: Reason for the rejection; None if the closure was accepted.
        explanation: The reason with the measured values; empty if the closure was accepted.
    """

    time: float
    keyframe: int
    target: int
    measured: Pose
    information: Floats
    score: float
    second_best_score: float
    window: float
    rejection: Rejection | None = None
    explanation: str = ""

    @property
    def is_accepted(self) -> bool:
        """Whether the closure became a constraint of the pose graph."""
        return self.rejection is None


def search_window(expected: Pose, covariance: Floats) -> SearchWindow:
    """The window of `WINDOW_SIGMAS` standard deviations, within limits, around a pose with covariance [3, 3]."""
    distance = WINDOW_SIGMAS * math.sqrt(max(covariance[0, 0], covariance[1, 1]))
    angle = WINDOW_SIGMAS * math.sqrt(covariance[2, 2])
    return SearchWindow(
        expected,
        float(np.clip(distance, MIN_WINDOW, MAX_WINDOW)),
        float(np.clip(angle, MIN_WINDOW_ANGLE, MAX_WINDOW_ANGLE)),
    )


def attempt_loop_closure(
    time: float, keyframe: int, target: int, grid: MatchingGrid, cloud: PointCloud, window: SearchWindow
) -> LoopClosure:
    """Match the surroundings of a keyframe to an old submap, and decide whether the match is accepted.

    Args:
        time: Time of the keyframe's scan, s.
        keyframe: Index of the keyframe.
        target: Index of the keyframe at the submap's origin.
        grid: The submap's matching grid.
        cloud: Surroundings of the keyframe in its base_link frame.
        window: Poses to search; while the best one is on the edge, the window is doubled up to the limits.
    """
    found = _best_pose(grid, cloud, window)
    while found.score >= LOOP_CLOSURE_MIN_SCORE and window.is_on_edge(found.pose) and _doubled(window) != window:
        window = _doubled(window)  # the covariance that the window is derived from may be too small
        found = _best_pose(grid, cloud, window)
    refined = refine(grid, cloud, found.pose)
    rejection = _failed_gate(found, refined, window)
    return LoopClosure(
        time,
        keyframe,
        target,
        refined.pose,
        refined.information,
        found.score,
        found.second_best_score,
        window.distance,
        rejection,
        _explanation(rejection, found, refined),
    )


def count_rejections(closures: Iterable[LoopClosure]) -> Mapping[Rejection, int]:
    """How many closures were rejected for each reason, the most frequent first."""
    return dict(Counter(closure.rejection for closure in closures if closure.rejection).most_common())


def _failed_gate(found: Correlation, refined: Refinement, window: SearchWindow) -> Rejection | None:
    """The first gate that a match fails; None if it passes all of them."""
    if found.score < LOOP_CLOSURE_MIN_SCORE:
        return Rejection.LOW_SCORE
    if found.second_best_score > LOOP_CLOSURE_MAX_SECOND_BEST * found.score:
        return Rejection.AMBIGUOUS
    if window.is_on_edge(found.pose):
        return Rejection.ON_WINDOW_EDGE
    if refined.overlap < LOOP_CLOSURE_MIN_OVERLAP:
        return Rejection.LOW_OVERLAP
    if refined.pose.distance_to(found.pose) > MAX_REFINEMENT_DISTANCE:
        return Rejection.REFINEMENT_DIVERGED
    return None


def _explanation(rejection: Rejection | None, found: Correlation, refined: Refinement) -> str:
    """The reason of a rejection with the measured values; empty without a rejection."""
    if rejection is None:
        return ""
    return EXPLANATIONS[rejection].format(
        score=found.score,
        second_best_score=found.second_best_score,
        overlap=refined.overlap,
        min_score=LOOP_CLOSURE_MIN_SCORE,
        min_overlap=LOOP_CLOSURE_MIN_OVERLAP,
    )


def _best_pose(grid: MatchingGrid, cloud: PointCloud, window: SearchWindow) -> Correlation:
    """The pose of the window at which the cloud fits best."""
    count = round(SEARCH_POINTS * min(FULL_POINTS_WINDOW / window.distance, 1.0))
    return correlate(grid, cloud.subsampled(count).points, window, second_best_share=LOOP_CLOSURE_MAX_SECOND_BEST)


def _doubled(window: SearchWindow) -> SearchWindow:
    """A window twice as wide, up to `MAX_WINDOW` and `MAX_WINDOW_ANGLE`."""
    distance, angle = 2.0 * window.distance, 2.0 * window.angle
    return SearchWindow(window.centre, min(distance, MAX_WINDOW), min(angle, MAX_WINDOW_ANGLE))
