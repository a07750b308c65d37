"""Decodes and validates ROS messages, those of live ROS and those in bags.

Messages are typed by protocols (`wherry.ros.message_protocols`), which wherry's own classes and those of rosbags
satisfy. A message that cannot be used raises `MessageError`; no default replaces an invalid value. Units and axes
follow REP 103, frames REP 105, and the ranges of a scan REP 117.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from wherry.logs.lidar_log import MAX_BEAMS
from wherry.robot import Odometry, Scan, Velocity
from wherry.ros.encoding import NANOSECONDS, OCCUPIED, UNKNOWN_CELL
from wherry.ros.message_protocols import (
    LaserScanLike,
    OccupancyGridLike,
    OdometryLike,
    PoseLike,
    PoseWithCovarianceStampedLike,
    QuaternionLike,
    TFMessageLike,
    TimeLike,
    TransformStampedLike,
    TwistLike,
)
from wherry.ros.transforms import StampedTransform
from wherry.space.map_files import MAX_CELLS
from wherry.space.occupancy import UNKNOWN, OccupancyGrid
from wherry.space.pose import Pose

MAX_COORDINATE = 1e6  # m, absolute value
MAX_SPEED = 100.0  # m/s and rad/s, absolute value
MAX_RANGE = 1000.0  # m, of a lidar
MAX_START_ANGLE = 2 * math.tau  # rad, absolute value of angle_min
MAX_TILT = 0.2  # rad, between the z axes of a frame and its parent
QUATERNION_TOLERANCE = 0.01  # deviation of a quaternion's norm from 1
MIN_CELL_SIZE, MAX_CELL_SIZE = 0.001, 10.0  # m


class MessageError(ValueError):
    """A message that cannot be used; the text is a predicate such as "has 0 beams", to follow the message's name."""


def decode_stamp(stamp: TimeLike) -> float:
    """A time stamp in s.

    Raises:
        MessageError: It is negative, or its nanoseconds are not less than a second.
    """
    if stamp.sec < 0 or not 0 <= stamp.nanosec < NANOSECONDS:
        raise MessageError(f"has the impossible stamp {stamp.sec} s {stamp.nanosec} ns")
    return (int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)) / NANOSECONDS


def check_frame(found: str, expected: str | None) -> None:
    """Check a frame's name, ignoring the leading slash that old ROS 1 nodes write; None accepts any frame.

    Raises:
        MessageError: It is another frame.
    """
    if expected is not None and found.lstrip("/") != expected.lstrip("/"):
        raise MessageError(f"is in the frame {found!r} instead of {expected!r}")


# ---- poses and transforms


def decode_pose(message: PoseLike) -> Pose:
    """The pose in the plane; height, roll and pitch are dropped.

    Raises:
        MessageError: A coordinate is not finite or out of bounds, or the orientation is not a unit quaternion.
    """
    x, y = _coordinate(message.position.x), _coordinate(message.position.y)
    return Pose(x, y, _heading(message.orientation))


def _heading(quaternion: QuaternionLike) -> float:
    """The rotation about the z axis, rad.

    Raises:
        MessageError: It is not a unit quaternion. A zero quaternion, which some drivers send, is not decoded as 0 rad.
    """
    x, y, z, w = quaternion.x, quaternion.y, quaternion.z, quaternion.w
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    if not abs(norm - 1.0) < QUATERNION_TOLERANCE:  # also NaN
        raise MessageError(f"has the orientation ({x:g}, {y:g}, {z:g}, {w:g}), which is not a unit quaternion")
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def _coordinate(value: float) -> float:
    if not abs(value) <= MAX_COORDINATE:  # also NaN
        raise MessageError(f"has the coordinate {value}")
    return value


def decode_transform(message: TransformStampedLike) -> StampedTransform:
    """The transform in the plane; the height is dropped.

    Raises:
        MessageError: The stamp or a coordinate is impossible, the rotation is not a unit quaternion, or it tilts the
            child frame.
    """
    parent, child = frames_of(message)
    rotation, translation = message.transform.rotation, message.transform.translation
    heading = _heading(rotation)
    tilt = math.acos(min(max(1.0 - 2.0 * (rotation.x**2 + rotation.y**2), -1.0), 1.0))
    if tilt > MAX_TILT:
        degrees = math.degrees(tilt)
        raise MessageError(f"tilts the frame {child!r} by {degrees:.0f}°; only upright mounts are supported")
    pose = Pose(_coordinate(translation.x), _coordinate(translation.y), heading)
    return StampedTransform(parent, child, decode_stamp(message.header.stamp), pose)


def transforms_between(message: TFMessageLike, parent: str, child: str) -> Iterator[StampedTransform]:
    """The transforms from one frame to another in a message; those of other frames are not checked.

    Raises:
        MessageError: As `decode_transform`.
    """
    for transform in message.transforms:
        if frames_of(transform) == (parent, child):
            yield decode_transform(transform)


def frames_of(message: TransformStampedLike) -> tuple[str, str]:
    """Names of the parent and the child frame, without leading slashes."""
    return message.header.frame_id.lstrip("/"), message.child_frame_id.lstrip("/")


def decode_pose_estimate(message: PoseWithCovarianceStampedLike, frame: str) -> tuple[float, Pose]:
    """The time, s, and the pose of an estimate such as amcl's.

    Raises:
        MessageError: It is in another frame, or as `decode_pose` and `decode_stamp`.
    """
    check_frame(message.header.frame_id, frame)
    return decode_stamp(message.header.stamp), decode_pose(message.pose.pose)


# ---- measurements and commands


