"""The gates that a loop closure has to pass."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from wherry.mapping.closures import (
    LARGEST_WINDOW,
    LARGEST_WINDOW_ANGLE,
    LEAST_WINDOW,
    Closure,
    refusals,
    search_window,
    try_closure,
)
from wherry.mapping.cloud import Cloud
from wherry.mapping.correlative import Window
from wherry.mapping.submap import Submap
from wherry.robot import Scan
from wherry.space.pose import Pose
from wherry.space.raycast import cast_rays
from wherry_testing.buildings import LIDAR, RANGE_MAX, RESOLUTION, building

HERE = Pose(2.4, 2.0, 0.4)


def cloud_at(pose: Pose) -> Cloud:
    angles = np.linspace(-math.pi, math.pi, 360, endpoint=False)
    ranges = cast_rays(building(), RESOLUTION, Pose(), (pose @ LIDAR).as_array()[None], angles, RANGE_MAX)[0]
    return Cloud.of(Scan(0.0, ranges, -math.pi, math.tau / 360, 0.05, RANGE_MAX), LIDAR)


def attempt(there: Pose, window: Window) -> Closure:
    """Match what is seen at a pose relative to `HERE` to what is seen at `HERE`."""
    submap = Submap()
    submap.add(cloud_at(HERE))
    return try_closure(1.0, 7, 3, submap, cloud_at(HERE @ there), window)


def test_the_same_place_is_recognized_from_afar() -> None:
    there = Pose(0.3, -0.2, 0.15)
    closure = attempt(there, Window(Pose(1.2, 0.6, -0.1), 1.5, 0.5))
    assert closure.accepted
    assert (closure.node, closure.target, closure.time) == (7, 3, 1.0)
    assert closure.measured.distance_to(there) < 0.02
    assert closure.rival < 0.9 * closure.response


def test_another_room_is_refused_for_its_response() -> None:
    closure = attempt(HERE.inverse @ Pose(9.4, 7.0, 2.0), Window(Pose(), 1.0, 0.3))
    assert not closure.accepted
    assert "response" in closure.refused


def test_a_place_just_beyond_the_window_is_found_in_a_wider_one() -> None:
    there = Pose(0.75, 0.1, 0.0)
    closure = attempt(there, Window(Pose(), 0.6, 0.1))
    assert closure.accepted
    assert closure.window == 1.2
    assert closure.measured.distance_to(there) < 0.02


def test_a_place_beyond_the_widest_window_is_refused_for_the_edge_or_the_response() -> None:
    closure = attempt(Pose(theta=LARGEST_WINDOW_ANGLE + 0.1), Window(Pose(), 0.5, LARGEST_WINDOW_ANGLE / 2.0))
    assert not closure.accepted
    assert closure.window <= LARGEST_WINDOW


def test_a_corridor_is_refused_as_ambiguous() -> None:
    x = np.arange(-10.0, 10.0, 0.05)
    corridor = Cloud(
        np.vstack([np.column_stack([x, np.full_like(x, side)]) for side in (-0.8, 0.8)]),
        np.vstack([np.tile([0.0, -side], (len(x), 1)) for side in (-1.0, 1.0)]),
    )
    submap = Submap()
    submap.add(corridor)
    part = np.abs(corridor.points[:, 0]) < 3.0
    seen = Cloud(corridor.points[part], corridor.normals[part])
    closure = try_closure(0.0, 1, 0, submap, seen, Window(Pose(), 2.0, 0.1))
    assert "ambiguous" in closure.refused
    assert closure.rival > 0.9 * closure.response


@pytest.mark.parametrize(("sigma", "expected"), [(0.01, LEAST_WINDOW), (0.5, 1.5), (100.0, LARGEST_WINDOW)])
def test_the_window_is_three_deviations_within_limits(sigma: float, expected: float) -> None:
    window = search_window(Pose(1.0, 2.0, 0.3), np.diag([sigma**2, (sigma / 2) ** 2, 0.1**2]))
    assert window.distance == pytest.approx(expected)
    assert window.angle == pytest.approx(0.3)
    assert window.centre == Pose(1.0, 2.0, 0.3)


def test_refusals_are_counted_by_gate() -> None:
    there = Window(Pose(), 0.6, 0.1)
    fine = attempt(Pose(0.1), there)
    reasons = ["response 0.31 is below 0.45", "response 0.40 is below 0.45", "ambiguous: another place has response 1"]
    tried = [fine, *(replace(fine, refused=reason) for reason in reasons)]
    assert refusals(tried) == {"response": 2, "ambiguous": 1}


def test_wide_windows_are_searched_with_fewer_points() -> None:
    there = Pose(0.3, -0.2, 0.15)
    assert attempt(there, Window(Pose(2.0, 1.0, 0.1), 4.0, 0.3)).measured.distance_to(there) < 0.02
