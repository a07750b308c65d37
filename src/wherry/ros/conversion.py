"""Between ROS's messages and wherry's own values; what comes from outside is checked here, and nowhere else.

REP 103 for units and axes, REP 105 for frames, REP 117 for what a lidar's ranges mean.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.logs.lidar_log import MAX_BEAMS
from wherry.robot import Odometry, Scan, Velocity
from wherry.ros import messages as ros
from wherry.space.map_files import LARGEST_GRID
from wherry.space.occupancy import UNKNOWN, OccupancyGrid
from wherry.space.pose import Floats, Pose

NANOSECONDS = 1_000_000_000
LARGEST_COORDINATE = 1e6  # m; farther from the origin, nothing is a place
LARGEST_SPEED = 100.0  # m/s and rad/s; faster, nothing is a velocity
LONGEST_RANGE = 1000.0  # m
LEVEL = 0.1  # of a quaternion's x and y, 0.2 rad: more, and the lidar or the robot does not stand upright
OCCUPIED, FREE, NOT_KNOWN = 100, 0, -1  # per cent, as map_server, gmapping and amcl have them


class MessageError(ValueError):
    """A message that cannot be used; the text says what is wrong with it."""


def stamp_of(seconds: float) -> ros.Time:
    """A time in s as a stamp, to the nearest nanosecond."""
    whole = round(seconds * NANOSECONDS)
    return ros.Time(whole // NANOSECONDS, whole % NANOSECONDS)


def seconds_of(stamp: ros.Time) -> float:
    """A stamp in s.

    Raises:
        MessageError: It is before the beginning of time, or its nanoseconds make a second.
    """
    if stamp.sec < 0 or not 0 <= stamp.nanosec < NANOSECONDS:
        raise MessageError(f"has the impossible stamp {stamp.sec} s {stamp.nanosec} ns")
    return (stamp.sec * NANOSECONDS + stamp.nanosec) / NANOSECONDS


def header_of(seconds: float, frame: str) -> ros.Header:
    """When and in which frame."""
    return ros.Header(stamp_of(seconds), frame)


def check_frame(found: str, expected: str) -> None:
    """ROS 1's older nodes write a slash before frames.

    Raises:
        MessageError: It is another frame.
    """
    if found.lstrip("/") != expected.lstrip("/"):
        raise MessageError(f"is in the frame {found!r} instead of {expected!r}")


# ---- poses


def to_pose(pose: Pose, z: float = 0.0) -> ros.Pose:
    """A pose in the plane, z m above the floor."""
    return ros.Pose(ros.Point(pose.x, pose.y, z), to_quaternion(pose.theta))


def from_pose(message: ros.Pose) -> Pose:
    """The pose in the plane.

    Raises:
        MessageError: A number is none, or absurd, or the orientation is no rotation.
    """
    x, y = _coordinate(message.position.x), _coordinate(message.position.y)
    return Pose(x, y, _heading(message.orientation))


def to_quaternion(heading: float) -> ros.Quaternion:
    """A rotation about the z axis, rad."""
    return ros.Quaternion(0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2))


def _heading(quaternion: ros.Quaternion) -> float:
    """rad, about the z axis."""
    x, y, z, w = quaternion.x, quaternion.y, quaternion.z, quaternion.w
    length = math.sqrt(x * x + y * y + z * z + w * w)
    if not abs(length - 1.0) < 0.01:  # also NaN
        raise MessageError(f"has the orientation ({x}, {y}, {z}, {w}), which is no rotation")
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def _coordinate(value: float) -> float:
    if not abs(value) <= LARGEST_COORDINATE:  # also NaN
        raise MessageError(f"has the coordinate {value}")
    return value


@dataclass(frozen=True, slots=True)
class Link:
    """One edge of the tree of frames.

    Attributes:
        parent: A frame.
        child: Another.
        time: s, from when on it holds.
        pose: The child's, in the parent.
    """

    parent: str
    child: str
    time: float
    pose: Pose


def to_transform(link: Link, z: float = 0.0) -> ros.TransformStamped:
    """A link between frames; the child is z m above the parent."""
    rotation = to_quaternion(link.pose.theta)
    transform = ros.Transform(ros.Vector3(link.pose.x, link.pose.y, z), rotation)
    return ros.TransformStamped(header_of(link.time, link.parent), link.child, transform)


def from_transform(message: ros.TransformStamped) -> Link:
    """The link between two frames, in the plane.

    Raises:
        MessageError: A number is none, or absurd, the rotation is none, or it tilts the child.
    """
    rotation, shift = message.transform.rotation, message.transform.translation
    heading = _heading(rotation)
    if max(abs(rotation.x), abs(rotation.y)) > LEVEL:
        raise MessageError(f"tilts {message.child_frame_id!r}, which must stand upright")
    pose = Pose(_coordinate(shift.x), _coordinate(shift.y), heading)
    parent, child = message.header.frame_id.lstrip("/"), message.child_frame_id.lstrip("/")
    return Link(parent, child, seconds_of(message.header.stamp), pose)


def links_between(message: ros.TFMessage, parent: str, child: str) -> Iterator[Link]:
    """A message's links from one frame to another, checked as `from_transform` does; others are not looked at."""
    for transform in message.transforms:
        ends = (transform.header.frame_id.lstrip("/"), transform.child_frame_id.lstrip("/"))
        if ends == (parent, child):
            yield from_transform(transform)


