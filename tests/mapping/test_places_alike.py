"""Graph SLAM where places look the same: a corridor of 30 m between rooms that are all alike."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from wherry.mapping.graph_slam import GraphSlam, GraphSlamSettings
from wherry.space.pose import Floats, Pose, relative
from wherry_testing.buildings import LIDAR, ROOM, Drive, alike, drive, wall_distances, way_along_alike

VISITS = [(1, 1), (3, -1), (5, 1), (4, 1), (2, -1), (0, 1)]
STRAIGHT = [(5, 1), (0, -1), (5, -1)]  # up and down the whole corridor, with alike rooms at its ends


def mapped(driven: Drive) -> GraphSlam:
    slam = GraphSlam(LIDAR, GraphSlamSettings(resolution=0.025))
    for scan, odometry in zip(driven.scans, driven.odometry, strict=True):
        slam.add(scan, odometry)
    slam.finish()
    return slam


def closure_errors(slam: GraphSlam, truth: Floats) -> Floats:
    """[C] m, how far accepted closures are off."""
    scan_of: dict[int, int] = {}
    for number, (_, key, _) in enumerate(slam.passed):
        scan_of.setdefault(key, number)
    poses = [Pose.from_array(pose) for pose in truth]
    off = [
        closure.measured.distance_to(poses[scan_of[closure.node]].relative_to(poses[scan_of[closure.target]]))
        for closure in slam.closures
        if closure.accepted
    ]
    return np.array(off)


def without_doors() -> NDArray[np.bool_]:
    """The same building, of whose doors only those of the first and last rooms are left."""
    blocked = alike()
    blocked[245:248, 250:1250], blocked[352:355, 250:1250] = True, True
    return blocked


@pytest.mark.parametrize("range_max", [12.0, 6.0])
@pytest.mark.parametrize("seed", [0, 1])
def test_rooms_that_are_alike_are_not_taken_for_each_other(range_max: float, seed: int) -> None:
    blocked = alike()
    driven = drive(0.01, 0.03, seed, blocked=blocked, way=way_along_alike(VISITS), range_max=range_max)
    drifted = np.array([odometry.pose.as_array() for odometry in driven.odometry])
    assert np.hypot(*(drifted - driven.truth)[:, :2].T).max() > ROOM / 2  # by odometry another room would be nearer
    slam = mapped(driven)
    off = relative(slam.trajectory.poses, driven.truth)
    assert np.hypot(off[:, 0], off[:, 1]).max() < 0.08
    assert np.abs(off[:, 2]).max() < math.radians(1.0)
    closures = closure_errors(slam, driven.truth)
    assert len(closures) > 50
    assert closures.max() < 0.15
    assert np.median(wall_distances(slam.grid(), driven.start, blocked)) <= 0.02


def test_a_bare_corridor_does_not_become_another_part_of_itself() -> None:
    """Its length is odometry's, for nothing in it tells, but its ends are not mistaken, nor rooms for others."""
    driven = drive(0.01, 0.03, blocked=without_doors(), way=way_along_alike(STRAIGHT), range_max=6.0)
    slam = mapped(driven)
    closures = closure_errors(slam, driven.truth)
    assert len(closures) > 50
    assert closures.max() < 1.0
    off = relative(slam.trajectory.poses, driven.truth)
    assert np.hypot(off[:, 0], off[:, 1])[-1] < 0.1  # back where it began
