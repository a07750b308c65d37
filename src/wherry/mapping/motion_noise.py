"""Noise of the motion between scans that odometry measures or that constant velocity predicts."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from wherry.space.pose import Floats, Pose, wrap


@dataclass(frozen=True, slots=True)
class MotionNoise:
    """Standard deviations of a motion; the terms are added in quadrature.

    Attributes:
        distance: Standard deviation of the position without any motion, m.
        distance_per_distance: Standard deviation of the position per distance, m/m.
        distance_per_angle: Standard deviation of the position per angle turned, m/rad.
        angle: Standard deviation of the heading without any motion, rad.
        angle_per_angle: Standard deviation of the heading per angle turned, rad/rad.
        angle_per_distance: Standard deviation of the heading per distance, rad/m.
    """

    distance: float
    distance_per_distance: float
    distance_per_angle: float
    angle: float
    angle_per_angle: float
    angle_per_distance: float

    def deviations(self, motion: Pose) -> tuple[float, float]:
        """Standard deviations of the position, m, and of the heading, rad, after a motion."""
        distance, turn = math.hypot(motion.x, motion.y), abs(wrap(motion.theta))
        return (
            math.hypot(self.distance, self.distance_per_distance * distance, self.distance_per_angle * turn),
            math.hypot(self.angle, self.angle_per_angle * turn, self.angle_per_distance * distance),
        )

    def covariance(self, motion: Pose) -> Floats:
        """Covariance of the pose after a motion, [3, 3] m, m, rad; isotropic, so the same in every frame."""
        distance, angle = self.deviations(motion)
        return np.diag([distance**2, distance**2, angle**2])

    def information(self, motion: Pose) -> Floats:
        """Information of the pose after a motion, [3, 3] m, m, rad: the inverse of `covariance`."""
        distance, angle = self.deviations(motion)
        return np.diag([distance**-2, distance**-2, angle**-2])


ODOMETRY_NOISE = MotionNoise(
    distance=0.03,
    distance_per_distance=0.15,
    distance_per_angle=0.05,
    angle=math.radians(1.5),
    angle_per_angle=0.15,
    angle_per_distance=math.radians(4.0),
)
CONSTANT_VELOCITY_NOISE = MotionNoise(
    distance=0.1,
    distance_per_distance=0.4,
    distance_per_angle=0.1,
    angle=math.radians(5.0),
    angle_per_angle=0.5,
    angle_per_distance=math.radians(10.0),
)

# What a robot's velocity may change by between scans, and bounds of what follows for the predicted motion.
LINEAR_ACCELERATION, ANGULAR_ACCELERATION = 0.5, 1.0  # m/s² and rad/s², standard deviations
MAX_VELOCITY_SIGMA, MAX_VELOCITY_ANGLE_SIGMA = 0.67, math.radians(30.0)  # m and rad; searches reach 3 times as far


def constant_velocity_noise(elapsed: float) -> MotionNoise:
    """Noise of a motion at constant velocity over a time, s: the longer it is, the less the last velocity tells."""
    half_squared = 0.5 * elapsed * elapsed
    noise = CONSTANT_VELOCITY_NOISE
    return replace(
        noise,
        distance=math.hypot(noise.distance, min(LINEAR_ACCELERATION * half_squared, MAX_VELOCITY_SIGMA)),
        angle=math.hypot(noise.angle, min(ANGULAR_ACCELERATION * half_squared, MAX_VELOCITY_ANGLE_SIGMA)),
    )


def is_within(motion: Pose, distance: float, angle: float) -> bool:
    """Whether a motion is shorter than a distance, m, and turns by less than an angle, rad."""
    return math.hypot(motion.x, motion.y) < distance and abs(motion.theta) < angle
