"""Alternative poses: remembered in a symmetric room, and dropped as soon as the room is not symmetric."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wherry.localization.localizer import Localization, Localizer
from wherry.localization.parameters import GLOBAL_PARAMETERS
from wherry.robot import Odometry, Scan, Velocity
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry.space.raycast import cast_rays

ANGLES = np.radians(np.arange(0.0, 360.0, 2.0) - 180.0)
HALF_TURN = Pose(0.0, 0.0, math.pi)  # about the centre of the room


def room(*, is_symmetric: bool) -> OccupancyGrid:
    """8 × 5 m with a pillar and a recess in each half, and a second pillar in one half unless it is symmetric."""
    probability = np.full((100, 160), 0.02, np.float32)
    probability[[0, -1]] = probability[:, [0, -1]] = 0.98
    for rows, columns in ((slice(30, 38), slice(30, 40)), (slice(0, 12), slice(60, 64))):
        probability[rows, columns] = 0.98
        probability[::-1, ::-1][rows, columns] = 0.98
    if not is_symmetric:
        probability[70:80, 120:130] = 0.98
    return OccupancyGrid(probability, 0.05, Pose(-4.0, -2.5))


def truth(count: int) -> list[Pose]:
    times = 0.5 * np.arange(count)
    return [Pose(1.5 * math.sin(t / 9), 0.9 * math.cos(t / 6) - 0.2, t / 10 - 1.0) for t in times]


def localize_globally(grid: OccupancyGrid, path: list[Pose], seed: int) -> tuple[Localizer, list[Localization]]:
    poses = np.array([pose.as_array() for pose in path])
    ranges = cast_rays(grid.occupied, grid.resolution, grid.origin, poses, ANGLES, 50.0)
    ranges = ranges + np.random.default_rng(seed).normal(0.0, 0.01, ranges.shape)
    localizer = Localizer(grid, Pose(), GLOBAL_PARAMETERS, np.random.default_rng(seed))
    localizer.initialize_globally()
    start, found = Pose(3.0, 1.0, 2.0), []
    for index, pose in enumerate(path):
        scan = Scan(0.5 * index, ranges[index], -math.pi, math.radians(2.0), 0.05, 20.0)
        found.append(localizer.update(Odometry(0.5 * index, start @ pose, Velocity()), scan))
    return localizer, found


@pytest.mark.parametrize("seed", range(4))
def test_both_poses_in_a_symmetric_room_are_equally_probable(seed: int) -> None:
    path = truth(100)
    _, found = localize_globally(room(is_symmetric=True), path, seed)
    last = found[-1]
    candidates = (path[-1], HALF_TURN @ path[-1])
    assert last.lost_probability == pytest.approx(0.5, abs=0.05)
    assert last.tracking_lost_probability < 0.1
    assert len(last.alternatives) == 1
    assert sorted([last.pose.x, last.alternatives[0].pose.x]) == pytest.approx(
        sorted(p.x for p in candidates), abs=0.05
    )
    assert all(0.4 < one.lost_probability < 0.8 for one in found[20:])


@pytest.mark.parametrize("seed", range(4))
def test_a_room_that_is_not_symmetric_leaves_one_pose(seed: int) -> None:
    path = truth(100)
    localizer, found = localize_globally(room(is_symmetric=False), path, seed)
    assert found[-1].pose.distance_to(path[-1]) < 0.05
    assert found[-1].lost_probability < 0.05
    assert not found[-1].alternatives
    assert localizer.fit.value > 0.95


def test_a_robot_that_stands_in_a_symmetric_room_does_not_know_its_pose_either() -> None:
    _, found = localize_globally(room(is_symmetric=True), truth(1) * 10, seed=0)
    assert found[-1].lost_probability == pytest.approx(0.5, abs=0.1)


def test_a_known_start_in_a_symmetric_room_is_not_doubted() -> None:
    path = truth(100)
    grid = room(is_symmetric=True)
    poses = np.array([pose.as_array() for pose in path])
    ranges = cast_rays(grid.occupied, grid.resolution, grid.origin, poses, ANGLES, 50.0)
    localizer = Localizer(grid, Pose(), GLOBAL_PARAMETERS, np.random.default_rng(0))
    localizer.initialize(path[0], np.diag([0.1**2, 0.1**2, 0.05**2]))
    for index, pose in enumerate(path):
        scan = Scan(0.5 * index, ranges[index], -math.pi, math.radians(2.0), 0.05, 20.0)
        last = localizer.update(Odometry(0.5 * index, pose, Velocity()), scan)
    assert last.pose.distance_to(path[-1]) < 0.05
    assert last.lost_probability < 0.05
    assert not last.alternatives
