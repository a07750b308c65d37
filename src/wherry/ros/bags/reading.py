"""ROS 1 and ROS 2 bags as lidar logs, without a ROS installation (the rosbags package, optional extra ``bags``)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from wherry.errors import InputError
from wherry.logs.lidar_log import MAX_JUMP, LidarLog
from wherry.logs.options import DEFAULT_READING, ReadingOptions
from wherry.robot import Odometry, Scan, Velocity
from wherry.ros.decoding import MessageError, decode_laser_scan, decode_odometry, decode_transform, frames_of
from wherry.ros.message_protocols import OdometryLike, TransformStampedLike
from wherry.space.pose import IDENTITY, Pose
from wherry.space.trajectory import Trajectory

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

UNFINISHED = ".active"  # suffix that rosbag gives to a bag until its recording ends
SUFFIXES = (".bag", ".mcap", ".db3", UNFINISHED)
SCAN, ODOMETRY, TRANSFORMS = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage"
ROBOT_FRAMES = ("base_link", "base_footprint")
ODOMETRY_FRAMES = ("odom", "odom_combined")
MAX_RANGES = 200_000_000  # total of all scans, 1.6 GB
MAX_REASON_LENGTH = 200  # characters shown of an error of rosbags


def is_bag(path: str | Path) -> bool:
    """Whether a path looks like a bag: a .bag, .mcap or .db3 file, or the folder of a ROS 2 bag."""
    path = Path(path)
    return path.suffix in SUFFIXES or (path / "metadata.yaml").is_file()


def read_bag(path: str | Path, options: ReadingOptions = DEFAULT_READING) -> LidarLog:
    """Read the first LaserScan topic (``/scan`` if there is one) and the first Odometry topic (``/odom``) of a bag.

    Messages are decoded and checked as those of a live robot (`wherry.ros.decoding`). A bag without Odometry messages
    gets its odometry from the transforms of the robot's frame in the odom frame. Odometry is interpolated to the times
    of the scans. The lidar's pose on the robot is the transform from the robot's frame to the frame of the scans, or
    the identity if the bag has none.

    Args:
        path: A ROS 1 bag, the folder of a ROS 2 bag, or one of its .mcap or .db3 files.
        options: How to read.

    Raises:
        InputError: The rosbags package is missing, the bag cannot be read or has no scans, all transforms to the lidar
            are unusable, or (unless lenient) a message is invalid; the error names the topic and the message.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(path, "", "No such file or directory")
    if path.suffix == UNFINISHED:
        raise InputError(path, "", f"is a recording that was cut off; {_recovery_hint(path)}")
    try:
        from rosbags.highlevel import AnyReader  # noqa: PLC0415
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415
    except ImportError as error:
        raise InputError(path, "", "is a ROS bag: pip install 'wherry[bags]' to read it") from error
    folder = path.parent if path.suffix in (".mcap", ".db3") and (path.parent / "metadata.yaml").is_file() else path
    try:
        reader = AnyReader([folder], default_typestore=get_typestore(Stores.LATEST))
        reader.open()
    except Exception as error:  # rosbags raises errors of many types on damaged bags, here and below
        raise InputError(path, "", f"is not a bag that can be read: {_first_line(error)}") from error
    try:
        return _read_log(_OpenBag(path, reader), _Rejections(path, options.lenient))
    finally:
        reader.close()


def _recovery_hint(path: Path) -> str:
    """How to recover a recording that was cut off, as part of an error message."""
    files = sorted(path.glob("*/*")) if path.is_dir() else [path]
    for file in files:
        if file.suffix == ".db3":
            return f"{file} can be read, and ros2 bag reindex makes a bag of its folder"
        if file.suffix == ".mcap":
            return f"mcap recover makes a bag of {file}"
    return "rosbag reindex makes a bag of it"


