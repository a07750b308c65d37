"""EKF localization tracks from a known start, and does not recover from a wrong one."""

from __future__ import annotations

import math

import numpy as np

from wherry.localization.ekf import EkfLocalization
from wherry.localization.parameters import AmclParameters
from wherry.robot import Odometry, Velocity
from wherry.space.pose import Pose
from wherry_testing.rooms import LIDAR, Building, drive, wheel_odometry

PARAMETERS = AmclParameters(alpha1=0.05, alpha2=0.05, alpha3=0.05, alpha4=0.05, sigma_hit=0.1)
START_COVARIANCE = np.diag([0.05**2, 0.05**2, 0.03**2])  # m², m², rad²


def errors(start: Pose, steps: int = 600) -> np.ndarray:
    rng = np.random.default_rng(0)
    truth = list(drive())[:steps]
    ekf = EkfLocalization(Building().grid(), LIDAR, PARAMETERS)
    ekf.initialize(start, START_COVARIANCE)
    pairs = zip(truth, wheel_odometry(truth, rng), strict=True)
    return np.array([ekf.update(now, Building().scan(now.time, pose, rng)).distance_to(pose) for pose, now in pairs])


def test_tracks_from_a_known_start() -> None:
    found = errors(next(iter(drive())))
    assert math.sqrt((found**2).mean()) < 0.03


def test_does_not_recover_from_a_wrong_start() -> None:
    assert errors(Pose(4.5, 2.1, 2.0))[-1] > 0.5


def test_without_readings_only_the_prediction_step_runs() -> None:
    ekf = EkfLocalization(Building().grid(), LIDAR, AmclParameters(alpha1=0, alpha2=0, alpha3=0.01, alpha4=0))
    ekf.initialize(Pose(1.0, 1.0, math.pi / 2), np.diag([0.0, 0.0, 0.01]))
    blind = Building().scan(0.0, Pose(1.0, 1.0))
    blind.ranges[:] = math.inf
    ekf.update(Odometry(0.0, Pose(), Velocity()), blind)
    found = ekf.update(Odometry(1.0, Pose(2.0, 0.0, 0.5), Velocity()), blind)
    np.testing.assert_allclose(found.as_array(), [1.0, 3.0, math.pi / 2 + 0.5])
    covariance = ekf._covariance
    np.testing.assert_allclose(covariance, [[0.04, 0, -0.02], [0, 0.04, 0], [-0.02, 0, 0.01]], atol=1e-12)