def decode_laser_scan(message: LaserScanLike, frame: str | None = None) -> Scan:
    """A scan with counter-clockwise beams.

    The beams of a clockwise lidar (negative increment) are reversed. As in REP 117, −inf is an obstacle closer than
    ``range_min``, and becomes ``range_min``, the safe side; anything beyond ``range_max`` becomes inf, no return.

    Args:
        message: The message.
        frame: Frame that it must be in; None accepts any.

    Raises:
        MessageError: It is in another frame, has no beams or too many, or impossible angles or limits.
    """
    check_frame(message.header.frame_id, frame)
    _check_beams(message)
    time = decode_stamp(message.header.stamp)
    ranges = message.ranges.astype(np.float64)
    ranges[ranges > message.range_max] = np.inf
    ranges[ranges == -np.inf] = message.range_min
    first, increment = message.angle_min, message.angle_increment
    if increment < 0.0:  # clockwise
        first, increment, ranges = first + increment * (len(ranges) - 1), -increment, ranges[::-1].copy()
    return Scan(time, ranges, first, increment, message.range_min, message.range_max)


def _check_beams(message: LaserScanLike) -> None:
    """Check the number of beams, their angles and the limits of their ranges."""
    start, increment, beams = message.angle_min, message.angle_increment, len(message.ranges)
    if not all(map(math.isfinite, (start, increment, message.range_min, message.range_max))):
        raise MessageError("has an angle or a range limit that is not finite")
    if not 1 <= beams <= MAX_BEAMS:
        raise MessageError(f"has {beams} beams; 1 to {MAX_BEAMS:,} are possible")
    if not 0.0 <= message.range_min < message.range_max <= MAX_RANGE:
        raise MessageError(f"has ranges from {message.range_min:g} to {message.range_max:g} m")
    span = abs(increment) * (beams - 1)
    if abs(start) > MAX_START_ANGLE or increment == 0.0 or span >= math.tau + abs(increment):
        raise MessageError(f"has {beams} beams from {start:g} rad on, {increment:g} rad apart")


def decode_odometry(message: OdometryLike, frame: str | None = None, child: str | None = None) -> Odometry:
    """The pose and velocity of the robot by odometry.

    Args:
        message: The message.
        frame: Frame that the pose must be in; None accepts any.
        child: Frame that must be tracked; None accepts any.

    Raises:
        MessageError: It is of other frames, or as `decode_stamp`, `decode_pose` and `decode_twist`.
    """
    check_frame(message.header.frame_id, frame)
    check_frame(message.child_frame_id, child)
    pose = decode_pose(message.pose.pose)
    return Odometry(decode_stamp(message.header.stamp), pose, decode_twist(message.twist.twist))


def decode_twist(message: TwistLike) -> Velocity:
    """The velocity of a differential drive; components that it cannot have (sideways, up) are dropped.

    Raises:
        MessageError: A component is not finite or out of bounds.
    """
    for value in (message.linear.x, message.linear.y, message.angular.z):
        if not abs(value) <= MAX_SPEED:  # also NaN
            raise MessageError(f"has the speed {value}")
    return Velocity(message.linear.x, message.angular.z)


# ---- maps


def decode_occupancy_grid(message: OccupancyGridLike, frame: str, *, margin: float = math.inf) -> OccupancyGrid:
    """The map, with its unknown border cropped.

    Args:
        message: The message.
        frame: Frame that it must be in.
        margin: Width of the border of unknown cells kept around the known ones, m; the rest is cropped. gmapping's maps
            are 200 m wide from the first one on.

    Raises:
        MessageError: It is in another frame, empty, too large, of another size than declared, or has values outside
            −1 to 100.
    """
    check_frame(message.header.frame_id, frame)
    _check_cells(message)
    info = message.info
    resolution = round(info.resolution, 6)
    data = message.data.reshape(info.height, info.width)
    rows, columns = _known_part(data, margin / resolution)
    values = data[rows, columns].astype(np.float32)
    probability = np.where(values == UNKNOWN_CELL, np.float32(UNKNOWN), values / np.float32(OCCUPIED))
    corner = Pose(columns.start * resolution, rows.start * resolution)
    return OccupancyGrid(probability, resolution, decode_pose(info.origin) @ corner)


def _check_cells(message: OccupancyGridLike) -> None:
    """Check the size of a map's cells, their number and their values."""
    info, data = message.info, message.data
    if not MIN_CELL_SIZE <= info.resolution <= MAX_CELL_SIZE:  # also NaN
        raise MessageError(f"has cells of {info.resolution} m")
    if not 0 < info.width * info.height <= MAX_CELLS:
        raise MessageError(f"has {info.width} × {info.height} cells; 1 to {MAX_CELLS:,} are possible")
    if len(data) != info.width * info.height:
        raise MessageError(f"has {len(data)} values for {info.width} × {info.height} cells")
    if data.min() < UNKNOWN_CELL or data.max() > OCCUPIED:
        raise MessageError("has values that are neither −1 nor a percentage")


def _known_part(data: NDArray[np.int8], margin: float) -> tuple[slice, slice]:
    """Rows and columns of a map [H, W] that hold known cells, plus a margin, cells; everything if none is known."""
    known = data != UNKNOWN_CELL
    return _known_range(known.any(axis=1), margin), _known_range(known.any(axis=0), margin)


def _known_range(known: NDArray[np.bool_], margin: float) -> slice:
    """From the first to the last True, plus a margin on either side."""
    indices = np.flatnonzero(known)
    if not len(indices):
        return slice(0, len(known))
    first, last = max(indices[0] - margin, 0), min(indices[-1] + margin, len(known) - 1)
    return slice(math.floor(first), math.ceil(last) + 1)
