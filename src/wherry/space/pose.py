"""Poses in the plane, SE(2): composition, inversion and transformation of points.

Every frame follows REP 103: x forward, y to the left, angles counter-clockwise from the x axis, metres and radians.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MAX_COORDINATE = 1e9  # m and rad, largest absolute value in a pose that a file states


def wrap(angle: float) -> float:
    """The equivalent angle in (−π, π], rad."""
    wrapped = math.remainder(angle, math.tau)
    return math.pi if wrapped == -math.pi else wrapped


@dataclass(frozen=True, slots=True)
class Pose:
    """A position and a heading; equally the rigid transform from the frame at that pose to the frame it is given in.

    Attributes:
        x: Position along the frame's x axis, m.
        y: Position along the frame's y axis, m.
        theta: Heading θ counter-clockwise from the frame's x axis, rad.
    """

    x: float = 0.0
    y: float = 0.0
    theta: float = 0.0

    def __matmul__(self, other: Pose) -> Pose:
        """Compose: ``map_from_odom @ odom_from_base`` is ``map_from_base`` (⊕ in the SLAM literature)."""
        cos, sin = math.cos(self.theta), math.sin(self.theta)
        return Pose(
            self.x + cos * other.x - sin * other.y,
            self.y + sin * other.x + cos * other.y,
            wrap(self.theta + other.theta),
        )

    @property
    def inverse(self) -> Pose:
        """The inverse transform: ``p @ p.inverse`` is the identity (⊖)."""
        cos, sin = math.cos(self.theta), math.sin(self.theta)
        return Pose(-cos * self.x - sin * self.y, sin * self.x - cos * self.y, wrap(-self.theta))

    def relative_to(self, origin: Pose) -> Pose:
        """This pose in the frame of ``origin``: ``origin.inverse @ self``."""
        return origin.inverse @ self

    def transform(self, points: NDArray[np.floating[Any]]) -> Floats:
        """Transform points from the frame at this pose to the frame that the pose is given in.

        Args:
            points: Points in the frame at this pose, [N, 2] m.

        Returns:
            The points in the frame that the pose is given in, [N, 2] m.
        """
        cos, sin = math.cos(self.theta), math.sin(self.theta)
        rotation = np.array([[cos, sin], [-sin, cos]])
        moved: Floats = points @ rotation + (self.x, self.y)
        return moved

    def distance_to(self, other: Pose) -> float:
        """Distance between the positions, m."""
        return math.hypot(other.x - self.x, other.y - self.y)

    def is_near(self, other: Pose, distance: float, angle: float) -> bool:
        """Whether the poses differ by less than a distance, m, and less than an angle, rad."""
        return self.distance_to(other) < distance and abs(wrap(self.theta - other.theta)) < angle

    def as_array(self) -> Floats:
        """x, y and θ, [3] m, m, rad."""
        return np.array([self.x, self.y, self.theta])

    @classmethod
    def from_array(cls, array: Floats) -> Self:
        """The pose of x, y and θ, [3] m, m, rad; θ is wrapped."""
        return cls(float(array[0]), float(array[1]), wrap(float(array[2])))


IDENTITY = Pose()


def compose(first: Floats, second: Floats) -> Floats:
    """``first @ second`` of many poses, [N, 3] m, m, rad; headings are wrapped into [−π, π]."""
    cos, sin = np.cos(first[..., 2]), np.sin(first[..., 2])
    x = first[..., 0] + cos * second[..., 0] - sin * second[..., 1]
    y = first[..., 1] + sin * second[..., 0] + cos * second[..., 1]
    return np.stack([x, y, _wrapped(first[..., 2] + second[..., 2])], axis=-1)


def relative(poses: Floats, origins: Floats) -> Floats:
    """``origins.inverse @ poses`` of many poses, [N, 3] m, m, rad; headings are wrapped into [−π, π]."""
    cos, sin = np.cos(origins[..., 2]), np.sin(origins[..., 2])
    dx, dy = poses[..., 0] - origins[..., 0], poses[..., 1] - origins[..., 1]
    turned = _wrapped(poses[..., 2] - origins[..., 2])
    return np.stack([cos * dx + sin * dy, -sin * dx + cos * dy, turned], axis=-1)


def wrap_angles(angles: Floats) -> Floats:
    """The equivalent angles in [−π, π), rad, of an array of any shape; accurate to the rounding error of π."""
    wrapped: Floats = np.remainder(angles + math.pi, math.tau) - math.pi
    return wrapped


def _wrapped(angles: Floats) -> Floats:
    """The equivalent angles in [−π, π], rad; unlike `wrap_angles` it keeps angles within the range exactly."""
    wrapped: Floats = angles - math.tau * np.round(angles / math.tau)
    return wrapped
