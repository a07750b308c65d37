"""Where a robot is expected after it moved, and how surely: odometry, or steady motion where there is none."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from wherry.space.pose import Floats, Pose, wrap


@dataclass(frozen=True, slots=True)
class MotionNoise:
    """Standard deviations of a movement that was measured.

    Attributes:
        distance: m, whatever was moved.
        distance_per_distance: m per m.
        distance_per_angle: m per rad.
        angle: rad, whatever was moved.
        angle_per_angle: rad per rad.
        angle_per_distance: rad per m.
    """

    distance: float
    distance_per_distance: float
    distance_per_angle: float
    angle: float
    angle_per_angle: float
    angle_per_distance: float

    def deviations(self, movement: Pose) -> tuple[float, float]:
        """σ of the position, m, and of the heading, rad, after a movement."""
        way, turn = math.hypot(movement.x, movement.y), abs(wrap(movement.theta))
        return (
            math.hypot(self.distance, self.distance_per_distance * way, self.distance_per_angle * turn),
            math.hypot(self.angle, self.angle_per_angle * turn, self.angle_per_distance * way),
        )

    def covariance(self, movement: Pose) -> Floats:
        """[3, 3] of the pose after a movement, m, m, rad; the same in every frame's axes."""
        distance, angle = self.deviations(movement)
        return np.diag([distance**2, distance**2, angle**2])

    def information(self, movement: Pose) -> Floats:
        """[3, 3] inverse of `covariance`."""
        distance, angle = self.deviations(movement)
        return np.diag([distance**-2, distance**-2, angle**-2])


ODOMETRY = MotionNoise(0.03, 0.15, 0.05, math.radians(1.5), 0.15, math.radians(4.0))
STEADY_MOTION = MotionNoise(0.1, 0.4, 0.1, math.radians(5.0), 0.5, math.radians(10.0))


def is_within(movement: Pose, distance: float, angle: float) -> bool:
    """Whether a movement is shorter than a distance, m, and turns by less than an angle, rad."""
    return math.hypot(movement.x, movement.y) < distance and abs(movement.theta) < angle
