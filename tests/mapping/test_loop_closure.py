"""The gates that a loop closure has to pass."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from wherry.mapping.correlative import SearchWindow
from wherry.mapping.loop_closure import (
    MAX_WINDOW,
    MAX_WINDOW_ANGLE,
    MIN_WINDOW,
    LoopClosure,
    attempt_loop_closure,
    count_rejections,
    search_window,
)
from wherry.mapping.matching_grid import MatchingGrid
from wherry.mapping.point_cloud import PointCloud
from wherry.mapping.rejections import EXPLANATIONS, Rejection, rejection_of
from wherry.robot import Scan
from wherry.space.pose import Pose
from wherry.space.raycast import cast_rays
from wherry_testing.buildings import LIDAR, RANGE_MAX, RESOLUTION, building
from wherry_testing.corridors import bare_corridor

HERE = Pose(2.4, 2.0, 0.4)


def cloud_at(pose: Pose) -> PointCloud:
    angles = np.linspace(-math.pi, math.pi, 360, endpoint=False)
    ranges = cast_rays(building(), RESOLUTION, Pose(), (pose @ LIDAR).as_array()[None], angles, RANGE_MAX)[0]
    return PointCloud.from_scan(Scan(0.0, ranges, -math.pi, math.tau / 360, 0.05, RANGE_MAX), LIDAR)


def attempt(there: Pose, window: SearchWindow) -> LoopClosure:
    """Match a scan at a pose relative to `HERE` to a scan at `HERE`."""
    grid = MatchingGrid()
    grid.add(cloud_at(HERE))
    return attempt_loop_closure(1.0, 7, 3, grid, cloud_at(HERE @ there), window)


def test_a_closure_is_accepted_from_a_distant_pose() -> None:
    there = Pose(0.3, -0.2, 0.15)
    closure = attempt(there, SearchWindow(Pose(1.2, 0.6, -0.1), 1.5, 0.5))
    assert closure.is_accepted
    assert (closure.keyframe, closure.target, closure.time) == (7, 3, 1.0)
    assert closure.measured.distance_to(there) < 0.02
    assert closure.second_best_score < 0.9 * closure.score


def test_a_closure_in_another_room_is_rejected_for_its_low_score() -> None:
    closure = attempt(HERE.inverse @ Pose(9.4, 7.0, 2.0), SearchWindow(Pose(), 1.0, 0.3))
    assert not closure.is_accepted
    assert closure.rejection is Rejection.LOW_SCORE
    assert closure.explanation.startswith("response 0.")


def test_a_pose_beyond_the_window_is_found_in_a_wider_one() -> None:
    there = Pose(0.75, 0.1, 0.0)
    closure = attempt(there, SearchWindow(Pose(), 0.6, 0.1))
    assert closure.is_accepted
    assert closure.window == 1.2
    assert closure.measured.distance_to(there) < 0.02


def test_a_pose_beyond_the_widest_window_is_rejected() -> None:
    closure = attempt(Pose(theta=MAX_WINDOW_ANGLE + 0.1), SearchWindow(Pose(), 0.5, MAX_WINDOW_ANGLE / 2.0))
    assert not closure.is_accepted
    assert closure.window <= MAX_WINDOW


def test_a_closure_in_a_corridor_is_rejected_as_ambiguous() -> None:
    corridor = bare_corridor(10.0)
    grid = MatchingGrid()
    grid.add(corridor)
    part = np.abs(corridor.points[:, 0]) < 3.0
    middle = PointCloud(corridor.points[part], corridor.normals[part])
    closure = attempt_loop_closure(0.0, 1, 0, grid, middle, SearchWindow(Pose(), 2.0, 0.1))
    assert closure.rejection is Rejection.AMBIGUOUS
    assert closure.second_best_score > 0.9 * closure.score


@pytest.mark.parametrize(("sigma", "expected"), [(0.01, MIN_WINDOW), (0.5, 1.5), (100.0, MAX_WINDOW)])
def test_the_search_window_is_three_standard_deviations_within_limits(sigma: float, expected: float) -> None:
    window = search_window(Pose(1.0, 2.0, 0.3), np.diag([sigma**2, (sigma / 2) ** 2, 0.1**2]))
    assert window.distance == pytest.approx(expected)
    assert window.angle == pytest.approx(0.3)
    assert window.centre == Pose(1.0, 2.0, 0.3)


def test_rejections_are_counted_by_reason() -> None:
    accepted = attempt(Pose(0.1), SearchWindow(Pose(), 0.6, 0.1))
    reasons = [Rejection.AMBIGUOUS, Rejection.LOW_SCORE, Rejection.LOW_SCORE]
    closures = [accepted, *(replace(accepted, rejection=reason) for reason in reasons)]
    assert list(count_rejections(closures).items()) == [(Rejection.LOW_SCORE, 2), (Rejection.AMBIGUOUS, 1)]


@pytest.mark.parametrize("reason", Rejection)
def test_the_reason_is_recovered_from_an_explanation(reason: Rejection) -> None:
    values = {"score": 0.31, "second_best_score": 0.3, "overlap": 0.4, "min_score": 0.45, "min_overlap": 0.6}
    assert rejection_of(EXPLANATIONS[reason].format(**values)) is reason


def test_only_an_empty_explanation_has_no_reason() -> None:
    assert rejection_of("") is None
    with pytest.raises(ValueError, match="no reason"):
        rejection_of("the weather")


def test_a_closure_is_found_in_a_wide_window() -> None:
    there = Pose(0.3, -0.2, 0.15)
    assert attempt(there, SearchWindow(Pose(2.0, 1.0, 0.1), 4.0, 0.3)).measured.distance_to(there) < 0.02
