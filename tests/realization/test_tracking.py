"""The pose between two scans: corrected by the one, carried on by odometry until the next."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from wherry.realization.tracking import PoseTracker
from wherry.robot import Odometry, Scan, Velocity
from wherry.space.pose import Pose

SCAN = Scan(0.0, np.full(4, math.inf), -math.pi, math.pi / 2, 0.02, 12.0)
poses = st.builds(Pose, st.floats(-9, 9), st.floats(-9, 9), st.floats(-3, 3))


class Says:
    """A corrector that always says the same."""

    def __init__(self, pose: Pose) -> None:
        self.pose = pose
        self.asked = 0
        self.lost = False

    def correct(self, odometry: Odometry, scan: Scan) -> Pose:
        self.asked += 1
        return self.pose

    @property
    def particles(self) -> NDArray[np.float64]:
        return np.empty((0, 3))


def odometry(pose: Pose) -> Odometry:
    return Odometry(0.0, pose, Velocity())


def assert_same(pose: Pose, other: Pose) -> None:
    assert (pose.x, pose.y) == pytest.approx((other.x, other.y), abs=1e-9)
    assert math.remainder(pose.theta - other.theta, math.tau) == pytest.approx(0.0, abs=1e-9)


def test_before_anything_is_measured_the_robot_is_where_it_was_put() -> None:
    tracker = PoseTracker(Says(Pose(9.0, 9.0)), Pose(1.0, 2.0, 0.3))
    assert tracker.pose == Pose(1.0, 2.0, 0.3)


def test_a_scan_without_odometry_is_not_used() -> None:
    says = Says(Pose(9.0, 9.0))
    tracker = PoseTracker(says, Pose(1.0, 2.0))
    tracker.see(SCAN)
    assert says.asked == 0
    assert tracker.pose == Pose(1.0, 2.0)


@given(poses, poses, poses)
def test_odometry_moves_the_robot_from_where_it_was(start: Pose, first: Pose, motion: Pose) -> None:
    tracker = PoseTracker(Says(Pose()), start)
    tracker.hear(odometry(first))
    assert_same(tracker.pose, start)
    tracker.hear(odometry(first @ motion))
    assert_same(tracker.pose, start @ motion)


@given(poses, poses, poses)
def test_a_correction_holds_until_the_next_one(wheels: Pose, corrected: Pose, motion: Pose) -> None:
    tracker = PoseTracker(Says(corrected), Pose())
    tracker.hear(odometry(wheels))
    tracker.see(SCAN)
    assert_same(tracker.pose, corrected)
    tracker.hear(odometry(wheels @ motion))
    assert_same(tracker.pose, corrected @ motion)
    assert_same(tracker.map_from_odom @ wheels, corrected)
