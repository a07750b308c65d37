"""Bags of ROS 1 and ROS 2 are read as lidar logs, and damaged ones are refused in one line."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.logs.options import ReadingOptions
from wherry.ros.bags.reading import is_bag, read_bag

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
def test_a_bag_is_read_as_a_log(tmp_path: Path, kind: str) -> None:
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


def test_a_broken_message_is_named_or_skipped(tmp_path: Path) -> None:
    path = write(tmp_path, "ros1", [*GOOD, (5.0, [1.0]), (6.0, GOOD[1][1])])
    with pytest.raises(InputError, match="/scan, message 3: has 1 beams"):
        read_bag(path)
    log = read_bag(path, ReadingOptions(lenient=True))
    assert [scan.time for scan in log.scans] == [2.0, 4.0, 6.0]
    assert log.skipped == ("/scan, message 3: has 1 beams where the scans before have 5",)


def test_a_file_that_is_not_a_bag_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "some.bag"
    for content in (b"", b"nonsense"):
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"some\.bag"):
            read_bag(path)
    with pytest.raises(InputError):
        read_bag(tmp_path / "missing.mcap")
    assert not is_bag(tmp_path / "some.log")


@pytest.mark.parametrize("kind", ["ros1", "mcap", "sqlite"])
def test_a_truncated_bag_is_refused_in_one_line(tmp_path: Path, kind: str) -> None:
    path = write(tmp_path, kind, [(2.0 + n, GOOD[0][1]) for n in range(50)])
    file = path if kind == "ros1" else next(entry for entry in path.iterdir() if entry.suffix in (".mcap", ".db3"))
    whole = file.read_bytes()
    for share in (0.02, 0.3, 0.6, 0.97):
        file.write_bytes(whole[: int(len(whole) * share)])
        with pytest.raises(InputError) as caught:
            read_bag(path)
        assert str(path) in str(caught.value)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["ros1", "mcap", "sqlite"])
def test_flipped_bits_end_in_a_log_or_an_error_of_one_line(tmp_path: Path, kind: str) -> None:
    path = write(tmp_path, kind, [(2.0 + n, GOOD[0][1]) for n in range(5)])
    file = path if kind == "ros1" else next(entry for entry in path.iterdir() if entry.suffix in (".mcap", ".db3"))
    whole = file.read_bytes()
    rng = np.random.default_rng(3)
    refused = []
    for _ in range(30):
        damaged = bytearray(whole)
        for place in rng.integers(0, len(whole), 8):
            damaged[place] ^= 1 << int(rng.integers(8))
        file.write_bytes(bytes(damaged))
        try:
            assert read_bag(path).scans
        except InputError as error:
            refused.append(str(error))
    assert refused
    assert not any("\n" in line for line in refused)


def test_the_error_of_a_bag_without_scans_names_the_type_of_its_scan_topic(tmp_path: Path) -> None:
    types = store("mcap")
    with rosbag2.Writer(tmp_path / "bag", version=9, storage_plugin=rosbag2.StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/scan", "std_msgs/msg/String", typestore=types)
        text = types.types["std_msgs/msg/String"](data="a scan")
        writer.write(connection, 1, types.serialize_cdr(text, "std_msgs/msg/String"))
    with pytest.raises(InputError, match=r"no usable LaserScan.*its /scan is of std_msgs/msg/String"):
        read_bag(tmp_path / "bag")


def test_the_error_of_a_bag_with_only_broken_scans_names_the_first(tmp_path: Path) -> None:
    path = write(tmp_path, "mcap", [(1.0, [])])
    with pytest.raises(InputError, match="/scan, message 1: has 0 beams"):
        read_bag(path)
    with pytest.raises(InputError, match="1 skipped, the first: /scan, message 1: has 0 beams"):
        read_bag(path, ReadingOptions(lenient=True))


def test_more_scans_than_fit_into_memory_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path, "mcap", [(2.0 + n, GOOD[0][1]) for n in range(5)])
    monkeypatch.setattr("wherry.ros.bags.reading.MAX_RANGES", 12)
    with pytest.raises(InputError, match="/scan, message 3"):
        read_bag(path)


@pytest.mark.parametrize("name", ["run.bag.active", "run.active"])
def test_a_recording_that_was_cut_off_is_not_read(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"")
    assert is_bag(tmp_path / name)
    with pytest.raises(InputError, match="cut off"):
        read_bag(tmp_path / name)


def transform(types: Any, parent: str, child: str, time: float, x: float) -> Any:
    return types["geometry_msgs/msg/TransformStamped"](
        header=header(types, "mcap", time, parent, 0),
        child_frame_id=child,
        transform=types["geometry_msgs/msg/Transform"](
            translation=types["geometry_msgs/msg/Vector3"](x=x, y=0.0, z=0.0),
            rotation=types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
        ),
    )


def test_without_odometry_messages_transforms_give_the_odometry(tmp_path: Path) -> None:
    typestore = store("mcap")
    types = typestore.types
    tf = types["tf2_msgs/msg/TFMessage"]
    frames = [("map", "odom", 9.0), ("odom", "base_footprint", 1.0), ("base_footprint", "laser", 0.25)]
    with rosbag2.Writer(tmp_path / "bag", version=9, storage_plugin=rosbag2.StoragePlugin.MCAP) as writer:
        to_tf = writer.add_connection("/tf", tf.__msgtype__, typestore=typestore)
        to_scan = writer.add_connection("/scan", "sensor_msgs/msg/LaserScan", typestore=typestore)
        for time in (0.0, 4.0):
            links = [transform(types, parent, child, time, x * (1 + (x == 1.0) * time)) for parent, child, x in frames]
            writer.write(to_tf, int(time * 1e9) + 1, typestore.serialize_cdr(tf(links), tf.__msgtype__))
        scan = laser(types, "mcap", 0, 2.0, GOOD[0][1])
        writer.write(to_scan, int(2e9), typestore.serialize_cdr(scan, scan.__msgtype__))
    log = read_bag(tmp_path / "bag")
    np.testing.assert_allclose(log.odometry.poses[:, 0], [1.0, 5.0])
    assert log.scan_odometry[0] is not None
    assert log.scan_odometry[0].pose.x == pytest.approx(3.0)
    assert log.lidar.x == 0.25


def test_odometry_whose_time_runs_backwards_is_named(tmp_path: Path) -> None:
    typestore = store("ros1")
    types = typestore.types
    path = tmp_path / "some.bag"
    with rosbag1.Writer(path) as writer:
        connection = writer.add_connection("/odom", "nav_msgs/msg/Odometry", typestore=typestore)
        for number, time in enumerate((2.0, 1.0)):
            raw = typestore.serialize_ros1(odom(types, "ros1", number, time, 0.0), "nav_msgs/msg/Odometry")
            writer.write(connection, number + 1, raw)
    with pytest.raises(InputError, match=r"/odom, message 2: time runs backwards, from 2\.000000 to 1\.000000"):
        read_bag(path)