def to_path(points: NDArray[np.floating], seconds: float, frame: str) -> ros.Path:
    """Points [M, 2] m as a path whose poses look ahead."""
    header = header_of(seconds, frame)
    ahead = np.diff(points, axis=0, append=points[-1:])
    headings = np.arctan2(ahead[:, 1], ahead[:, 0])
    headings[-1:] = headings[-2:-1] if len(points) > 1 else 0.0
    poses = [Pose(float(x), float(y), float(theta)) for (x, y), theta in zip(points, headings, strict=True)]
    return ros.Path(header, tuple(ros.PoseStamped(header, to_pose(pose)) for pose in poses))


def to_pose_array(particles: NDArray[np.floating], seconds: float, frame: str) -> ros.PoseArray:
    """Particles [N, 3], x m, y m, θ rad."""
    poses = tuple(to_pose(Pose(x, y, theta)) for x, y, theta in particles.tolist())
    return ros.PoseArray(header_of(seconds, frame), poses)


def from_estimate(message: ros.PoseWithCovarianceStamped, frame: str) -> tuple[float, Pose]:
    """An estimate's time, s, and pose.

    Raises:
        MessageError: It is in another frame, or as `from_pose` and `seconds_of` say.
    """
    check_frame(message.header.frame_id, frame)
    return seconds_of(message.header.stamp), from_pose(message.pose.pose)


# ---- what robots say and hear


def to_laser_scan(scan: Scan, frame: str, period: float = 0.0) -> ros.LaserScan:
    """A scan; ``period`` is the time of a turn, s, 0 if all beams are of one instant."""
    return ros.LaserScan(
        header=header_of(scan.time, frame),
        angle_min=scan.angle_min,
        angle_max=scan.angle_min + scan.angle_increment * (len(scan.ranges) - 1),
        angle_increment=scan.angle_increment,
        time_increment=0.0,
        scan_time=period,
        range_min=scan.range_min,
        range_max=scan.range_max,
        ranges=scan.ranges.astype(np.float32),
    )


def from_laser_scan(message: ros.LaserScan, frame: str) -> Scan:
    """A scan, counter-clockwise; what is too near counts as being at the shortest range, which is the safe side.

    Raises:
        MessageError: It is in another frame, has no beams or too many, or an angle or a limit that cannot be.
    """
    check_frame(message.header.frame_id, frame)
    increment, beams = message.angle_increment, len(message.ranges)
    limits = (message.angle_min, increment, message.range_min, message.range_max)
    if not all(map(math.isfinite, limits)):
        raise MessageError("has an angle or a limit that is no number")
    if not 1 <= beams <= MAX_BEAMS:
        raise MessageError(f"has {beams} beams; 1 to {MAX_BEAMS:,} are possible")
    if not 0.0 <= message.range_min < message.range_max <= LONGEST_RANGE:
        raise MessageError(f"has ranges from {message.range_min} to {message.range_max} m")
    turn = abs(increment) * (beams - 1)
    if abs(message.angle_min) > 2 * math.tau or increment == 0.0 or turn >= math.tau + abs(increment):
        raise MessageError(f"has {beams} beams from {message.angle_min} rad on, {increment} rad apart")
    ranges = message.ranges.astype(np.float64)
    ranges[ranges > message.range_max] = np.inf
    ranges[ranges == -np.inf] = message.range_min
    first = message.angle_min
    if increment < 0.0:  # a lidar that turns clockwise
        first, increment, ranges = first + increment * (beams - 1), -increment, ranges[::-1].copy()
    return Scan(seconds_of(message.header.stamp), ranges, first, increment, message.range_min, message.range_max)


