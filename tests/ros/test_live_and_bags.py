"""Bags are decoded as live ROS is: the same values, and the same messages are rejected for the same reasons."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from wherry.errors import InputError
from wherry.logs.options import ReadingOptions
from wherry.robot import Odometry, Scan, Velocity
from wherry.ros import messages as ros
from wherry.ros.bags.reading import read_bag
from wherry.ros.bags.writer import BagWriter
from wherry.ros.body_files import load_body
from wherry.ros.decoding import (
    MessageError,
    decode_laser_scan,
    decode_odometry,
    decode_rigid_transform,
    decode_transform,
)
from wherry.ros.encoding import encode_laser_scan, encode_odometry, encode_transform
from wherry.ros.message_fields import Message
from wherry.ros.names import load_names
from wherry.ros.nodes.latch_protocol import LatchState, encode_latch_state
from wherry.ros.nodes.robot import RosRobot
from wherry.ros.transforms import StampedTransform
from wherry.space.pose import Pose
from wherry_testing.bus import Bus

pytest.importorskip("rosbags", reason="the rosbags package is not installed")

NAMES = load_names()
TOPICS = NAMES.topics
SCAN = encode_laser_scan(Scan(1.5, np.array([1.0, 2.0, 3.0]), -0.5, 0.5, 0.25, 12.0), "laser")
ODOMETRY = encode_odometry(Odometry(1.5, Pose(1.0, 2.0, 0.5), Velocity(0.3, -0.2)), "odom", "base_link", np.zeros(36))
MOUNT = encode_transform(StampedTransform("base_link", "laser", 1.0, Pose(0.1, 0.0, 0.2)), z=0.3)
BROKEN_SCANS = {
    "impossible stamp": replace(SCAN, header=ros.Header(ros.Time(-5), "laser")),
    "angle_min is NaN": replace(SCAN, angle_min=math.nan),
    "increment is NaN": replace(SCAN, angle_increment=math.nan),
    "increment is zero": replace(SCAN, angle_increment=0.0, angle_max=-0.5),
    "more than a revolution": replace(SCAN, angle_increment=7.0, angle_max=13.5),
    "contradictory angles": replace(SCAN, angle_increment=0.125),
    "range_max is NaN": replace(SCAN, range_max=math.nan),
    "range_max below range_min": replace(SCAN, range_max=0.125),
    "no beams": replace(SCAN, ranges=np.zeros(0, np.float32)),
    "too many beams": replace(SCAN, ranges=np.zeros(30_000, np.float32), angle_increment=1e-5),
}


def with_orientation(x: float, y: float, z: float, w: float) -> ros.Odometry:
    pose = ros.Pose(ODOMETRY.pose.pose.position, ros.Quaternion(x, y, z, w))
    return replace(ODOMETRY, pose=ros.PoseWithCovariance(pose))


def with_rotation(x: float, y: float, z: float, w: float) -> ros.TransformStamped:
    return replace(MOUNT, transform=ros.Transform(MOUNT.transform.translation, ros.Quaternion(x, y, z, w)))


BROKEN_ODOMETRY = {
    "impossible stamp": replace(ODOMETRY, header=ros.Header(ros.Time(0, 1_000_000_000), "odom")),
    "zero quaternion": with_orientation(0.0, 0.0, 0.0, 0.0),
    "quaternion of norm √2": with_orientation(0.0, 0.0, 1.0, 1.0),
    "quaternion with NaN": with_orientation(0.0, 0.0, math.nan, 1.0),
    "position is NaN": replace(ODOMETRY, pose=ros.PoseWithCovariance(ros.Pose(ros.Point(math.nan)))),
    "position beyond bounds": replace(ODOMETRY, pose=ros.PoseWithCovariance(ros.Pose(ros.Point(y=2e6)))),
    "speed is NaN": replace(ODOMETRY, twist=ros.TwistWithCovariance(ros.Twist(ros.Vector3(math.nan)))),
}
ZERO_MOUNT = with_rotation(0.0, 0.0, 0.0, 0.0)
BROKEN_MOUNTS = {
    "zero quaternion": ZERO_MOUNT,
    "quaternion with NaN": with_rotation(0.0, 0.0, math.nan, 1.0),
    "position is NaN": replace(MOUNT, transform=ros.Transform(ros.Vector3(math.nan), ros.Quaternion(w=1.0))),
}
MOUNTS = {
    "plain": MOUNT,
    "upside down": with_rotation(1.0, 0.0, 0.0, 0.0),
    "pitched by half a turn": with_rotation(0.0, 1.0, 0.0, 0.0),
    "upside down and turned": with_rotation(math.cos(0.25), math.sin(0.25), 0.0, 0.0),
    "tilted a little": with_rotation(math.sin(0.05), 0.0, 0.0, math.cos(0.05)),
}
TILTED_MOUNTS = {
    "rolled by 0.3 rad": with_rotation(math.sin(0.15), 0.0, 0.0, math.cos(0.15)),
    "pitched by -0.3 rad": with_rotation(0.0, math.sin(-0.15), 0.0, math.cos(0.15)),
}


def record(path: Path, *messages: Message) -> Path:
    """A bag of scans, odometry and static transforms, in the given order."""
    with BagWriter(path) as bag:
        for number, message in enumerate(messages):
            if isinstance(message, ros.LaserScan):
                bag.write(TOPICS.scan, message, number)
            elif isinstance(message, ros.Odometry):
                bag.write(TOPICS.odom, message, number)
            elif isinstance(message, ros.TransformStamped):
                bag.write(TOPICS.tf_static, ros.TFMessage((message,)), number)
    return path


@pytest.fixture(params=["run.bag", "run.mcap"])
def path(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    return tmp_path / request.param


@pytest.mark.parametrize(
    "message",
    [
        SCAN,
        replace(SCAN, ranges=np.array([-np.inf, 13.0, np.nan], np.float32)),
        replace(SCAN, angle_min=1.0, angle_max=0.0, angle_increment=-0.5, time_increment=0.0625),
        replace(SCAN, angle_increment=0.0),
        replace(SCAN, range_max=math.inf),
        replace(SCAN, range_max=0.0),
        replace(SCAN, time_increment=math.nan),
        replace(SCAN, ranges=np.array([12.0, 11.9999, 11.98], np.float32)),
    ],
    ids=[
        "plain",
        "beyond the limits",
        "clockwise",
        "without increment",
        "range_max is infinite",
        "range_max is zero",
        "time_increment is NaN",
        "near range_max",
    ],
)
def test_scans_have_the_same_values(path: Path, message: ros.LaserScan) -> None:
    remarks: list[str] = []
    live = decode_laser_scan(message, None, remarks.append)
    log = read_bag(record(path, message))
    (scan,) = log.scans
    assert [note for note in log.notes if note.startswith("/scan: ")] == [f"/scan: {r} (1 of 1 scans)" for r in remarks]
    assert_array_equal(scan.ranges, live.ranges)
    assert (scan.time, scan.time_increment) == (live.time, live.time_increment)
    limits = (live.angle_min, live.angle_increment, live.range_min, live.range_max)
    assert (scan.angle_min, scan.angle_increment, scan.range_min, scan.range_max) == pytest.approx(limits, rel=1e-7)


def test_a_clockwise_lidar_is_reversed_in_a_bag(path: Path) -> None:
    message = replace(SCAN, angle_min=1.0, angle_max=0.0, angle_increment=-0.5, time_increment=0.0625)
    (scan,) = read_bag(record(path, message)).scans
    assert scan.time_increment == -0.0625
    assert scan.angles.tolist() == [0.0, 0.5, 1.0]
    assert scan.ranges.tolist() == [3.0, 2.0, 1.0]


def test_minus_infinity_in_a_bag_is_an_obstacle_that_is_too_near(path: Path) -> None:
    (scan,) = read_bag(record(path, replace(SCAN, ranges=np.array([-np.inf, 13.0, 2.0], np.float32)))).scans
    assert scan.ranges.tolist() == [0.25, np.inf, 2.0]


@pytest.mark.parametrize("case", BROKEN_SCANS)
def test_broken_scans_are_rejected_for_the_same_reason(path: Path, case: str) -> None:
    with pytest.raises(MessageError) as live:
        decode_laser_scan(BROKEN_SCANS[case])
    record(path, BROKEN_SCANS[case], replace(SCAN, header=ros.Header(ros.Time(9), "laser")))
    with pytest.raises(InputError) as caught:
        read_bag(path)
    assert str(caught.value).startswith(f"{path}: /scan, message 1: ")
    assert_same_reason(caught.value.reason.removesuffix(" (--lenient leaves it out)"), str(live.value))
    log = read_bag(path, ReadingOptions(lenient=True))
    assert [scan.time for scan in log.scans] == [9.0]
    assert [line.partition(": ")[0] for line in log.skipped] == ["/scan, message 1"]


def assert_same_reason(found: str, live: str) -> None:
    """The same words; numbers may differ, as bags hold float32."""
    assert [word for word in found.split() if word.isalpha()] == [word for word in live.split() if word.isalpha()]


@pytest.mark.parametrize("case", BROKEN_ODOMETRY)
def test_broken_odometry_is_rejected_for_the_same_reason(path: Path, case: str) -> None:
    with pytest.raises(MessageError) as live:
        decode_odometry(BROKEN_ODOMETRY[case])
    record(path, MOUNT, ODOMETRY, BROKEN_ODOMETRY[case], SCAN)
    with pytest.raises(InputError) as caught:
        read_bag(path)
    assert str(caught.value) == f"{path}: /odom, message 2: {live.value} (--lenient leaves it out)"
    assert read_bag(path, ReadingOptions(lenient=True)).skipped == (f"/odom, message 2: {live.value}",)


def live_robot(*messages: Message) -> RosRobot:
    """A robot that has received a mount, odometry and a scan."""
    bus = Bus()
    robot = RosRobot(bus.node(), NAMES, load_body())
    bus.publish(TOPICS.latch_state, encode_latch_state(LatchState(1.0, False, 0.0)))
    for message in messages:
        if isinstance(message, ros.LaserScan):
            bus.publish(TOPICS.scan, message)
        elif isinstance(message, ros.Odometry):
            bus.publish(TOPICS.odom, message)
        elif isinstance(message, ros.TransformStamped):
            bus.publish(TOPICS.tf_static, ros.TFMessage((message,)))
    return robot


@pytest.mark.parametrize("case", MOUNTS)
def test_a_mount_and_its_scans_are_the_same(path: Path, case: str) -> None:
    messages = (MOUNTS[case], ODOMETRY, SCAN)
    with live_robot(*messages) as robot:
        robot.wait_until_ready(1.0)
        robot.receive()
        live = robot.receive()
        assert isinstance(live, Scan)
        log = read_bag(record(path, *messages))
        assert log.lidar == robot.body.lidar
    assert_array_equal(log.scans[0].ranges, live.ranges)
    assert log.scans[0].angles == pytest.approx(live.angles, rel=1e-7)


@pytest.mark.parametrize("case", BROKEN_MOUNTS)
@pytest.mark.parametrize("lenient", [False, True])
def test_a_broken_mount_is_never_replaced_by_a_guess(path: Path, case: str, lenient: bool) -> None:
    with pytest.raises(MessageError) as live:
        decode_rigid_transform(BROKEN_MOUNTS[case])
    record(path, BROKEN_MOUNTS[case], SCAN)
    with pytest.raises(InputError) as caught:
        read_bag(path, ReadingOptions(lenient=lenient))
    option = "--lidar x,y,theta states where the lidar sits (m, m, degrees)"
    assert str(caught.value) == f"{path}: /tf_static, message 1: {live.value}; {option}"
    with live_robot(BROKEN_MOUNTS[case], ODOMETRY, SCAN) as robot, pytest.raises(InputError) as caught:
        robot.wait_until_ready(0.0)
    field = "lidar in the --body file states it"
    assert str(caught.value) == f"/tf_static: frame 'laser': a transform to it {live.value}; {field}"


@pytest.mark.parametrize("case", TILTED_MOUNTS)
def test_a_tilted_mount_is_refused(path: Path, case: str) -> None:
    expected = "frame 'laser': where the lidar sits on base_link cannot be used: it is tilted by 17°"
    with pytest.raises(InputError, match=expected):
        read_bag(record(path, TILTED_MOUNTS[case], ODOMETRY, SCAN))
    with live_robot(TILTED_MOUNTS[case], ODOMETRY, SCAN) as robot, pytest.raises(InputError, match=expected):
        robot.wait_until_ready(0.0)


def test_a_lenient_reader_takes_the_next_usable_mount(path: Path) -> None:
    record(path, ZERO_MOUNT, MOUNT, SCAN)
    with pytest.raises(InputError, match="/tf_static, message 1: has the orientation"):
        read_bag(path)
    log = read_bag(path, ReadingOptions(lenient=True))
    assert log.lidar.distance_to(decode_transform(MOUNT).pose) == 0.0
    assert len(log.skipped) == 1


def test_broken_odometry_transforms_are_rejected(path: Path) -> None:
    broken = replace(ZERO_MOUNT, header=ros.Header(frame_id="odom"), child_frame_id="base_link")
    with BagWriter(path) as bag:
        bag.write(TOPICS.tf, ros.TFMessage((broken,)), 0.0)
        bag.write(TOPICS.scan, SCAN, 1.0)
    with pytest.raises(InputError, match=r"/tf, message 1: has the orientation \(0, 0, 0, 0\), which is not a unit"):
        read_bag(path)
    with pytest.raises(InputError, match="odom → base_link: no transform can be used"):
        read_bag(path, ReadingOptions(lenient=True))
