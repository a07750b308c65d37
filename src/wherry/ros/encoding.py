"""Encodes measurements, commands, poses, paths and maps as ROS messages; the inverse of `wherry.ros.decoding`.

Units and axes follow REP 103, frames REP 105, and the ranges of a scan REP 117.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wherry.robot import Odometry, Scan, Velocity
from wherry.ros import messages as ros
from wherry.ros.transforms import StampedTransform
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose

NANOSECONDS = 1_000_000_000  # per second
OCCUPIED, FREE, UNKNOWN_CELL = 100, 0, -1  # cell values of nav_msgs/OccupancyGrid, as map_server writes them


def encode_stamp(seconds: float) -> ros.Time:
    """A time in s as a stamp, rounded to nanoseconds."""
    whole = round(seconds * NANOSECONDS)
    return ros.Time(whole // NANOSECONDS, whole % NANOSECONDS)


def encode_header(seconds: float, frame: str) -> ros.Header:
    """A header with a time, s, and a frame."""
    return ros.Header(encode_stamp(seconds), frame)


def encode_quaternion(heading: float) -> ros.Quaternion:
    """A rotation about the z axis, rad."""
    return ros.Quaternion(0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2))


def encode_pose(pose: Pose, z: float = 0.0) -> ros.Pose:
    """A planar pose at height z, m."""
    return ros.Pose(ros.Point(pose.x, pose.y, z), encode_quaternion(pose.theta))


def encode_transform(transform: StampedTransform, z: float = 0.0) -> ros.TransformStamped:
    """A transform whose child frame is z m above its parent frame."""
    pose = transform.pose
    message = ros.Transform(ros.Vector3(pose.x, pose.y, z), encode_quaternion(pose.theta))
    return ros.TransformStamped(encode_header(transform.time, transform.parent), transform.child, message)


def encode_path(points: NDArray[np.floating], seconds: float, frame: str) -> ros.Path:
    """Points [M, 2], m, as a path; each pose is oriented towards the next point."""
    header = encode_header(seconds, frame)
    steps = np.diff(points, axis=0, append=points[-1:])
    headings = np.arctan2(steps[:, 1], steps[:, 0])
    headings[-1:] = headings[-2:-1] if len(points) > 1 else 0.0
    poses = [Pose(float(x), float(y), float(theta)) for (x, y), theta in zip(points, headings, strict=True)]
    return ros.Path(header, tuple(ros.PoseStamped(header, encode_pose(pose)) for pose in poses))


def encode_pose_array(particles: NDArray[np.floating], seconds: float, frame: str) -> ros.PoseArray:
    """Particles [N, 3], x m, y m, θ rad, as poses."""
    poses = tuple(encode_pose(Pose(x, y, theta)) for x, y, theta in particles.tolist())
    return ros.PoseArray(encode_header(seconds, frame), poses)


def encode_laser_scan(scan: Scan, frame: str, period: float = 0.0) -> ros.LaserScan:
    """A scan in the frame of its lidar; a scan whose last beam was measured first is one of a clockwise lidar.

    Args:
        scan: The scan, with evenly spaced beams.
        frame: Frame of the lidar.
        period: Time of one revolution, s; 0 if all beams are measured at once.

    Raises:
        ValueError: The beams of the scan are not evenly spaced.
    """
    if scan.beam_angles is not None:
        raise ValueError("a scan that was corrected for motion has no message")
    first, last = scan.angle_min, scan.angle_min + scan.angle_increment * (len(scan.ranges) - 1)
    increment, ranges = scan.angle_increment, scan.ranges
    if scan.time_increment < 0.0:
        first, last, increment, ranges = last, first, -increment, ranges[::-1]
    return ros.LaserScan(
        header=encode_header(scan.time, frame),
        angle_min=first,
        angle_max=last,
        angle_increment=increment,
        time_increment=abs(scan.time_increment),
        scan_time=period,
        range_min=scan.range_min,
        range_max=scan.range_max,
        ranges=ranges.astype(np.float32),
    )


def encode_odometry(odometry: Odometry, frame: str, child: str, covariance: Floats) -> ros.Odometry:
    """Odometry of frame ``child`` in ``frame``; the covariance [36] is used for both pose and velocity."""
    return ros.Odometry(
        encode_header(odometry.time, frame),
        child,
        ros.PoseWithCovariance(encode_pose(odometry.pose), covariance),
        ros.TwistWithCovariance(encode_twist(odometry.velocity), covariance),
    )


def encode_twist(velocity: Velocity) -> ros.Twist:
    """The velocity of a differential drive."""
    return ros.Twist(ros.Vector3(velocity.linear), ros.Vector3(z=velocity.angular))


def encode_occupancy_grid(grid: OccupancyGrid, seconds: float, frame: str) -> ros.OccupancyGrid:
    """A map of occupied, free and unknown cells, as map_server publishes it."""
    height, width = grid.shape
    data = np.full(grid.shape, UNKNOWN_CELL, np.int8)
    data[grid.free] = FREE
    data[grid.occupied] = OCCUPIED
    info = ros.MapMetaData(encode_stamp(seconds), grid.resolution, width, height, encode_pose(grid.origin))
    return ros.OccupancyGrid(encode_header(seconds, frame), info, data.ravel())
