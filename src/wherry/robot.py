"""What a robot is to the rest of wherry: scans and odometry come in, velocities go out (paper, section 7).

The simulator and a ROS robot both are a `Robot`; mapping, localization and delivery never know which one they drive.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from wherry.space.pose import Pose


@dataclass(frozen=True, slots=True)
class Scan:
    """One turn of a 2D lidar (sensor_msgs/LaserScan).

    Attributes:
        time: s, on the robot's clock.
        ranges: [R] m, counter-clockwise; beam i looks along ``angle_min + i * angle_increment`` in the lidar's frame.
            ``inf`` is a beam that met nothing within ``range_max``; NaN and values outside the limits are no reading.
        angle_min: rad, direction of beam 0.
        angle_increment: rad, from one beam to the next.
        range_min: m, the shortest distance that is a reading.
        range_max: m, the longest distance that is a reading.
    """

    time: float
    ranges: NDArray[np.float64]
    angle_min: float
    angle_increment: float
    range_min: float
    range_max: float

    @property
    def angles(self) -> NDArray[np.float64]:
        """[R] rad, the beams' directions in the lidar's frame."""
        return self.angle_min + self.angle_increment * np.arange(len(self.ranges), dtype=np.float64)

    @property
    def valid(self) -> NDArray[np.bool_]:
        """[R] which beams met something."""
        return np.isfinite(self.ranges) & (self.ranges >= self.range_min) & (self.ranges <= self.range_max)

    def points(self) -> NDArray[np.float64]:
        """[V, 2] m, where the valid beams ended, in the lidar's frame."""
        valid = self.valid
        ranges, angles = self.ranges[valid], self.angles[valid]
        return np.column_stack([ranges * np.cos(angles), ranges * np.sin(angles)])


@dataclass(frozen=True, slots=True)
class Odometry:
    """Where the wheels say that the robot is (nav_msgs/Odometry).

    Attributes:
        time: s, on the robot's clock.
        pose: base_link in the odom frame; drifts without bound.
        velocity: As the wheels measured it.
    """

    time: float
    pose: Pose
    velocity: Velocity


@dataclass(frozen=True, slots=True)
class Velocity:
    """A command to a differential drive (geometry_msgs/Twist).

    Attributes:
        linear: v, m/s, forwards.
        angular: ω, rad/s, counter-clockwise.
    """

    linear: float = 0.0
    angular: float = 0.0


@dataclass(frozen=True, slots=True)
class Body:
    """What a robot knows of its own shape, in its base_link frame: the axle's middle, x forwards.

    Attributes:
        radius: m, of the circle around base_link that contains the robot and its load.
        lidar: The lidar's pose.
        box_radius: m, of the boxes that fit its fork. A box in the fork stands at base_link's origin.
        max_linear: m/s.
        max_angular: rad/s.
        max_linear_acceleration: m/s².
        max_angular_acceleration: rad/s².
    """

    radius: float
    lidar: Pose
    box_radius: float
    max_linear: float
    max_angular: float
    max_linear_acceleration: float
    max_angular_acceleration: float


class Robot(Protocol):
    """A differential-drive robot with a lidar and a fork whose latch holds a box."""

    @property
    def body(self) -> Body:
        """The robot's shape and limits."""
        ...

    def receive(self) -> Scan | Odometry:
        """Return the next measurement, waiting for it; times never decrease.

        Odometry comes at least as often as scans, and a scan follows the odometry of the same instant.
        """
        ...

    def command(self, velocity: Velocity) -> None:
        """Drive so until the next command; the robot stands still 0.5 s after the last one."""
        ...

    def close_latch(self) -> bool:
        """Close the fork's latch; return whether it holds a box now."""
        ...

    def open_latch(self) -> bool:
        """Ask to let go of the load; return whether the fork is free now.

        The latch is interlocked: it opens only over a warehouse's conveyor, so that no box is ever lost on the way.
        """
        ...
