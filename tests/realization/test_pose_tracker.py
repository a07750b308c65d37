"""The pose tracker: scans correct the pose, odometry propagates it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from wherry.realization.pose_tracker import PoseTracker
from wherry.robot import Odometry, Scan, Velocity
from wherry.space.pose import Pose

SCAN = Scan(0.0, np.full(4, math.inf), -math.pi, math.pi / 2, 0.02, 12.0)
poses = st.builds(Pose, st.floats(-9, 9), st.floats(-9, 9), st.floats(-3, 3))


class ConstantEstimator:
    """A pose estimator that always returns the same pose."""

    def __init__(self, pose: Pose) -> None:
        self.pose = pose
        self.updates = 0
        self.is_lost = False

    def update(self, odometry: Odometry, scan: Scan) -> Pose:
        self.updates += 1
        return self.pose

    @property
    def particles(self) -> NDArray[np.float64]:
        return np.empty((0, 3))


def odometry(pose: Pose) -> Odometry:
    return Odometry(0.0, pose, Velocity())


def assert_same(pose: Pose, other: Pose) -> None:
    assert (pose.x, pose.y) == pytest.approx((other.x, other.y), abs=1e-9)
    assert math.remainder(pose.theta - other.theta, math.tau) == pytest.approx(0.0, abs=1e-9)


def test_the_pose_is_the_start_before_the_first_measurement() -> None:
    tracker = PoseTracker(ConstantEstimator(Pose(9.0, 9.0)), Pose(1.0, 2.0, 0.3))
    assert tracker.pose == Pose(1.0, 2.0, 0.3)


def test_a_scan_before_the_first_odometry_is_ignored() -> None:
    estimator = ConstantEstimator(Pose(9.0, 9.0))
    tracker = PoseTracker(estimator, Pose(1.0, 2.0))
    tracker.add_scan(SCAN)
    assert estimator.updates == 0
    assert tracker.pose == Pose(1.0, 2.0)


@given(poses, poses, poses)
def test_odometry_propagates_the_start_pose(start: Pose, first: Pose, motion: Pose) -> None:
    tracker = PoseTracker(ConstantEstimator(Pose()), start)
    tracker.add_odometry(odometry(first))
    assert_same(tracker.pose, start)
    tracker.add_odometry(odometry(first @ motion))
    assert_same(tracker.pose, start @ motion)


@given(poses, poses, poses)
def test_odometry_propagates_the_last_correction(wheels: Pose, corrected: Pose, motion: Pose) -> None:
    tracker = PoseTracker(ConstantEstimator(corrected), Pose())
    tracker.add_odometry(odometry(wheels))
    tracker.add_scan(SCAN)
    assert_same(tracker.pose, corrected)
    tracker.add_odometry(odometry(wheels @ motion))
    assert_same(tracker.pose, corrected @ motion)
    assert_same(tracker.map_from_odom @ wheels, corrected)
