"""ROS 1 and ROS 2 bags as lidar logs, without ROS (the rosbags package, optional extra ``bags``)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from wherry.errors import InputError
from wherry.logs.lidar_log import MAX_BEAMS, MAX_JUMP, LidarLog
from wherry.robot import Odometry, Scan, Velocity
from wherry.space.pose import IDENTITY, Pose
from wherry.space.trajectory import Trajectory

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

UNFINISHED = ".active"  # what recorders call bags that they have not finished, after rosbag itself
SUFFIXES = (".bag", ".mcap", ".db3", UNFINISHED)
SCAN, ODOMETRY, TRANSFORMS = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage"
ROBOT_FRAMES = ("base_link", "base_footprint")
ODOMETRY_FRAMES = ("odom", "odom_combined")
NANOSECONDS = 1_000_000_000
MOST_READINGS = 200_000_000  # of all scans together; 1.6 GB


def is_bag(path: str | Path) -> bool:
    """Whether a path looks like a bag: a .bag, .mcap or .db3 file, or a ROS 2 bag's folder."""
    path = Path(path)
    return path.suffix in SUFFIXES or (path / "metadata.yaml").is_file()


def read_bag(path: str | Path, *, lenient: bool = False) -> LidarLog:
    """Read the first LaserScan topic (``/scan`` if there is one) and the first Odometry topic (``/odom``) of a bag.

    Without Odometry messages the transforms of the robot's frame in the odom frame count. Scans get the odometry of
    their instant by interpolation, and the lidar its place from a transform of the robot's frame to the scans' frame.

    Args:
        path: A ROS 1 bag, a ROS 2 bag's folder, or one of its .mcap or .db3 files.
        lenient: Whether broken messages are left out instead of refusing the bag.

    Raises:
        InputError: The rosbags package is missing, the bag cannot be read or has no scans, or (unless lenient) a
            message is broken: the error names it.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(path, "", "No such file or directory")
    if path.suffix == UNFINISHED:
        raise InputError(path, "", f"is a recording that was cut off; {_rescue(path)}")
    try:
        from rosbags.highlevel import AnyReader  # noqa: PLC0415
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415
    except ImportError as error:
        raise InputError(path, "", "is a ROS bag: pip install 'wherry[bags]' to read it") from error
    folder = path.parent if path.suffix in (".mcap", ".db3") and (path.parent / "metadata.yaml").is_file() else path
    reader = None
    try:
        reader = AnyReader([folder], default_typestore=get_typestore(Stores.LATEST))
        reader.open()
    except Exception as error:  # on a damaged bag rosbags raises errors of a dozen kinds, here and below
        raise InputError(path, "", f"is not a bag that can be read: {_first_line(error)}") from error
    try:
        return _read(_Bag(path, reader), lenient)
    finally:
        reader.close()


def _rescue(path: Path) -> str:
    """How a bag is made of a recording that was cut off."""
    files = sorted(path.glob("*/*")) if path.is_dir() else [path]
    for file in files:
        if file.suffix == ".db3":
            return f"{file} can be read, and ros2 bag reindex makes a bag of its folder"
        if file.suffix == ".mcap":
            return f"mcap recover makes a bag of {file}"
    return "rosbag reindex makes a bag of it"


@dataclass(frozen=True)
class _Bag:
    """A bag that is open.

    Attributes:
        path: What the user calls it.
        reader: Of its messages.
    """

    path: Path
    reader: AnyReader

    def topic(self, kind: str, preferred: str) -> str:
        """The preferred topic of a kind, else the first by name; empty if there is none."""
        names = sorted(connection.topic for connection in self.reader.connections if connection.msgtype == kind)
        if preferred in names:
            return preferred
        return names[0] if names else ""

    def messages(self, topic: str, kind: str) -> Iterator[tuple[int, Any]]:
        """A topic's messages of a kind, numbered from 1.

        Raises:
            InputError: The bag is damaged there.
        """
        found = [entry for entry in self.reader.connections if (entry.topic, entry.msgtype) == (topic, kind)]
        if not found:
            return
        number = 0
        try:
            for number, (connection, _, raw) in enumerate(self.reader.messages(connections=found), start=1):
                yield number, self.reader.deserialize(raw, connection.msgtype)
        except Exception as error:
            name = f"{topic}, message {number + 1}"
            raise InputError(self.path, name, f"the bag is damaged here: {_first_line(error)}") from error


def _first_line(error: Exception) -> str:
    """What an error says, in one line."""
    lines = str(error).splitlines()
    return (lines[0] if lines else type(error).__name__)[:200]


def _read(bag: _Bag, lenient: bool) -> LidarLog:
    """Everything that is needed of an open bag."""
    skipped: list[str] = []
    odometry = _odometry(bag, lenient, skipped)
    scans, frame = _scans(bag, lenient, skipped)
    lidar = _mount(bag, frame)
    if len(odometry.times) < 2:
        none = Trajectory(np.zeros(0), np.zeros((0, 3)))
        return LidarLog(scans, (None,) * len(scans), none, lidar, tuple(skipped))
    at_scans = odometry.at(np.array([scan.time for scan in scans]))
    each = tuple(
        Odometry(scan.time, Pose.from_array(pose), Velocity()) for scan, pose in zip(scans, at_scans, strict=True)
    )
    return LidarLog(scans, each, odometry, lidar, tuple(skipped))


def _odometry(bag: _Bag, lenient: bool, skipped: list[str]) -> Trajectory:
    """All odometry; of several messages of one instant the last counts."""
    poses: dict[float, Pose] = {}
    latest = -np.inf
    for name, time, pose in _odometry_messages(bag):
        reason = "" if np.isfinite([time, *pose.as_array()]).all() else "has a number that is not finite"
        if time < latest:
            reason = f"time runs backwards, from {latest:.6f} to {time:.6f}"
        jump = np.hypot(pose.x - poses[latest].x, pose.y - poses[latest].y) if poses else 0.0
        if not reason and not jump <= MAX_JUMP:
            reason = f"jumps by {jump:,.0f} m since the one before"
        if not _refused(bag.path, name, reason, lenient, skipped):
            poses[time], latest = pose, time
    return Trajectory(np.array(list(poses)), np.array([pose.as_array() for pose in poses.values()]).reshape(-1, 3))


def _odometry_messages(bag: _Bag) -> Iterator[tuple[str, float, Pose]]:
    """What each is called, its time, s, and base_link in the odom frame."""
    topic = bag.topic(ODOMETRY, "/odom")
    if topic:
        for number, message in bag.messages(topic, ODOMETRY):
            yield (
                f"odometry {number}",
                _seconds(message),
                _pose(message.pose.pose.position, message.pose.pose.orientation),
            )
        return
    for number, message in bag.messages("/tf", TRANSFORMS):
        for transform in message.transforms:
            ends = (transform.header.frame_id.lstrip("/"), transform.child_frame_id.lstrip("/"))
            if ends[0] in ODOMETRY_FRAMES and ends[1] in ROBOT_FRAMES:
                place = transform.transform
                yield f"/tf {number}", _seconds(transform), _pose(place.translation, place.rotation)


def _scans(bag: _Bag, lenient: bool, skipped: list[str]) -> tuple[tuple[Scan, ...], str]:
    """All scans, and the frame that they are in.

    Raises:
        InputError: There are none, or too many.
    """
    scans: list[Scan] = []
    frame = ""
    readings = 0
    for number, message in bag.messages(bag.topic(SCAN, "/scan"), SCAN):
        scan, frame = _scan(message), message.header.frame_id
        readings += len(scan.ranges)
        if readings > MOST_READINGS:
            raise InputError(
                bag.path, f"scan {number}", f"is the last of {MOST_READINGS:,} readings that can be taken in"
            )
        reason = _fault(scan, scans[-1] if scans else None)
        if not _refused(bag.path, f"scan {number}", reason, lenient, skipped):
            scans.append(scan)
    if not scans:
        kinds = sorted({connection.msgtype for connection in bag.reader.connections if connection.topic == "/scan"})
        other = f"; its /scan is of {kinds[0]}" if kinds and kinds != [SCAN] else ""
        left_out = f" ({len(skipped)} broken ones were left out, the first: {skipped[0]})" if skipped else ""
        raise InputError(bag.path, "", f"has no LaserScan messages in it{other}{left_out}")
    return tuple(scans), frame


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
    if not 1 <= len(scan.ranges) <= MAX_BEAMS:
        return f"has {len(scan.ranges)} beams; 1 to {MAX_BEAMS:,} are possible"
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


def _mount(bag: _Bag, frame: str) -> Pose:
    """The lidar's pose in the robot's frame, if the bag has it as one transform."""
    frame = frame.lstrip("/")
    for topic in ("/tf_static", "/tf"):
        for _, message in bag.messages(topic, TRANSFORMS):
            for transform in message.transforms:
                parent = transform.header.frame_id.lstrip("/")
                if parent in ROBOT_FRAMES and transform.child_frame_id.lstrip("/") == frame:
                    return _pose(transform.transform.translation, transform.transform.rotation)
    return IDENTITY


def _seconds(message: Any) -> float:
    """A message's own time, s."""
    stamp = message.header.stamp
    return (int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)) / NANOSECONDS


def _pose(place: Any, rotation: Any) -> Pose:
    """A geometry_msgs/Pose or Transform in the plane."""
    return Pose(float(place.x), float(place.y), _yaw(rotation))


def _yaw(quaternion: Any) -> float:
    """The heading of a quaternion, rad."""
    x, y, z, w = (float(getattr(quaternion, name)) for name in "xyzw")
    return float(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
