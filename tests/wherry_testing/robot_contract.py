"""Contract tests of the `Robot` protocol; tests of an implementation subclass `RobotContract`.

The subclass provides a fixture ``robot``: a robot at rest with an empty fork, 1 m of free floor ahead and enough space
to turn on the spot.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from wherry.robot import Odometry, Robot, Scan, Velocity


def record(robot: Robot, seconds: float, velocity: Velocity | None = None) -> list[Scan | Odometry]:
    """Receive measurements for a time, s, while commanding a velocity if one is given."""
    measurements = [robot.receive()]
    while measurements[-1].time - measurements[0].time < seconds:
        if velocity is not None:
            robot.command(velocity)
        measurements.append(robot.receive())
    return measurements


def odometry(measurements: list[Scan | Odometry]) -> list[Odometry]:
    """Only the odometry."""
    return [measurement for measurement in measurements if isinstance(measurement, Odometry)]


def scans(measurements: list[Scan | Odometry]) -> list[Scan]:
    """Only the scans."""
    return [measurement for measurement in measurements if isinstance(measurement, Scan)]


class RobotContract:
    """Tests that every robot must pass."""

    def test_body_is_plausible(self, robot: Robot) -> None:
        body = robot.body
        assert 0 < body.box_radius < body.radius
        assert math.hypot(body.lidar.x, body.lidar.y) <= body.radius
        assert min(body.max_linear, body.max_angular) > 0
        assert min(body.max_linear_acceleration, body.max_angular_acceleration) > 0

    def test_times_never_decrease(self, robot: Robot) -> None:
        times = [measurement.time for measurement in record(robot, 2.0)]
        assert all(math.isfinite(time) for time in times)
        assert all(earlier <= later for earlier, later in pairwise(times))

    def test_odometry_is_at_least_as_frequent_as_scans(self, robot: Robot) -> None:
        measurements = record(robot, 3.0)
        assert len(odometry(measurements)) >= len(scans(measurements)) >= 3.0 * 5
        assert max(np.diff([reading.time for reading in odometry(measurements)])) <= 0.11

    def test_a_scan_follows_odometry_of_the_same_time_or_later(self, robot: Robot) -> None:
        latest = -math.inf
        measurements = record(robot, 2.0)
        for measurement in measurements[measurements.index(odometry(measurements)[0]) :]:
            if isinstance(measurement, Odometry):
                latest = measurement.time
            else:
                assert measurement.time <= latest

    def test_scans_are_well_formed(self, robot: Robot) -> None:
        for scan in scans(record(robot, 1.0)):
            assert scan.ranges.ndim == 1
            assert 0 <= scan.range_min < scan.range_max
            assert scan.angle_increment > 0
            assert scan.angle_increment * len(scan.ranges) <= math.tau + scan.angle_increment / 2
            assert not np.any(scan.ranges == -np.inf)
            assert scan.valid.mean() > 0.5

    def test_robot_stands_still_without_commands(self, robot: Robot) -> None:
        readings = odometry(record(robot, 1.0))
        assert readings[0].pose.distance_to(readings[-1].pose) < 0.005
        assert abs(readings[-1].velocity.linear) < 0.01
        assert abs(readings[-1].velocity.angular) < 0.02

    def test_positive_linear_velocity_drives_forwards(self, robot: Robot) -> None:
        readings = odometry(record(robot, 2.0, Velocity(0.2)))
        moved = readings[-1].pose.relative_to(readings[0].pose)
        assert moved.x == pytest.approx(0.4, abs=0.08)
        assert abs(moved.y) < 0.05
        assert readings[-1].velocity.linear == pytest.approx(0.2, abs=0.05)

    def test_positive_angular_velocity_turns_counter_clockwise(self, robot: Robot) -> None:
        readings = odometry(record(robot, 2.0, Velocity(0.0, 0.5)))
        moved = readings[-1].pose.relative_to(readings[0].pose)
        assert moved.theta == pytest.approx(1.0, abs=0.15)
        assert math.hypot(moved.x, moved.y) < 0.05
        assert readings[-1].velocity.angular == pytest.approx(0.5, abs=0.1)

    def test_lidar_and_odometry_agree(self, robot: Robot) -> None:
        # The range ahead decreases by the distance driven.
        before, after = record(robot, 0.5), record(robot, 2.0, Velocity(0.2))
        driven = odometry(after)[-1].pose.relative_to(odometry(before)[-1].pose).x
        assert _range_ahead(scans(before)[-1]) - _range_ahead(scans(after)[-1]) == pytest.approx(driven, abs=0.06)

    def test_robot_stops_half_a_second_after_the_last_command(self, robot: Robot) -> None:
        commanded = record(robot, 1.5, Velocity(0.3))[-1].time
        readings = odometry(record(robot, 1.5))
        stopped = [reading for reading in readings if reading.time >= commanded + 0.55]
        assert all(abs(reading.velocity.linear) < 0.02 for reading in stopped)
        assert stopped[0].pose.distance_to(stopped[-1].pose) < 0.01

    def test_velocity_is_limited(self, robot: Robot) -> None:
        turning = odometry(record(robot, 1.5, Velocity(0.0, 1000.0)))
        assert max(reading.velocity.angular for reading in turning) < robot.body.max_angular * 1.2

    def test_acceleration_is_limited(self, robot: Robot) -> None:
        readings = odometry(record(robot, 0.6, Velocity(robot.body.max_linear)))
        for earlier, later in pairwise(readings):
            gained = later.velocity.linear - earlier.velocity.linear
            assert gained < robot.body.max_linear_acceleration * (later.time - earlier.time) + 0.05

    @pytest.mark.parametrize("velocity", [Velocity(math.nan), Velocity(0.0, math.inf)])
    def test_velocity_that_is_not_finite_is_rejected(self, robot: Robot, velocity: Velocity) -> None:
        with pytest.raises(ValueError, match="finite"):
            robot.command(velocity)

    def test_latch_without_a_box_holds_nothing(self, robot: Robot) -> None:
        record(robot, 0.2)
        assert robot.close_latch() is False
        assert robot.open_latch() is True


def _range_ahead(scan: Scan) -> float:
    """Median range within 5° of straight ahead, m."""
    ahead = np.abs(scan.angles) < math.radians(5)
    return float(np.median(scan.ranges[ahead]))
