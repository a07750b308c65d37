"""Conversion of velocity commands to wheel speeds, and of wheel angles to odometry."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from wherry.robot import Velocity
from wherry.simulation.drive import TRACK_WIDTH, WHEEL_RADIUS, Drive, WheelOdometry, WheelOdometryErrors
from wherry.simulation.model import BODY

PERIOD = 0.005  # s


def _velocities(drive: Drive, start: float, seconds: float) -> np.ndarray:
    """[N, 2] linear and angular velocity of the commanded wheel speeds, m/s, rad/s."""
    speeds = [drive.wheel_speeds(start + step * PERIOD, PERIOD) for step in range(round(seconds / PERIOD))]
    left, right = WHEEL_RADIUS * np.array(speeds).T
    return np.column_stack([(left + right) / 2, (right - left) / TRACK_WIDTH])


def test_speed_rises_by_the_acceleration_limit_to_the_command() -> None:
    drive = Drive(BODY)
    drive.command(Velocity(0.1, 0.25), 0.0)
    velocities = _velocities(drive, 0.0, 0.3)
    rise = np.minimum(BODY.max_linear_acceleration * PERIOD * np.arange(1, 61), 0.1)
    assert_allclose(velocities[:, 0], rise, atol=1e-12)
    assert_allclose(velocities[-1], [0.1, 0.25])


def test_commands_are_clipped_to_the_speed_limits() -> None:
    drive = Drive(BODY)
    for step in range(4):
        drive.command(Velocity(-9.0, 99.0), 0.3 * step)
        velocities = _velocities(drive, 0.3 * step, 0.3)
    assert_allclose(velocities[-1], [-BODY.max_linear, BODY.max_angular])


@pytest.mark.parametrize("velocity", [Velocity(math.nan, 0.0), Velocity(0.0, -math.inf)])
def test_a_velocity_that_is_not_finite_is_rejected(velocity: Velocity) -> None:
    with pytest.raises(ValueError, match="must be finite"):
        Drive(BODY).command(velocity, 0.0)


def test_wheels_stand_still_without_a_command() -> None:
    assert_allclose(_velocities(Drive(BODY), 0.0, 1.0), 0.0)


def test_wheels_stand_still_half_a_second_after_the_last_command() -> None:
    drive = Drive(BODY)
    for step in range(4):
        drive.command(Velocity(BODY.max_linear, BODY.max_angular), 0.2 * step)
        _velocities(drive, 0.2 * step, 0.2)
    afterwards = _velocities(drive, 0.8, 0.3)
    assert_allclose(afterwards[round(0.14 / PERIOD)], [BODY.max_linear, BODY.max_angular])  # 0.34 s after it
    assert_allclose(afterwards[-1], 0.0, atol=1e-9)


def test_odometry_without_errors_is_exact_on_lines_arcs_and_turns() -> None:
    wheel_odometry = WheelOdometry(WheelOdometryErrors(radius_sigma=0.0, distance_sigma=0.0), np.random.default_rng(0))
    wheel_odometry.read(0.0, np.array([7.0, -3.0]), 1.0)  # the initial angles do not matter
    ahead = wheel_odometry.read(1.0, np.array([27.0, 17.0]), 1.0)
    assert_allclose(ahead.pose.as_array(), [1.0, 0.0, 0.0], atol=1e-12)
    assert ahead.velocity == Velocity(pytest.approx(1.0), pytest.approx(0.0))
    quarter = math.pi / 4 * TRACK_WIDTH / WHEEL_RADIUS
    turned = wheel_odometry.read(2.0, np.array([27.0 - quarter, 17.0 + quarter]), 0.5)
    assert_allclose(turned.pose.as_array(), [1.0, 0.0, math.pi / 2], atol=1e-12)
    assert turned.velocity.angular == pytest.approx(math.pi)
    # A half circle of radius 1 m to the left, from (1, 0) looking north: to (−1, 0) looking south.
    inner, outer = (math.pi * (1 - sign * TRACK_WIDTH / 2) / WHEEL_RADIUS for sign in (1, -1))
    half = wheel_odometry.read(3.0, np.array([27.0 - quarter + inner, 17.0 + quarter + outer]), 1.0)
    assert_allclose(half.pose.as_array()[:2], [-1.0, 0.0], atol=1e-12)
    assert abs(math.remainder(half.pose.theta + math.pi / 2, math.tau)) < 1e-9


def test_wheel_radius_errors_have_the_given_sigma_and_repeat_with_the_seed() -> None:
    def distance_ratio(seed: int) -> float:
        wheel_odometry = WheelOdometry(
            WheelOdometryErrors(radius_sigma=0.01, distance_sigma=0.0), np.random.default_rng(seed)
        )
        wheel_odometry.read(0.0, np.zeros(2), 1.0)
        return wheel_odometry.read(1.0, np.full(2, 200.0), 1.0).velocity.linear / 10.0

    ratios = np.array([distance_ratio(seed) for seed in range(400)])
    assert np.std(ratios) == pytest.approx(0.01 / math.sqrt(2), rel=0.1)
    assert distance_ratio(5) == distance_ratio(5)


def test_odometry_does_not_drift_at_standstill() -> None:
    wheel_odometry = WheelOdometry(WheelOdometryErrors(), np.random.default_rng(0))
    for time in range(100):
        reading = wheel_odometry.read(time, np.array([3.0, 4.0]), 0.05)
    assert reading.pose.as_array() == pytest.approx(0.0)