def to_odometry(odometry: Odometry, frame: str, child: str, covariance: Floats) -> ros.Odometry:
    """Odometry; the covariance [36] is of the pose and of the velocity alike."""
    velocity = to_twist(odometry.velocity)
    return ros.Odometry(
        header_of(odometry.time, frame),
        child,
        ros.PoseWithCovariance(to_pose(odometry.pose), covariance),
        ros.TwistWithCovariance(velocity, covariance),
    )


def from_odometry(message: ros.Odometry, frame: str, child: str) -> Odometry:
    """Odometry.

    Raises:
        MessageError: It is of other frames, or has a number that is none, or absurd.
    """
    check_frame(message.header.frame_id, frame)
    check_frame(message.child_frame_id, child)
    pose = from_pose(message.pose.pose)
    return Odometry(seconds_of(message.header.stamp), pose, from_twist(message.twist.twist))


def to_twist(velocity: Velocity) -> ros.Twist:
    """A velocity of a differential drive."""
    return ros.Twist(ros.Vector3(velocity.linear), ros.Vector3(z=velocity.angular))


def from_twist(message: ros.Twist) -> Velocity:
    """A velocity of a differential drive; what it cannot do (sideways, up) is left out.

    Raises:
        MessageError: A component is no number, or absurd.
    """
    for value in (message.linear.x, message.linear.y, message.angular.z):
        if not abs(value) <= LARGEST_SPEED:  # also NaN
            raise MessageError(f"has the speed {value}")
    return Velocity(message.linear.x, message.angular.z)


# ---- maps


def to_grid(grid: OccupancyGrid, seconds: float, frame: str) -> ros.OccupancyGrid:
    """A map as map_server gives it: occupied, free, or not known."""
    height, width = grid.shape
    data = np.full(grid.shape, NOT_KNOWN, np.int8)
    data[grid.free] = FREE
    data[grid.occupied] = OCCUPIED
    info = ros.MapMetaData(stamp_of(seconds), grid.resolution, width, height, to_pose(grid.origin))
    return ros.OccupancyGrid(header_of(seconds, frame), info, data.ravel())


def from_grid(message: ros.OccupancyGrid, frame: str, *, margin: float = math.inf) -> OccupancyGrid:
    """A map.

    Args:
        message: The map.
        frame: The one that it must be in.
        margin: m of what nobody knows that is kept around what is known. gmapping's maps are 200 m wide from the start.

    Raises:
        MessageError: It is in another frame, empty, too large, of another size than it says, or has values that are no
            per cent.
    """
    check_frame(message.header.frame_id, frame)
    info = message.info
    if not 0.001 <= info.resolution <= 10.0:  # also NaN
        raise MessageError(f"has cells of {info.resolution} m")
    if not 0 < info.width * info.height <= LARGEST_GRID:
        raise MessageError(f"has {info.width} × {info.height} cells; 1 to {LARGEST_GRID:,} are possible")
    if len(message.data) != info.width * info.height:
        raise MessageError(f"has {len(message.data)} values for {info.width} × {info.height} cells")
    if message.data.min() < NOT_KNOWN or message.data.max() > OCCUPIED:
        raise MessageError("has values that are neither −1 nor a per cent")
    resolution = round(info.resolution, 6)
    data = message.data.reshape(info.height, info.width)
    rows, columns = _known_part(data, margin / resolution)
    values = data[rows, columns].astype(np.float32)
    probability = np.where(values == NOT_KNOWN, np.float32(UNKNOWN), values / np.float32(OCCUPIED))
    corner = Pose(columns.start * resolution, rows.start * resolution)
    return OccupancyGrid(probability, resolution, from_pose(info.origin) @ corner)


def _known_part(data: NDArray[np.int8], margin: float) -> tuple[slice, slice]:
    """Rows and columns of a map [H, W] that hold what is known, and so many around it; all if nothing is known."""
    known = data != NOT_KNOWN
    return _known_range(known.any(axis=1), margin), _known_range(known.any(axis=0), margin)


def _known_range(known: NDArray[np.bool_], margin: float) -> slice:
    """From the first to the last that is known, and so many before and after."""
    indices = np.flatnonzero(known)
    if not len(indices):
        return slice(0, len(known))
    first, last = max(indices[0] - margin, 0), min(indices[-1] + margin, len(known) - 1)
    return slice(math.floor(first), math.ceil(last) + 1)
