"""The differential drive: velocity commands become wheel speeds, and wheel rotations become odometry."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from wherry.robot import Body, Odometry, Velocity
from wherry.space.pose import Floats, Pose

WHEEL_RADIUS = 0.05  # m
TRACK = 0.32  # m between the wheels
COMMAND_TIMEOUT = 0.35  # s without a command after which the drive brakes, to stand still within 0.5 s
BRAKING_DECELERATION = 5.0  # m/s² of each wheel after the command timeout


class Drive:
    """Turns velocity commands into wheel speeds, within the robot's limits of speed and acceleration.

    Args:
        body: The limits.
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
        """Speeds of the left and the right wheel, rad/s, for the ``period``, s, that begins at a time, s."""
        target, current = self._target, self._current
        linear, angular = self._body.max_linear_acceleration, self._body.max_angular_acceleration
        if time - self._last_command > COMMAND_TIMEOUT:
            target = Velocity()
            linear, angular = BRAKING_DECELERATION, BRAKING_DECELERATION / (TRACK / 2)
        if current != target:
            self._current = Velocity(
                current.linear + _clip(target.linear - current.linear, linear * period),
                current.angular + _clip(target.angular - current.angular, angular * period),
            )
        turn = self._current.angular * TRACK / 2
        return (self._current.linear - turn) / WHEEL_RADIUS, (self._current.linear + turn) / WHEEL_RADIUS


@dataclass(frozen=True, slots=True)
class WheelOdometryErrors:
    """Errors of the odometry.

    Attributes:
        scale: σ of the relative error of each wheel's radius, drawn once for each wheel.
        noise: σ of the relative error of the distance in each reading.
    """

    scale: float = 0.002
    noise: float = 0.03


class WheelOdometry:
    """Integrates the wheels' rotations to a pose, which drifts by the errors.

    Args:
        errors: Errors of the odometry.
        rng: Source of the errors.
    """

    def __init__(self, errors: WheelOdometryErrors, rng: np.random.Generator) -> None:
        self._noise = errors.noise
        self._scales = 1.0 + errors.scale * rng.standard_normal(2)
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
        left, right = WHEEL_RADIUS * turned * self._scales * (1.0 + self._noise * self._rng.standard_normal(2))
        forwards, turn = float(left + right) / 2, float(right - left) / TRACK
        self._pose = self._pose @ _arc(forwards, turn)
        return Odometry(time, self._pose, Velocity(forwards / period, turn / period))


def _arc(length: float, turn: float) -> Pose:
    """End of an arc that starts along the x axis, turns by ``turn``, rad, and is ``length``, m, long."""
    half = turn / 2
    chord = length * math.sin(half) / half if half else length
    return Pose(chord * math.cos(half), chord * math.sin(half), turn)


def _clip(value: float, limit: float) -> float:
    """The value clipped to [−limit, limit]."""
    return max(-limit, min(limit, value))