@dataclass(frozen=True)
class _OpenBag:
    """A bag that is open.

    Attributes:
        path: Path of the bag as the user gave it.
        reader: Reader of its messages.
    """

    path: Path
    reader: AnyReader

    def find_topic(self, message_type: str, preferred: str) -> str:
        """The preferred topic if it has messages of a type, otherwise the first that has; empty if there is none."""
        names = sorted(entry.topic for entry in self.reader.connections if entry.msgtype == message_type)
        if preferred in names:
            return preferred
        return names[0] if names else ""

    def messages(self, topic: str, message_type: str) -> Iterator[tuple[str, Any]]:
        """The messages of a topic, each with a name for errors such as "/scan, message 1".

        Raises:
            InputError: The bag is damaged.
        """
        found = [entry for entry in self.reader.connections if (entry.topic, entry.msgtype) == (topic, message_type)]
        if not found:
            return
        number = 0
        try:
            for number, (connection, _, raw) in enumerate(self.reader.messages(connections=found), start=1):
                yield f"{topic}, message {number}", self.reader.deserialize(raw, connection.msgtype)
        except Exception as error:
            name = f"{topic}, message {number + 1}"
            raise InputError(self.path, name, f"the bag is damaged here: {_first_line(error)}") from error


def _first_line(error: Exception) -> str:
    """The first line of an error's text."""
    lines = str(error).splitlines()
    return (lines[0] if lines else type(error).__name__)[:MAX_REASON_LENGTH]


@dataclass
class _Rejections:
    """The messages that cannot be used: each raises an error or, for a lenient reader, is skipped and counted.

    Attributes:
        path: Path of the bag.
        lenient: Whether to skip messages instead of raising an error.
        skipped: Name and reason of each skipped message.
    """

    path: Path
    lenient: bool
    skipped: list[str] = field(default_factory=list)

    def add(self, name: str, error: MessageError) -> None:
        """Reject a message.

        Raises:
            InputError: The reader is not lenient.
        """
        if not self.lenient:
            raise InputError(self.path, name, str(error)) from error
        self.skipped.append(f"{name}: {error}")


def _read_log(bag: _OpenBag, rejections: _Rejections) -> LidarLog:
    """Scans, odometry and the lidar's pose on the robot."""
    odometry = _read_odometry(bag, rejections)
    scans, frame = _read_scans(bag, rejections)
    lidar = _read_mount(bag, frame, rejections)
    skipped = tuple(rejections.skipped)
    if len(odometry.times) < 2:
        return LidarLog(scans, (None,) * len(scans), Trajectory(np.zeros(0), np.zeros((0, 3))), lidar, skipped)
    poses = odometry.at(np.array([scan.time for scan in scans]))
    at_scans = tuple(
        Odometry(scan.time, Pose.from_array(pose), Velocity()) for scan, pose in zip(scans, poses, strict=True)
    )
    return LidarLog(scans, at_scans, odometry, lidar, skipped)


def _read_odometry(bag: _OpenBag, rejections: _Rejections) -> Trajectory:
    """All odometry of a bag: from Odometry messages if there are any, otherwise from transforms."""
    topic = bag.find_topic(ODOMETRY, "/odom")
    if topic:
        return _trajectory(bag.messages(topic, ODOMETRY), _pose_of_odometry, rejections)
    return _trajectory(_odometry_transforms(bag), _pose_of_transform, rejections)


def _odometry_transforms(bag: _OpenBag) -> Iterator[tuple[str, TransformStampedLike]]:
    """The transforms of the robot's frame in the odom frame, each with a name for errors."""
    for name, message in bag.messages("/tf", TRANSFORMS):
        for transform in message.transforms:
            parent, child = frames_of(transform)
            if parent in ODOMETRY_FRAMES and child in ROBOT_FRAMES:
                yield name, transform


def _pose_of_odometry(message: OdometryLike) -> tuple[float, Pose]:
    """Time, s, and pose; any frames are accepted, since robots name them differently."""
    odometry = decode_odometry(message)
    return odometry.time, odometry.pose


