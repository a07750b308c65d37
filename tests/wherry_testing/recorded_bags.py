"""Small bags of ROS 1 and ROS 2 with messages as a test wants them, written with rosbags alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from wherry.logs.lidar_log import LidarLog
from wherry.logs.options import ReadingOptions
from wherry.ros.bags.reading import read_bag

LASER_SCAN, ODOMETRY = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry"
TF2, OLD_TF = "tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"
KINDS = ("ros1", "mcap", "sqlite")
SUFFIXES = {"ros1": ".bag", "mcap": ".mcap", "sqlite": ".db3"}
Quaternion = tuple[float, float, float, float]
Link = tuple[str, str, tuple[float, float, float], Quaternion]
LEVEL: Quaternion = (0.0, 0.0, 0.0, 1.0)


def quaternion(roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0) -> Quaternion:
    """Rotation about the fixed axes x, y, z, rad, as in a URDF."""
    (sr, cr), (sp, cp), (sy, cy) = ((math.sin(a / 2), math.cos(a / 2)) for a in (roll, pitch, yaw))
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def link(parent: str, child: str, x: float = 0.0, y: float = 0.0, z: float = 0.0, rotation: Quaternion = LEVEL) -> Link:
    """A transform."""
    return parent, child, (x, y, z), rotation


@dataclass
class SmallBag:
    """Messages of a bag, written by `write`.

    Attributes:
        kind: One of `KINDS`.
    """

    kind: str
    _messages: list[tuple[str, str, float, Any]] = field(default_factory=list)
    _definitions: dict[str, str] = field(default_factory=dict)

    def add(self, topic: str, message_type: str, received: float, content: Any) -> SmallBag:
        """Add any message."""
        self._messages.append((topic, message_type, received, content))
        return self

    def define(self, topic: str, message_type: str, definition: str) -> SmallBag:
        """Add a message of eight zero bytes, and give all messages of its type another definition."""
        self._definitions[message_type] = definition
        self._messages.append((topic, message_type, 0.0, bytes(8)))
        return self

    def declare(self, topic: str, message_type: str) -> SmallBag:
        """Add a topic without messages."""
        self._messages.append((topic, message_type, math.nan, None))
        return self

    def scan(
        self,
        time: float = 1.0,
        topic: str = "/scan",
        frame: str = "laser",
        received: float | None = None,
        **changes: Any,
    ) -> SmallBag:
        """Add a scan of five beams, or one with other fields."""
        ranges = np.asarray(changes.pop("ranges", [1.0, 2.0, 3.0, 4.0, 5.0]), np.float32)
        increment = changes.pop("angle_increment", 0.5)
        start = changes.pop("angle_min", -1.0)
        fields = {
            "angle_min": start,
            "angle_max": start + increment * (len(ranges) - 1),
            "angle_increment": increment,
            "time_increment": 0.0,
            "scan_time": 0.1,
            "range_min": 0.1,
            "range_max": 10.0,
        }
        content = SimpleNamespace(
            header=header(time, frame), **(fields | changes), ranges=ranges, intensities=np.zeros(0, np.float32)
        )
        return self.add(topic, LASER_SCAN, time if received is None else received, content)

    def odometry(
        self,
        time: float,
        x: float = 0.0,
        yaw: float = 0.0,
        topic: str = "/odom",
        frame: str = "odom",
        child: str = "base_link",
        y: float = 0.0,
        orientation: Quaternion | None = None,
        received: float | None = None,
    ) -> SmallBag:
        """Add odometry."""
        pose = SimpleNamespace(position=vector(x, y, 0.0), orientation=rotation(orientation or quaternion(yaw=yaw)))
        twist = SimpleNamespace(linear=vector(0.0, 0.0, 0.0), angular=vector(0.0, 0.0, 0.0))
        content = SimpleNamespace(
            header=header(time, frame),
            child_frame_id=child,
            pose=SimpleNamespace(pose=pose, covariance=np.zeros(36)),
            twist=SimpleNamespace(twist=twist, covariance=np.zeros(36)),
        )
        return self.add(topic, ODOMETRY, time if received is None else received, content)

    def transforms(
        self, links: Sequence[Link], time: float = 0.0, topic: str = "/tf_static", message_type: str = TF2
    ) -> SmallBag:
        """Add a message of transforms."""
        transforms = [
            SimpleNamespace(
                header=header(time, parent),
                child_frame_id=child,
                transform=SimpleNamespace(translation=vector(*place), rotation=rotation(turn)),
            )
            for parent, child, place, turn in links
        ]
        return self.add(topic, message_type, time, SimpleNamespace(transforms=transforms))

    def drive(self, **names: str) -> SmallBag:
        """Add odometry from 0 to 10 s over 5 m."""
        for step in range(11):
            self.odometry(float(step), 0.5 * step, **names)
        return self

    def write(self, path: Path, *, in_chunks: bool = False, **options: Any) -> Path:
        """Write the bag to a path, a file of ROS 1 or a folder of ROS 2; returns the path.

        Args:
            path: The path.
            in_chunks: Whether each message of an MCAP file is a chunk.
            options: As for ``set_compression`` of rosbags' writer.
        """
        types = typestore(is_ros1=self.kind == "ros1")
        writer = self._writer(path, options)
        with writer:
            connections: dict[tuple[str, str], Any] = {}
            for topic, kind, received, content in self._messages:
                if (topic, kind) not in connections:
                    connections[topic, kind] = writer.add_connection(topic, kind, **self._definition(kind, types))
                if content is None:
                    continue
                serialize = types.serialize_ros1 if self.kind == "ros1" else types.serialize_cdr
                raw = content if isinstance(content, bytes) else serialize(content, kind)
                writer.write(connections[topic, kind], round(received * 1e9) + 1, raw)
                if in_chunks:
                    writer.storage.close_chunk()
        return path

    def _definition(self, message_type: str, types: Any) -> dict[str, Any]:
        """The definition of a type, as a writer of rosbags takes it."""
        if message_type not in self._definitions:
            return {"typestore": types}
        digest = {"md5sum": "0" * 32} if self.kind == "ros1" else {"rihs01": f"RIHS01_{'0' * 64}"}
        return {"msgdef": self._definitions[message_type], **digest}

    def write_file(self, folder: Path, name: str) -> Path:
        """Write the bag as a single file of a name without suffix, also in ROS 2; returns its path."""
        path = folder / f"{name}{SUFFIXES[self.kind]}"
        if self.kind == "ros1":
            return self.write(path)
        inner = self.write(folder / f"{name}.tmp")
        next(inner.glob(f"*{SUFFIXES[self.kind]}")).rename(path)
        (inner / "metadata.yaml").unlink()
        inner.rmdir()
        return path

    def _writer(self, path: Path, options: dict[str, Any]) -> Any:
        if self.kind == "ros1":
            return rosbag1.Writer(path)
        plugin = rosbag2.StoragePlugin.MCAP if self.kind == "mcap" else rosbag2.StoragePlugin.SQLITE3
        writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)
        if options:
            writer.set_compression(**options)
        return writer


@cache
def typestore(*, is_ros1: bool) -> Any:
    """Message definitions of ROS, with the transforms of tf and tf2."""
    types = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    for name in (TF2, OLD_TF):
        types.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms\n", name))
    return types


def header(time: float, frame: str) -> Any:
    """A header; ROS 2 ignores its sequence number."""
    stamp = SimpleNamespace(sec=math.floor(time), nanosec=round(time % 1 * 1e9))
    return SimpleNamespace(seq=0, stamp=stamp, frame_id=frame)


def vector(x: float, y: float, z: float) -> Any:
    """A point or vector."""
    return SimpleNamespace(x=x, y=y, z=z)


def rotation(values: Quaternion) -> Any:
    """A quaternion."""
    x, y, z, w = values
    return SimpleNamespace(x=x, y=y, z=z, w=w)


def read_back(bag: SmallBag, folder: Path, **options: object) -> LidarLog:
    """Write a bag and read it again."""
    folder.mkdir(exist_ok=True)
    return read_bag(bag.write(folder / f"run{'.bag' * (bag.kind == 'ros1')}"), ReadingOptions(**options))  # type: ignore[arg-type]
