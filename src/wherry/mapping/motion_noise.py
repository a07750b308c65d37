"""Noise of the motion between scans that odometry measures or that constant velocity predicts."""

from __future__ import annotations

import math
from dataclasses import dataclass

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


def is_within(motion: Pose, distance: float, angle: float) -> bool:
    """Whether a motion is shorter than a distance, m, and turns by less than an angle, rad."""
    return math.hypot(motion.x, motion.y) < distance and abs(motion.theta) < angle