def _pose_of_transform(message: TransformStampedLike) -> tuple[float, Pose]:
    """Time, s, and pose."""
    transform = decode_transform(message)
    return transform.time, transform.pose


def _trajectory(
    messages: Iterator[tuple[str, Any]], decode: Callable[[Any], tuple[float, Pose]], rejections: _Rejections
) -> Trajectory:
    """The poses of messages; of several with the same stamp, the last one counts."""
    poses: dict[float, Pose] = {}
    latest = -math.inf
    for name, message in messages:
        try:
            time, pose = decode(message)
            _check_time(time, latest)
            if poses:
                _check_step(pose, poses[latest])
        except MessageError as error:
            rejections.add(name, error)
        else:
            poses[time], latest = pose, time
    return Trajectory(np.array(list(poses)), np.array([pose.as_array() for pose in poses.values()]).reshape(-1, 3))


def _check_time(time: float, latest: float) -> None:
    """Reject a stamp, s, that is earlier than the latest one."""
    if time < latest:
        raise MessageError(f"time runs backwards, from {latest:.6f} to {time:.6f}")


def _check_step(pose: Pose, previous: Pose) -> None:
    """Reject odometry that is too far from the pose before."""
    step = math.hypot(pose.x - previous.x, pose.y - previous.y)
    if step > MAX_JUMP:
        raise MessageError(f"jumps by {step:,.0f} m since the message before")


def _read_scans(bag: _OpenBag, rejections: _Rejections) -> tuple[tuple[Scan, ...], str]:
    """All scans, and the frame that they are in.

    Raises:
        InputError: There are none, or too many.
    """
    scans: list[Scan] = []
    frame: str | None = None
    ranges = 0
    for name, message in bag.messages(bag.find_topic(SCAN, "/scan"), SCAN):
        ranges += len(message.ranges)
        if ranges > MAX_RANGES:
            raise InputError(bag.path, name, f"exceeds the {MAX_RANGES:,} ranges that fit into memory")
        try:
            scan = decode_laser_scan(message, frame)
            if scans:
                _check_time(scan.time, scans[-1].time)
                _check_same_beams(scan, scans[-1])
        except MessageError as error:
            rejections.add(name, error)
        else:
            scans.append(scan)
            frame = message.header.frame_id
    if frame is None:
        raise InputError(bag.path, "", _no_scans_reason(bag, rejections.skipped))
    return tuple(scans), frame


def _check_same_beams(scan: Scan, previous: Scan) -> None:
    """Reject a scan with another number of beams than the one before."""
    if len(scan.ranges) != len(previous.ranges):
        raise MessageError(f"has {len(scan.ranges)} beams where the scans before have {len(previous.ranges)}")


def _no_scans_reason(bag: _OpenBag, skipped: list[str]) -> str:
    """Why a bag has no scans."""
    types = sorted({connection.msgtype for connection in bag.reader.connections if connection.topic == "/scan"})
    other = f"; its /scan is of {types[0]}" if types and types != [SCAN] else ""
    broken = f" ({len(skipped)} skipped, the first: {skipped[0]})" if skipped else ""
    return f"has no usable LaserScan messages{other}{broken}"


def _read_mount(bag: _OpenBag, frame: str, rejections: _Rejections) -> Pose:
    """The lidar's pose in the robot's frame, from the first usable transform; the identity if there is no transform.

    Raises:
        InputError: There are transforms, but none is usable, as when the lidar is mounted upside down.
    """
    unusable: InputError | None = None
    for topic in ("/tf_static", "/tf"):
        for name, message in bag.messages(topic, TRANSFORMS):
            for transform in message.transforms:
                parent, child = frames_of(transform)
                if parent not in ROBOT_FRAMES or child != frame.lstrip("/"):
                    continue
                try:
                    return decode_transform(transform).pose
                except MessageError as error:
                    rejections.add(name, error)
                    unusable = unusable or InputError(bag.path, name, str(error))
    if unusable is not None:
        raise unusable
    return IDENTITY
