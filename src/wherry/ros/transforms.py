"""Transforms between the frames of a robot, in the plane and in space, and the lidar's mount."""

from __future__ import annotations

import math
from dataclasses import dataclass

from wherry.robot import Scan
from wherry.space.pose import IDENTITY, Pose

MAX_MOUNT_TILT = 0.12  # rad, between the z axes of the lidar and base_link, or their opposites

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


class MountError(ValueError):
    """A mount that cannot be used; the text is a clause such as "the transform a → b moves"."""


@dataclass(frozen=True, slots=True)
class StampedTransform:
    """One edge of the tf tree, in the plane.

    Attributes:
        parent: Name of the parent frame, without a leading slash.
        child: Name of the child frame, without a leading slash.
        time: Time from which the transform holds, s.
        pose: Pose of the child frame in the parent frame.
    """

    parent: str
    child: str
    time: float
    pose: Pose


@dataclass(frozen=True, slots=True)
class RigidTransform:
    """A rotation and a translation in space, SE(3).

    Attributes:
        translation: x, y, z of the child frame in the parent frame, m.
        rotation: Unit quaternion x, y, z, w of the child frame in the parent frame.
    """

    translation: Vector = (0.0, 0.0, 0.0)
    rotation: Quaternion = (0.0, 0.0, 0.0, 1.0)

    def __matmul__(self, other: RigidTransform) -> RigidTransform:
        """Compose: ``a_from_b @ b_from_c`` is ``a_from_c``."""
        (x, y, z), (dx, dy, dz) = self.rotate(other.translation), self.translation
        return RigidTransform((x + dx, y + dy, z + dz), _product(self.rotation, other.rotation))

    @property
    def inverse(self) -> RigidTransform:
        """The inverse transform."""
        x, y, z, w = self.rotation
        back = RigidTransform(rotation=(-x, -y, -z, w))
        tx, ty, tz = back.rotate(self.translation)
        return RigidTransform((-tx, -ty, -tz), back.rotation)

    def rotate(self, vector: Vector) -> Vector:
        """A vector of the child frame in the axes of the parent frame."""
        x, y, z, w = self.rotation
        turned = _product(_product(self.rotation, (*vector, 0.0)), (-x, -y, -z, w))
        return turned[:3]

    @property
    def heading(self) -> float:
        """Direction of the child frame's x axis in the x-y plane of the parent frame, rad."""
        x, y, z, w = self.rotation
        return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))

    @property
    def tilt(self) -> float:
        """Angle between the z axes of the child and the parent frame, 0 to π rad."""
        x, y, _, _ = self.rotation
        return math.acos(min(max(1.0 - 2.0 * (x * x + y * y), -1.0), 1.0))

    def difference(self, other: RigidTransform) -> tuple[float, float]:
        """Distance in the x-y plane, m, and angle, rad, between two transforms."""
        shift = math.hypot(self.translation[0] - other.translation[0], self.translation[1] - other.translation[1])
        x, y, z, w = self.rotation
        turn = _product((-x, -y, -z, w), other.rotation)
        return shift, 2.0 * math.atan2(math.hypot(*turn[:3]), abs(turn[3]))


def _product(a: Quaternion, b: Quaternion) -> Quaternion:
    """The Hamilton product of two quaternions x, y, z, w."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


@dataclass(frozen=True, slots=True)
class Mount:
    """How a lidar sits on the robot.

    Attributes:
        pose: The lidar in the base_link frame; of a lidar upside down, its frame turned upright about its x axis.
        is_upside_down: Whether the lidar hangs upside down, so that its beams turn the other way.
    """

    pose: Pose = IDENTITY
    is_upside_down: bool = False

    @classmethod
    def from_transform(cls, transform: RigidTransform) -> Mount:
        """The mount of a lidar at a transform from base_link.

        Raises:
            MountError: The lidar is tilted.
        """
        tilt = transform.tilt
        if min(tilt, math.pi - tilt) > MAX_MOUNT_TILT:
            raise MountError(f"it is tilted by {math.degrees(tilt):.0f}°, and only a level scan can be used")
        x, y, _ = transform.translation
        return cls(Pose(x, y, transform.heading), is_upside_down=tilt > math.pi / 2.0)

    def upright(self, scan: Scan) -> Scan:
        """A scan as a lidar upright at ``pose`` measures it."""
        return scan.mirrored() if self.is_upside_down else scan

    def __str__(self) -> str:
        """x, y, θ as the option ``--lidar`` takes them, m, m, degrees."""
        numbers = f"{self.pose.x:.3f},{self.pose.y:.3f},{math.degrees(self.pose.theta):.1f}"
        return f"{numbers} upside down" if self.is_upside_down else numbers
