"""ROS bags of both kinds hold the same log."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wherry.bags import is_bag, read_bag
from wherry.errors import InputError

rosbags = pytest.importorskip("rosbags.typesys", reason="the rosbags package is not installed")
rosbag1 = pytest.importorskip("rosbags.rosbag1")
rosbag2 = pytest.importorskip("rosbags.rosbag2")


def store(kind: str) -> Any:
    stores = rosbags.Stores
    return rosbags.get_typestore(stores.ROS1_NOETIC if kind == "ros1" else stores.ROS2_HUMBLE)


def header(types: Any, kind: str, time: float, frame: str, number: int) -> Any:
    stamp = types["builtin_interfaces/msg/Time"](sec=int(time), nanosec=round(time % 1 * 1e9))
    first = {"seq": number} if kind == "ros1" else {}
    return types["std_msgs/msg/Header"](**first, stamp=stamp, frame_id=frame)


def laser(types: Any, kind: str, number: int, time: float, ranges: list[float]) -> Any:
    return types["sensor_msgs/msg/LaserScan"](
        header=header(types, kind, time, "laser", number),
        angle_min=-1.0,
        angle_max=1.0,
        angle_increment=0.5,
        time_increment=0.0,
        scan_time=0.1,
        range_min=0.1,
        range_max=10.0,
        ranges=np.array(ranges, np.float32),
        intensities=np.zeros(0, np.float32),
    )


def odom(types: Any, kind: str, number: int, time: float, x: float) -> Any:
    vector, half = types["geometry_msgs/msg/Vector3"], 0.25
    pose = types["geometry_msgs/msg/Pose"](
        position=types["geometry_msgs/msg/Point"](x=x, y=0.0, z=0.0),
        orientation=types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=math.sin(half), w=math.cos(half)),
    )
    twist = types["geometry_msgs/msg/Twist"](linear=vector(x=0.0, y=0.0, z=0.0), angular=vector(x=0.0, y=0.0, z=0.0))
    return types["nav_msgs/msg/Odometry"](
        header=header(types, kind, time, "odom", number),
        child_frame_id="base_link",
        pose=types["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=np.zeros(36)),
        twist=types["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=np.zeros(36)),
    )


def write(folder: Path, kind: str, scans: list[tuple[float, list[float]]]) -> Path:
    """A bag with odometry at 0 and 10 s and some scans."""
    typestore = store(kind)
    types = typestore.types
    messages = [("/odom", odom(types, kind, n, t, x), t) for n, (t, x) in enumerate(((0.0, 0.0), (10.0, 5.0)))]
    messages += [("/scan", laser(types, kind, n, t, ranges), t) for n, (t, ranges) in enumerate(scans)]
    path = folder / ("some.bag" if kind == "ros1" else kind)
    if kind == "ros1":
        writer: Any = rosbag1.Writer(path)
    else:
        plugin = rosbag2.StoragePlugin.MCAP if kind == "mcap" else rosbag2.StoragePlugin.SQLITE3
        writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)
    with writer:
        connections = {
            topic: writer.add_connection(topic, message.__msgtype__, typestore=typestore)
            for topic, message, _ in messages[-1:] + messages[:1]
        }
        for topic, message, time in messages:
            raw = typestore.serialize_ros1 if kind == "ros1" else typestore.serialize_cdr
            writer.write(connections[topic], int(time * 1e9) + 1, raw(message, message.__msgtype__))
    return path


GOOD = [(2.0, [1.0, 2.0, math.nan, math.inf, 20.0]), (4.0, [1.5, 2.5, 3.0, 4.0, 5.0])]


@pytest.mark.parametrize("kind", ["ros1", "mcap", "sqlite"])
def test_a_bag_is_a_log(tmp_path: Path, kind: str) -> None:
    path = write(tmp_path, kind, GOOD)
    assert is_bag(path)
    log = read_bag(path)
    assert [scan.time for scan in log.scans] == [2.0, 4.0]
    np.testing.assert_array_equal(log.scans[0].ranges, [1.0, 2.0, np.nan, np.inf, np.inf])
    assert (log.scans[0].angle_min, log.scans[0].angle_increment) == (-1.0, 0.5)
    assert log.scan_odometry[0] is not None
    pose = log.scan_odometry[0].pose
    assert (pose.x, pose.y, pose.theta) == pytest.approx((1.0, 0.0, 0.5))
    np.testing.assert_allclose(log.odometry.times, [0.0, 10.0])


def test_a_broken_message_is_named_or_left_out(tmp_path: Path) -> None:
    path = write(tmp_path, "ros1", [*GOOD, (5.0, [1.0]), (6.0, GOOD[1][1])])
    with pytest.raises(InputError, match="scan 3: has 1 beams"):
        read_bag(path)
    log = read_bag(path, lenient=True)
    assert [scan.time for scan in log.scans] == [2.0, 4.0, 6.0]
    assert log.skipped == ("scan 3: has 1 beams where the scans before have 5",)


def test_what_is_no_bag_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "some.bag"
    for content in (b"", b"nonsense"):
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"some\.bag"):
            read_bag(path)
    with pytest.raises(InputError):
        read_bag(tmp_path / "missing.mcap")
    assert not is_bag(tmp_path / "some.log")
