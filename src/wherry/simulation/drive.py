"""The drive: velocity commands become wheel speeds, and the wheels' turns become odometry."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from wherry.robot import Body, Odometry, Velocity
from wherry.space.pose import Floats, Pose

WHEEL_RADIUS = 0.05  # m
TRACK = 0.32  # m, between the wheels
SILENCE = 0.35  # s without a command before the drive brakes; it stands within 0.5 s
BRAKING = 5.0  # m/s² and, times 1 / half the track, rad/s²: how hard it brakes then


class Drive:
    """Turns velocity commands into wheel speeds, within the robot's limits of speed and acceleration.

    Args:
        body: The limits.
    """

    def __init__(self, body: Body) -> None:
        self._body = body
        self._target = Velocity()
        self._current = Velocity()
        self._commanded = -math.inf

    def command(self, velocity: Velocity, time: float) -> None:
        """Follow a velocity from now on; what is above the limits is cut off.

        Raises:
            ValueError: A component is not a finite number.
        """
        if not (math.isfinite(velocity.linear) and math.isfinite(velocity.angular)):
            raise ValueError(f"a velocity must be finite, not {velocity}")
        linear, angular = self._body.max_linear, self._body.max_angular
        self._target = Velocity(_clip(velocity.linear, linear), _clip(velocity.angular, angular))
        self._commanded = time

    def wheel_speeds(self, time: float, period: float) -> tuple[float, float]:
        """Left and right wheel, rad/s, for the next ``period`` seconds."""
        target, current = self._target, self._current
        linear, angular = self._body.max_linear_acceleration, self._body.max_angular_acceleration
        if time - self._commanded > SILENCE:
            target = Velocity()
            linear, angular = BRAKING, BRAKING / (TRACK / 2)
        if current != target:
            self._current = Velocity(
                current.linear + _clip(target.linear - current.linear, linear * period),
                current.angular + _clip(target.angular - current.angular, angular * period),
            )
        turn = self._current.angular * TRACK / 2
        return (self._current.linear - turn) / WHEEL_RADIUS, (self._current.linear + turn) / WHEEL_RADIUS


@dataclass(frozen=True, slots=True)
class EncoderErrors:
    """How wrong the wheels' encoders are.

    Attributes:
        scale: σ of the share by which a wheel's radius differs from what the robot believes, drawn once for each wheel.
        noise: σ of the share by which each reading's distance is wrong.
    """

    scale: float = 0.002
    noise: float = 0.03


class Encoders:
    """Measures how far the wheels turn and adds it up to odometry, which therefore drifts.

    Args:
        errors: How wrong they are.
        rng: Where the errors come from.
    """

    def __init__(self, errors: EncoderErrors, rng: np.random.Generator) -> None:
        self._noise = errors.noise
        self._scales = 1.0 + errors.scale * rng.standard_normal(2)
        self._rng = rng
        self._angles: Floats | None = None
        self._pose = Pose()

    def read(self, time: float, angles: Floats, period: float) -> Odometry:
        """Add up what the wheels turned since the last reading, along an arc.

        Args:
            time: s.
            angles: [2] rad, of the left and the right wheel.
            period: s, since the last reading.
        """
        turned = np.zeros(2) if self._angles is None else angles - self._angles
        self._angles = angles.copy()
        left, right = WHEEL_RADIUS * turned * self._scales * (1.0 + self._noise * self._rng.standard_normal(2))
        forwards, turn = float(left + right) / 2, float(right - left) / TRACK
        self._pose = self._pose @ _arc(forwards, turn)
        return Odometry(time, self._pose, Velocity(forwards / period, turn / period))


def _arc(length: float, turn: float) -> Pose:
    """Where an arc ends that begins along the x axis, turns by ``turn`` rad and is ``length`` m long."""
    half = turn / 2
    chord = length * math.sin(half) / half if half else length
    return Pose(chord * math.cos(half), chord * math.sin(half), turn)


def _clip(value: float, limit: float) -> float:
    """The value in [−limit, limit] that is nearest."""
    return max(-limit, min(limit, value))
