"""Decodes and validates ROS messages, those of live ROS and those in bags.

Messages are typed by protocols (`wherry.ros.message_protocols`), which wherry's own classes and those of rosbags
satisfy. A message that cannot be used raises `MessageError`; no default replaces an invalid value. Units and axes
follow REP 103, frames REP 105, and the ranges of a scan REP 117.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from wherry.logs.lidar_log import MAX_BEAMS, MAX_RANGE
from wherry.robot import Odometry, Scan, Velocity, mark_no_return
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
from wherry.ros.transforms import RigidTransform, StampedTransform
from wherry.space.map_files import MAX_CELLS
from wherry.space.occupancy import UNKNOWN, OccupancyGrid
from wherry.space.pose import Pose, wrap

MAX_COORDINATE = 1e6  # m, absolute value
MAX_SPEED = 100.0  # m/s and rad/s, absolute value
MAX_TILT = 0.2  # rad, between the z axes of a frame and its parent
QUATERNION_TOLERANCE = 0.01  # deviation of a quaternion's norm from 1
MIN_CELL_SIZE, MAX_CELL_SIZE = 0.001, 10.0  # m
MAX_RANGE_MIN = 10.0  # m, range_min of a lidar; a larger one is stated in mm
MAX_START_ANGLE = 2 * math.tau  # rad, absolute value of angle_min
MAX_REVOLUTION = 1.03  # revolutions of a scan; lidars whose number of beams varies measure a few beams twice
MAX_BEAMS_OFF = 2.5  # beams by which angle_max may disagree with angle_increment; drivers count one too many or too few
MAX_SHARE_OFF = 0.03  # share of the beams by which it may disagree where the number of beams varies

NO_RANGE_MAX = "range_max is not stated, so no reading is known to be a missing return by it"
INCREMENT_REPLACED = "angle_increment is impossible and was computed from angle_min and angle_max"
ANGLE_MAX_IGNORED = "angle_max disagrees with angle_increment by a few beams; angle_increment is used"
TIMES_IGNORED = "time_increment is impossible, so the scans are not corrected for motion"


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
    return Pose(x, y, RigidTransform(rotation=_unit_quaternion(message.orientation)).heading)


def _unit_quaternion(quaternion: QuaternionLike) -> tuple[float, float, float, float]:
    """x, y, z, w, normalized.

    Raises:
        MessageError: It is not a unit quaternion. A zero quaternion, which some drivers send, is not decoded as 0 rad.
    """
    x, y, z, w = quaternion.x, quaternion.y, quaternion.z, quaternion.w
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    if not abs(norm - 1.0) < QUATERNION_TOLERANCE:  # also NaN
        raise MessageError(f"has the orientation ({x:g}, {y:g}, {z:g}, {w:g}), which is not a unit quaternion")
    return x / norm, y / norm, z / norm, w / norm


def _coordinate(value: float) -> float:
    if not abs(value) <= MAX_COORDINATE:  # also NaN
        raise MessageError(f"has the coordinate {value}")
    return value


def decode_transform(message: TransformStampedLike) -> StampedTransform:
    """The transform in the plane; the height is dropped.

    Raises:
        MessageError: The stamp is impossible, the rotation tilts the child frame, or as `decode_rigid_transform`.
    """
    parent, child = frames_of(message)
    transform = decode_rigid_transform(message)
    if transform.tilt > MAX_TILT:
        degrees = math.degrees(transform.tilt)
        raise MessageError(f"tilts the frame {child!r} by {degrees:.0f}°; only level frames are supported")
    x, y, _ = transform.translation
    return StampedTransform(parent, child, decode_stamp(message.header.stamp), Pose(x, y, transform.heading))


def decode_rigid_transform(message: TransformStampedLike) -> RigidTransform:
    """The transform in space of the child frame in the parent frame, normalized.

    Raises:
        MessageError: A frame has no name or is its own parent, a coordinate is impossible, or the rotation is no unit
            quaternion.
    """
    parent, child = frames_of(message)
    if not parent or not child or parent == child:
        raise MessageError(f"links the frame {parent!r} to {child!r}")
    translation = message.transform.translation
    return RigidTransform(
        (_coordinate(translation.x), _coordinate(translation.y), _coordinate(translation.z)),
        _unit_quaternion(message.transform.rotation),
    )


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


# ---- scans


def _ignore(remark: str) -> None:
    pass


def decode_laser_scan(
    message: LaserScanLike, frame: str | None = None, on_remark: Callable[[str], None] = _ignore
) -> Scan:
    """A scan with counter-clockwise beams.

    The beams of a clockwise lidar (negative increment) are reversed. A reading at ``range_max`` or beyond is no return,
    inf, see `wherry.robot.mark_no_return`. As in REP 117, −inf is an obstacle closer than ``range_min``,
    and becomes ``range_min``, the safe side.

    Args:
        message: The message.
        frame: Frame that it must be in; None accepts any.
        on_remark: Called with what was corrected in the message, as a clause.

    Raises:
        MessageError: It is in another frame, has no beams or too many, or impossible angles or limits.
    """
    check_frame(message.header.frame_id, frame)
    if not 1 <= len(message.ranges) <= MAX_BEAMS:
        raise MessageError(f"has {len(message.ranges)} beams; 1 to {MAX_BEAMS:,} are possible")
    time = decode_stamp(message.header.stamp)
    first, increment = _angles(message, on_remark)
    range_min, range_max = _limits(message, on_remark)
    ranges = _ranges(message, range_min, range_max)
    time_increment = _time_increment(message, on_remark)
    if increment < 0.0:  # clockwise
        first, increment = first + increment * (len(ranges) - 1), -increment
        ranges, time_increment = ranges[::-1].copy(), -time_increment
    return Scan(time, ranges, first, increment, range_min, range_max, time_increment or 0.0)


def _angles(message: LaserScanLike, on_remark: Callable[[str], None]) -> tuple[float, float]:
    """Direction of the first beam and the angle to the next one, rad.

    Raises:
        MessageError: They are impossible, or contradict the direction of the last beam.
    """
    start, increment, beams = message.angle_min, message.angle_increment, len(message.ranges)
    span, limit = message.angle_max - start, MAX_REVOLUTION * math.tau
    if not math.isfinite(start) or abs(start) > MAX_START_ANGLE:
        raise MessageError(f"has beams from {start:g} rad on, which is not a possible angle_min")
    if not math.isfinite(increment):  # a sign that the driver fails, unlike 0
        raise MessageError("has an angle_increment that is not finite")
    has_increment = increment != 0.0 and abs(increment) * (beams - 1) <= limit
    has_span = beams > 1 and 0.0 < abs(span) <= limit
    if has_increment and has_span:
        travel = increment * (beams - 1)
        off = abs(wrap(travel - span)) / abs(increment)
        tolerance = max(MAX_BEAMS_OFF, MAX_SHARE_OFF * beams)
        is_opposite = travel * span < 0.0 and abs(travel + span) <= tolerance * abs(increment)
        if off > tolerance or is_opposite:
            raise MessageError(
                f"has {beams} beams, {increment:g} rad apart, from {start:g} to {message.angle_max:g} rad, "
                "which contradict each other"
            )
        if off > MAX_BEAMS_OFF:
            on_remark(ANGLE_MAX_IGNORED)
    elif has_span:
        on_remark(INCREMENT_REPLACED)
        increment = span / (beams - 1)
    elif not has_increment:
        raise MessageError(f"has {beams} beams from {start:g} rad on, {increment:g} rad apart")
    return start, increment


def _limits(message: LaserScanLike, on_remark: Callable[[str], None]) -> tuple[float, float]:
    """Shortest and longest valid range, m; drivers that do not know the longest one send inf, 0 or a huge number.

    Raises:
        MessageError: They are impossible.
    """
    range_min, range_max = message.range_min, message.range_max
    if range_max == 0.0 or range_max > MAX_RANGE:
        on_remark(NO_RANGE_MAX)
        range_max = MAX_RANGE
    if not 0.0 <= range_min < min(range_max, MAX_RANGE_MIN):  # also NaN
        raise MessageError(f"has ranges from {message.range_min:g} to {message.range_max:g} m; ranges are stated in m")
    return range_min, range_max


def _ranges(message: LaserScanLike, range_min: float, range_max: float) -> NDArray[np.float64]:
    """Ranges in the order of the message, m; inf where a beam met nothing."""
    ranges = message.ranges.astype(np.float64)
    ranges[ranges == -np.inf] = range_min
    ranges = mark_no_return(ranges, range_max)
    ranges[ranges < 0.0] = np.nan
    if range_min == 0.0:
        ranges[ranges == 0.0] = np.nan  # it would be an obstacle in the lidar
    return ranges


def _time_increment(message: LaserScanLike, on_remark: Callable[[str], None]) -> float:
    """Time from one beam to the next in the order of the message, s; 0 if it is impossible."""
    increment = message.time_increment
    if not 0.0 <= increment < math.inf:  # also NaN
        on_remark(TIMES_IGNORED)
        return 0.0
    return increment


# ---- measurements and commands


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
