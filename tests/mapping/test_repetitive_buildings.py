"""Graph SLAM in a building of identical rooms along a corridor of 30 m."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from wherry.mapping.graph_slam import GraphSlam
from wherry.mapping.settings import GraphSlamSettings
from wherry.space.pose import Floats, Pose, relative
from wherry_testing.buildings import (
    LIDAR,
    ROOM_PITCH,
    Drive,
    corridor_waypoints,
    drive,
    identical_rooms,
    wall_distances,
)

VISITS = [(1, 1), (3, -1), (5, 1), (4, 1), (2, -1), (0, 1)]
STRAIGHT = [(5, 1), (0, -1), (5, -1)]  # along the whole corridor and back, with identical rooms at its ends


def mapped(driven: Drive) -> GraphSlam:
    slam = GraphSlam(LIDAR, GraphSlamSettings(resolution=0.025))
    for scan, odometry in zip(driven.scans, driven.odometry, strict=True):
        slam.add(scan, odometry)
    slam.finish()
    return slam


def closure_errors(slam: GraphSlam, truth: Floats) -> Floats:
    """Distances of accepted closures from the truth, [C] m."""
    scans = slam.snapshot().keyframe_scans
    poses = [Pose.from_array(pose) for pose in truth]
    off = [
        closure.measured.distance_to(poses[scans[closure.keyframe]].relative_to(poses[scans[closure.target]]))
        for closure in slam.loop_closures
        if closure.is_accepted
    ]
    return np.array(off)


def without_doors() -> NDArray[np.bool_]:
    """The building with the doors of the first and last rooms only."""
    blocked = identical_rooms()
    blocked[245:248, 250:1250], blocked[352:355, 250:1250] = True, True
    return blocked


@pytest.mark.parametrize("range_max", [12.0, 6.0])
@pytest.mark.parametrize("seed", [0, 1])
def test_identical_rooms_are_not_confused(range_max: float, seed: int) -> None:
    blocked = identical_rooms()
    driven = drive(0.01, 0.03, seed, blocked=blocked, waypoints=corridor_waypoints(VISITS), range_max=range_max)
    drifted = np.array([odometry.pose.as_array() for odometry in driven.odometry])
    odometry_errors = np.hypot(*(drifted - driven.truth)[:, :2].T)
    assert odometry_errors.max() > ROOM_PITCH / 2, "odometry alone does not confuse the rooms"
    slam = mapped(driven)
    off = relative(slam.trajectory.poses, driven.truth)
    assert np.hypot(off[:, 0], off[:, 1]).max() < 0.08
    assert np.abs(off[:, 2]).max() < math.radians(1.0)
    closures = closure_errors(slam, driven.truth)
    assert len(closures) > 50
    assert closures.max() < 0.15
    assert np.median(wall_distances(slam.grid(), driven.start, blocked)) <= 0.02


def test_closures_in_a_bare_corridor_are_true() -> None:
    """Scans do not determine the position along it, but neither its ends nor its rooms are confused."""
    driven = drive(0.01, 0.03, blocked=without_doors(), waypoints=corridor_waypoints(STRAIGHT), range_max=6.0)
    slam = mapped(driven)
    closures = closure_errors(slam, driven.truth)
    assert len(closures) > 50
    assert closures.max() < 1.0
    off = relative(slam.trajectory.poses, driven.truth)
    assert np.hypot(off[:, 0], off[:, 1])[-1] < 0.1  # at the pose where the drive began
