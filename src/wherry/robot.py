"""The robot's interface: it provides scans and odometry and takes velocity commands (paper, section 7).

The simulator and a ROS robot both implement `Robot`; mapping, localization and delivery depend only on the protocol.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from wherry.space.pose import Pose

BOX_HEIGHT = 0.30  # m, of a box to deliver
LOAD_RADIUS_RATIO = 1.5  # `Body.load_radius` ÷ radius of a box; a box in the fork may be off-centre


@dataclass(frozen=True, slots=True)
class Scan:
    """A scan of a 2D lidar (sensor_msgs/LaserScan).

    Attributes:
        time: Time of the scan, s, robot's clock.
        ranges: [R] ranges, m, counter-clockwise; beam i points along ``angle_min + i * angle_increment`` in the lidar
            frame. ``inf`` means no return within ``range_max``; NaN and values outside the limits are invalid.
        angle_min: Direction of beam 0, rad, lidar frame.
        angle_increment: Angle from one beam to the next, rad.
        range_min: Shortest valid range, m.
        range_max: Longest valid range, m.
    """

    time: float
    ranges: NDArray[np.float64]
    angle_min: float
    angle_increment: float
    range_min: float
    range_max: float

    @property
    def angles(self) -> NDArray[np.float64]:
        """[R] directions of the beams, rad, lidar frame."""
        return self.angle_min + self.angle_increment * np.arange(len(self.ranges), dtype=np.float64)

    @property
    def valid(self) -> NDArray[np.bool_]:
        """[R] True for beams with a return within the limits."""
        return np.isfinite(self.ranges) & (self.ranges >= self.range_min) & (self.ranges <= self.range_max)

    def points(self) -> NDArray[np.float64]:
        """[V, 2] end points of the valid beams, m, lidar frame."""
        valid = self.valid
        ranges, angles = self.ranges[valid], self.angles[valid]
        return np.column_stack([ranges * np.cos(angles), ranges * np.sin(angles)])


@dataclass(frozen=True, slots=True)
class Odometry:
    """Pose and velocity measured by the robot's wheel encoders (nav_msgs/Odometry).

    Attributes:
        time: Time of the measurement, s, robot's clock.
        pose: base_link in the odom frame; it drifts.
        velocity: Measured velocity.
    """

    time: float
    pose: Pose
    velocity: Velocity


@dataclass(frozen=True, slots=True)
class Velocity:
    """A velocity of a differential drive (geometry_msgs/Twist).

    Attributes:
        linear: Linear velocity v, m/s, positive forwards.
        angular: Angular velocity ω, rad/s, positive counter-clockwise.
    """

    linear: float = 0.0
    angular: float = 0.0


@dataclass(frozen=True, slots=True)
class Body:
    """The robot's shape and limits, in its base_link frame: origin in the middle of the axle, x forwards.

    Attributes:
        radius: Radius of the circle around base_link that contains the robot and its load, m.
        lidar: The lidar in the base_link frame.
        box_radius: Radius of the boxes that fit the fork, m; a box in the fork is centred on base_link.
        max_linear: Largest linear speed, m/s.
        max_angular: Largest angular speed, rad/s.
        max_linear_acceleration: Largest linear acceleration, m/s².
        max_angular_acceleration: Largest angular acceleration, rad/s².
    """

    radius: float
    lidar: Pose
    box_radius: float
    max_linear: float
    max_angular: float
    max_linear_acceleration: float
    max_angular_acceleration: float

    @property
    def load_radius(self) -> float:
        """Radius around base_link within which a lidar reading is attributed to a box in the fork, m."""
        return LOAD_RADIUS_RATIO * self.box_radius


class Robot(Protocol):
    """A differential-drive robot with a lidar and a fork whose latch holds a box."""

    @property
    def body(self) -> Body:
        """The robot's shape and limits."""
        ...

    def receive(self) -> Scan | Odometry:
        """Wait for the next measurement and return it; times never decrease.

        Odometry comes at least as often as scans; a scan comes after odometry of the same or a later time.
        """
        ...

    def command(self, velocity: Velocity) -> None:
        """Drive with a velocity until the next command; without one the robot stands still 0.5 s later."""
        ...

    def close_latch(self) -> bool:
        """Close the fork's latch; return whether it holds a box now."""
        ...

    def open_latch(self) -> bool:
        """Request to release the load; return whether the latch holds no box now.

        An interlock opens the latch only over a warehouse's conveyor, so that no box is dropped on the way.
        """
        ...
