"""ROS 1 and ROS 2 bags as lidar logs, without ROS (the rosbags package, optional extra ``bags``)."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from wherry.errors import InputError
from wherry.logs import LidarLog
from wherry.robot import Odometry, Scan, Velocity
from wherry.space.pose import IDENTITY, Pose
from wherry.space.trajectory import Trajectory

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

SUFFIXES = (".bag", ".mcap", ".db3")
SCAN, ODOMETRY = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry"
ROBOT_FRAMES = ("base_link", "base_footprint")
MOST_BEAMS = 20_000


def is_bag(path: str | Path) -> bool:
    """Whether a path looks like a bag: a .bag, .mcap or .db3 file, or a ROS 2 bag's folder."""
    path = Path(path)
    return path.suffix in SUFFIXES or (path / "metadata.yaml").is_file()


def read_bag(path: str | Path, *, lenient: bool = False) -> LidarLog:
    """Read the first LaserScan topic (``/scan`` if there is one) and the first Odometry topic (``/odom``) of a bag.

    Scans get the odometry of their instant by interpolation, and the lidar its place from a transform of the robot's
    frame to the scans' frame.

    Args:
        path: A ROS 1 bag, a ROS 2 bag's folder, or one of its .mcap or .db3 files.
        lenient: Whether broken messages are left out instead of refusing the bag.

    Raises:
        InputError: The rosbags package is missing, the bag cannot be read or has no scans, or (unless lenient) a
            message is broken: the error names it.
    """
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError  # noqa: PLC0415
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415
    except ImportError as error:
        raise InputError(path, "", "is a ROS bag: pip install 'wherry[bags]' to read it") from error
    path = Path(path)
    if not path.exists():
        raise InputError(path, "", "No such file or directory")
    folder = path.parent if path.suffix in (".mcap", ".db3") and (path.parent / "metadata.yaml").is_file() else path
    try:
        with AnyReader([folder], default_typestore=get_typestore(Stores.LATEST)) as reader:
            return _read(path, reader, lenient)
    except (AnyReaderError, OSError, ValueError, KeyError) as error:
        raise InputError(path, "", f"is not a bag that can be read: {error}") from error


def _read(path: Path, reader: AnyReader, lenient: bool) -> LidarLog:
    """Everything that is needed of an open bag."""
    skipped: list[str] = []
    scans: list[Scan] = []
    poses: dict[float, Pose] = {}
    frame = ""
    for number, message in _messages(reader, _topic(reader, ODOMETRY, "/odom")):
        time, pose = _seconds(message), _pose(message.pose.pose)
        reason = "" if np.isfinite([time, *pose.as_array()]).all() else "has a number that is not finite"
        if poses and time < next(reversed(poses)):
            reason = "time runs backwards"
        if not _refused(path, f"odometry {number}", reason, lenient, skipped):
            poses[time] = pose
    for number, message in _messages(reader, _topic(reader, SCAN, "/scan")):
        scan, frame = _scan(message), message.header.frame_id
        reason = _fault(scan, scans[-1] if scans else None)
        if not _refused(path, f"scan {number}", reason, lenient, skipped):
            scans.append(scan)
    if not scans:
        raise InputError(path, "", "has no LaserScan messages in it")
    times = np.array(list(poses))
    odometry = Trajectory(times, np.array([pose.as_array() for pose in poses.values()]).reshape(-1, 3))
    if len(times) < 2:
        none = Trajectory(np.zeros(0), np.zeros((0, 3)))
        return LidarLog(tuple(scans), (None,) * len(scans), none, _mount(reader, frame), tuple(skipped))
    at_scans = odometry.at(np.array([scan.time for scan in scans]))
    each = tuple(
        Odometry(scan.time, Pose.from_array(pose), Velocity()) for scan, pose in zip(scans, at_scans, strict=True)
    )
    return LidarLog(tuple(scans), each, odometry, _mount(reader, frame), tuple(skipped))


def _topic(reader: AnyReader, kind: str, preferred: str) -> str:
    """The preferred topic of a kind, else the first by name; empty if there is none."""
    names = sorted(connection.topic for connection in reader.connections if connection.msgtype == kind)
    if preferred in names:
        return preferred
    return names[0] if names else ""


def _messages(reader: AnyReader, topic: str) -> Iterator[tuple[int, Any]]:
    """A topic's messages, numbered from 1."""
    connections = [connection for connection in reader.connections if connection.topic == topic]
    if not connections:
        return
    for number, (connection, _, raw) in enumerate(reader.messages(connections=connections), start=1):
        yield number, reader.deserialize(raw, connection.msgtype)


def _refused(path: Path, name: str, reason: str, lenient: bool, skipped: list[str]) -> bool:
    """Whether a message is left out; an error if there is a reason and nobody is lenient."""
    if not reason:
        return False
    if not lenient:
        raise InputError(path, name, reason)
    skipped.append(f"{name}: {reason}")
    return True


def _fault(scan: Scan, last: Scan | None) -> str:
    """What is wrong with a scan; empty if nothing is."""
    limits = [scan.time, scan.angle_min, scan.angle_increment, scan.range_min, scan.range_max]
    if not np.isfinite(limits).all() or scan.range_max <= 0.0 or scan.angle_increment == 0.0:
        return "has a time, an angle or a limit that cannot be"
    if not 1 <= len(scan.ranges) <= MOST_BEAMS:
        return f"has {len(scan.ranges)} beams; 1 to {MOST_BEAMS:,} are possible"
    if last is not None and scan.time < last.time:
        return f"time runs backwards, from {last.time:.6f} to {scan.time:.6f}"
    if last is not None and len(scan.ranges) != len(last.ranges):
        return f"has {len(scan.ranges)} beams where the scans before have {len(last.ranges)}"
    return ""


def _scan(message: Any) -> Scan:
    """A sensor_msgs/LaserScan; what it does not see within its limits stays as it is."""
    ranges = np.array(message.ranges, dtype=np.float64)
    ranges[ranges > message.range_max] = np.inf
    return Scan(
        _seconds(message),
        ranges,
        float(message.angle_min),
        float(message.angle_increment),
        float(message.range_min),
        float(message.range_max),
    )


def _mount(reader: AnyReader, frame: str) -> Pose:
    """The lidar's pose in the robot's frame, if the bag has it as one transform."""
    frame = frame.lstrip("/")
    for topic in ("/tf_static", "/tf"):
        for _, message in _messages(reader, topic):
            for transform in message.transforms:
                parent = transform.header.frame_id.lstrip("/")
                if parent in ROBOT_FRAMES and transform.child_frame_id.lstrip("/") == frame:
                    place, turn = transform.transform.translation, transform.transform.rotation
                    return Pose(float(place.x), float(place.y), _yaw(turn))
    return IDENTITY


def _seconds(message: Any) -> float:
    """A message's own time, s."""
    stamp = message.header.stamp
    return float(stamp.sec) + float(stamp.nanosec) * 1e-9


def _pose(message: Any) -> Pose:
    """A geometry_msgs/Pose in the plane."""
    return Pose(float(message.position.x), float(message.position.y), _yaw(message.orientation))


def _yaw(quaternion: Any) -> float:
    """The heading of a quaternion, rad."""
    x, y, z, w = (float(getattr(quaternion, name)) for name in "xyzw")
    return float(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
