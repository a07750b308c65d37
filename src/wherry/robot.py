"""The robot's interface: it provides scans and odometry and takes velocity commands (paper, section 7).

The simulator and a ROS robot both implement `Robot`; mapping, localization and delivery depend only on the protocol.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from wherry.space.pose import Floats, Pose, wrap, wrap_angles

BOX_HEIGHT = 0.30  # m, of a box to deliver
NO_RETURN_TOLERANCE = 0.01  # m below the longest range of a lidar, from which a reading is no return
LOAD_RADIUS_RATIO = 1.5  # `Body.load_radius` ÷ radius of a box; a box in the fork may be off-centre


@dataclass(frozen=True, slots=True)
class Scan:
    """A scan of a 2D lidar (sensor_msgs/LaserScan).

    Attributes:
        time: Time of the first beam that was measured, s, robot's clock.
        ranges: [R] ranges, m, counter-clockwise; beam i points along ``angles[i]`` in the lidar frame. ``inf`` means no
            return within ``range_max``; NaN and values outside the limits are invalid.
        angle_min: Direction of beam 0, rad, lidar frame.
        angle_increment: Angle from one beam to the next, rad.
        range_min: Shortest valid range, m.
        range_max: Longest valid range, m.
        time_increment: Time from one beam to the next, s; negative if the last beam was measured first, 0 if all were
            measured at once.
        beam_angles: [R] directions of the beams, rad, lidar frame, if they are not evenly spaced, as in a scan that was
            corrected for the robot's motion; otherwise None.
    """

    time: float
    ranges: NDArray[np.float64]
    angle_min: float
    angle_increment: float
    range_min: float
    range_max: float
    time_increment: float = 0.0
    beam_angles: NDArray[np.float64] | None = None

    @property
    def angles(self) -> NDArray[np.float64]:
        """[R] directions of the beams, rad, lidar frame."""
        if self.beam_angles is not None:
            return self.beam_angles
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

    @property
    def duration(self) -> float:
        """Time from the first beam that was measured to the last one, s."""
        return abs(self.time_increment) * (len(self.ranges) - 1)

    def mirrored(self) -> Scan:
        """The scan in the frame of the lidar turned upside down about its x axis: every direction changes its sign."""
        return replace(
            self,
            ranges=self.ranges[::-1].copy(),
            angle_min=-(self.angle_min + self.angle_increment * (len(self.ranges) - 1)),
            time_increment=-self.time_increment,
            beam_angles=None if self.beam_angles is None else -self.beam_angles[::-1],
        )

    def deskewed(self, lidar: Pose, motion: Pose) -> Scan:
        """The scan as if all beams had been measured at its time, from the lidar's pose at that time.

        The robot is taken to move steadily. Beams without a valid range only change their direction.

        Args:
            lidar: The lidar in the base_link frame.
            motion: base_link at the last beam that was measured, in its frame at the first one.
        """
        if self.time_increment == 0.0 or len(self.ranges) < 2:
            return self
        share = self.beam_times / self.duration
        return self.moved_back(lidar, share[:, None] * (motion.x, motion.y, wrap(motion.theta)))

    @property
    def beam_times(self) -> Floats:
        """[R] times at which the beams were measured, s since the first one."""
        order = np.arange(len(self.ranges), dtype=np.float64)
        return abs(self.time_increment) * (order if self.time_increment >= 0.0 else order[::-1])

    def moved_back(self, lidar: Pose, motions: Floats) -> Scan:
        """The scan as if all beams had been measured at its time, given the robot's motion up to each beam.

        Args:
            lidar: The lidar in the base_link frame.
            motions: base_link at each beam in its frame at the scan's time, [R, 3] m, m, rad.
        """
        turned = motions[:, 2]
        directions = self.angles + turned
        bearings = directions + lidar.theta
        cos, sin = np.cos(turned), np.sin(turned)
        # Displacement of the lidar since the scan's time, in the base_link frame of that time.
        shift_x = motions[:, 0] + cos * lidar.x - sin * lidar.y - lidar.x
        shift_y = motions[:, 1] + sin * lidar.x + cos * lidar.y - lidar.y
        valid = self.valid
        x = shift_x[valid] + self.ranges[valid] * np.cos(bearings[valid])
        y = shift_y[valid] + self.ranges[valid] * np.sin(bearings[valid])
        ranges = self.ranges.copy()
        ranges[valid] = np.clip(np.hypot(x, y), self.range_min, self.range_max)
        directions[valid] += wrap_angles(np.arctan2(y, x) - bearings[valid])
        return replace(self, ranges=ranges, time_increment=0.0, beam_angles=directions)


def mark_no_return(ranges: Floats, range_max: float) -> Floats:
    """Ranges, m, of any shape, with infinite ones where a beam met nothing, for which many lidars give range_max.

    Args:
        ranges: Ranges as sent, m.
        range_max: Longest range of the lidar, m; slightly smaller readings are infinite too, see `NO_RETURN_TOLERANCE`.
    """
    return np.where(ranges > range_max - NO_RETURN_TOLERANCE, np.inf, ranges)


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
