"""The differential drive: velocity commands become wheel speeds, and wheel rotations become odometry."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from wherry.robot import Body, Odometry, Velocity
from wherry.space.pose import Floats, Pose

WHEEL_RADIUS = 0.05  # m
TRACK_WIDTH = 0.32  # m between the wheels' contact points
COMMAND_TIMEOUT = 0.35  # s after the last command at which the drive brakes, so that it stands still within 0.5 s
BRAKING_DECELERATION = 5.0  # m/s² of each wheel after the command timeout


class Drive:
    """Turns velocity commands into wheel speeds, within the robot's limits of speed and acceleration.

    Args:
        body: The robot's limits.
    """

    def __init__(self, body: Body) -> None:
        self._body = body
        self._target = Velocity()
        self._current = Velocity()
        self._last_command = -math.inf

    def command(self, velocity: Velocity, time: float) -> None:
        """Accelerate towards a velocity, clipped to the limits.

        Args:
            velocity: The target velocity.
            time: Time of the command, s.

        Raises:
            ValueError: A component is not a finite number.
        """
        if not (math.isfinite(velocity.linear) and math.isfinite(velocity.angular)):
            raise ValueError(f"a velocity must be finite, not {velocity}")
        linear, angular = self._body.max_linear, self._body.max_angular
        self._target = Velocity(_clip(velocity.linear, linear), _clip(velocity.angular, angular))
        self._last_command = time

    def wheel_speeds(self, time: float, period: float) -> tuple[float, float]:
        """Advance the commanded velocity by one control period.

        Args:
            time: Beginning of the period, s.
            period: Duration of the period, s.

        Returns:
            Speeds of the left and the right wheel, rad/s.
        """
        target, current = self._target, self._current
        linear, angular = self._body.max_linear_acceleration, self._body.max_angular_acceleration
        if time - self._last_command > COMMAND_TIMEOUT:
            target = Velocity()
            linear, angular = BRAKING_DECELERATION, BRAKING_DECELERATION / (TRACK_WIDTH / 2)
        if current != target:
            self._current = Velocity(
                current.linear + _clip(target.linear - current.linear, linear * period),
                current.angular + _clip(target.angular - current.angular, angular * period),
            )
        turn = self._current.angular * TRACK_WIDTH / 2
        return (self._current.linear - turn) / WHEEL_RADIUS, (self._current.linear + turn) / WHEEL_RADIUS


@dataclass(frozen=True, slots=True)
class WheelOdometryErrors:
    """Standard deviations of the wheel odometry's errors.

    Attributes:
        radius_sigma: Relative error of a wheel's radius, drawn once for each wheel.
        distance_sigma: Relative error of the distance that a wheel rolled, drawn anew for each reading.
    """

    radius_sigma: float = 0.002
    distance_sigma: float = 0.03


class WheelOdometry:
    """Integrates the wheels' rotations to a pose in the odom frame, with errors that make it drift.

    Args:
        errors: Standard deviations of the errors.
        rng: Source of the errors.
    """

    def __init__(self, errors: WheelOdometryErrors, rng: np.random.Generator) -> None:
        self._distance_sigma = errors.distance_sigma
        self._radius_factors = 1.0 + errors.radius_sigma * rng.standard_normal(2)
        self._rng = rng
        self._angles: Floats | None = None
        self._pose = Pose()

    def read(self, time: float, angles: Floats, period: float) -> Odometry:
        """Integrate the rotation since the last reading along an arc.

        Args:
            time: Time of the reading, s.
            angles: [2] angles of the left and the right wheel, rad.
            period: Time since the last reading, s.
        """
        turned = np.zeros(2) if self._angles is None else angles - self._angles
        self._angles = angles.copy()
        distance_factors = 1.0 + self._distance_sigma * self._rng.standard_normal(2)
        left, right = WHEEL_RADIUS * turned * self._radius_factors * distance_factors
        forwards, turn = float(left + right) / 2, float(right - left) / TRACK_WIDTH
        self._pose = self._pose @ _arc(forwards, turn)
        return Odometry(time, self._pose, Velocity(forwards / period, turn / period))


def _arc(length: float, turn: float) -> Pose:
    """End of an arc of a length, m, that starts along the x axis and turns by an angle, rad."""
    half = turn / 2
    chord = length * math.sin(half) / half if half else length
    return Pose(chord * math.cos(half), chord * math.sin(half), turn)


def _clip(value: float, limit: float) -> float:
    """Clip a value to [−limit, limit]."""
    return max(-limit, min(limit, value))
