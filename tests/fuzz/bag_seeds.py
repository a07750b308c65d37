"""Small bags of ROS 1 and ROS 2 with scans, odometry and transforms."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

TIMES = (100.0, 100.5, 101.0, 101.5)


def write_bag(folder: Path, kind: str, *, compressed: bool = False) -> Path:
    """Write a bag of some scans in a corridor.

    Args:
        folder: Existing folder that it is written into.
        kind: ``ros1``, ``sqlite`` or ``mcap``.
        compressed: Whether the chunks of a ROS 1 bag are compressed.
    """
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store: Any = get_typestore(Stores.ROS1_NOETIC if kind == "ros1" else Stores.ROS2_HUMBLE)
    if "tf2_msgs/msg/TFMessage" not in store.types:
        definition = "geometry_msgs/TransformStamped[] transforms"
        store.register(get_types_from_msg(definition, "tf2_msgs/msg/TFMessage"))
    writer: Any
    if kind == "ros1":
        path = folder / "drive.bag"
        writer = Writer1(path)
        if compressed:
            writer.set_compression(Writer1.CompressionFormat.BZ2)
    else:
        path = folder / "drive"
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer = Writer2(path, version=9, storage_plugin=plugin)
    serialize = store.serialize_ros1 if kind == "ros1" else store.serialize_cdr
    with writer:
        connections: dict[str, Any] = {}
        for topic, message, time in _messages(store.types, kind == "ros1"):
            name = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=store)
            writer.write(connections[topic], int(time * 1e9), bytes(serialize(message, name)))
    return path


def _messages(types: Mapping[str, Any], is_ros1: bool) -> list[tuple[str, Any, float]]:
    """Topics, messages and times of the bag."""
    vector, quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    point, pose = types["geometry_msgs/msg/Point"], types["geometry_msgs/msg/Pose"]

    def header(time: float, frame: str) -> Any:
        stamp = types["builtin_interfaces/msg/Time"](sec=int(time), nanosec=round(time % 1 * 1e9))
        return types["std_msgs/msg/Header"](**({"seq": 0} if is_ros1 else {}), stamp=stamp, frame_id=frame)

    def transform(time: float, parent: str, child: str, x: float) -> Any:
        return types["geometry_msgs/msg/TransformStamped"](
            header=header(time, parent),
            child_frame_id=child,
            transform=types["geometry_msgs/msg/Transform"](
                translation=vector(x=x, y=0.0, z=0.1), rotation=quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
            ),
        )

    def odometry(time: float) -> Any:
        x = 0.4 * (time - TIMES[0])
        turn = quaternion(x=0.0, y=0.0, z=math.sin(0.05 * x), w=math.cos(0.05 * x))
        zero = vector(x=0.0, y=0.0, z=0.0)
        return types["nav_msgs/msg/Odometry"](
            header=header(time, "odom"),
            child_frame_id="base_link",
            pose=types["geometry_msgs/msg/PoseWithCovariance"](
                pose=pose(position=point(x=x, y=0.1 * x, z=0.0), orientation=turn), covariance=np.zeros(36)
            ),
            twist=types["geometry_msgs/msg/TwistWithCovariance"](
                twist=types["geometry_msgs/msg/Twist"](linear=zero, angular=zero), covariance=np.zeros(36)
            ),
        )

    def scan(time: float) -> Any:
        return types["sensor_msgs/msg/LaserScan"](
            header=header(time, "laser"),
            angle_min=-1.5,
            angle_max=1.5,
            angle_increment=0.1,
            time_increment=0.001,
            scan_time=0.1,
            range_min=0.1,
            range_max=10.0,
            ranges=np.linspace(1.0, 4.0 + time - TIMES[0], 31, dtype=np.float32),
            intensities=np.zeros(0, np.float32),
        )

    transforms = types["tf2_msgs/msg/TFMessage"]
    messages = [("/tf_static", transforms(transforms=[transform(TIMES[0], "base_link", "laser", 0.2)]), TIMES[0])]
    for time in TIMES:
        messages.append(("/odom", odometry(time), time))
        messages.append(("/tf", transforms(transforms=[transform(time, "odom", "base_link", 0.0)]), time))
        messages.append(("/scan", scan(time), time))
    return messages
