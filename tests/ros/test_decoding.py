from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wherry.robot import Odometry, Scan, Velocity
from wherry.ros import messages as ros
from wherry.ros.decoding import (
    MessageError,
    decode_laser_scan,
    decode_occupancy_grid,
    decode_odometry,
    decode_pose,
    decode_pose_estimate,
    decode_stamp,
    decode_transform,
    decode_twist,
    transforms_between,
)
from wherry.ros.encoding import (
    encode_laser_scan,
    encode_occupancy_grid,
    encode_odometry,
    encode_path,
    encode_pose,
    encode_pose_array,
    encode_stamp,
    encode_transform,
    encode_twist,
)
from wherry.ros.nodes.latch import (
    LatchCommand,
    LatchState,
    from_latch_command,
    from_latch_state,
    to_latch_command,
    to_latch_state,
)
from wherry.ros.transforms import StampedTransform
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose

SCAN = Scan(1.5, np.array([1.0, np.inf, np.nan, 0.01, 2.0]), -math.pi, 0.5, 0.02, 12.0)
MESSAGE = encode_laser_scan(SCAN, "laser")
poses = st.builds(Pose, st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(-3.1, 3.1))


@given(st.integers(0, 2**31 - 1), st.integers(0, 999_999_999))
def test_stamps_survive(sec: int, nanosec: int) -> None:
    there = encode_stamp(decode_stamp(ros.Time(sec, nanosec)))
    assert abs((there.sec - sec) * 10**9 + there.nanosec - nanosec) < 500  # float64 has 0.2 µs of today's date


def test_stamps_of_ticks_are_exact() -> None:
    assert encode_stamp(0.05) == ros.Time(0, 50_000_000)
    assert encode_stamp(2.9999999999) == ros.Time(3, 0)


@pytest.mark.parametrize("stamp", [ros.Time(-1), ros.Time(0, 1_000_000_000)])
def test_impossible_stamps_are_refused(stamp: ros.Time) -> None:
    with pytest.raises(MessageError, match="stamp"):
        decode_stamp(stamp)


@given(poses)
def test_poses_survive(pose: Pose) -> None:
    there = decode_pose(encode_pose(pose))
    assert (there.x, there.y) == (pose.x, pose.y)
    assert there.theta == pytest.approx(pose.theta, abs=1e-12)


def test_headings_are_counter_clockwise_about_z() -> None:
    quaternion = encode_pose(Pose(theta=math.pi / 2)).orientation
    assert (quaternion.x, quaternion.y) == (0.0, 0.0)
    assert quaternion.z == pytest.approx(math.sqrt(0.5))
    assert quaternion.w == pytest.approx(math.sqrt(0.5))


@pytest.mark.parametrize(
    "broken",
    [
        ros.Pose(ros.Point(math.nan)),
        ros.Pose(ros.Point(y=math.inf)),
        ros.Pose(ros.Point(2e6)),
        ros.Pose(orientation=ros.Quaternion(0.0, 0.0, 0.0, 0.0)),
        ros.Pose(orientation=ros.Quaternion(0.0, 0.0, math.nan, 1.0)),
        ros.Pose(orientation=ros.Quaternion(0.0, 0.0, 1.0, 1.0)),
    ],
)
def test_poses_that_cannot_be_are_refused(broken: ros.Pose) -> None:
    with pytest.raises(MessageError):
        decode_pose(broken)
    with pytest.raises(MessageError):
        decode_pose_estimate(
            ros.PoseWithCovarianceStamped(ros.Header(frame_id="map"), ros.PoseWithCovariance(broken)), "map"
        )


def test_scans_survive_as_float32() -> None:
    there = decode_laser_scan(MESSAGE, "laser")
    np.testing.assert_array_equal(there.ranges, SCAN.ranges.astype(np.float32))
    assert (there.time, there.angle_increment, there.range_max) == (1.5, 0.5, 12.0)
    assert MESSAGE.angle_max == pytest.approx(SCAN.angles[-1])


def test_what_is_beyond_a_lidars_limits_is_read_as_rep_117_says() -> None:
    message = replace(MESSAGE, ranges=np.array([-np.inf, 13.0, 0.0, np.nan], np.float32))
    there = decode_laser_scan(message, "/laser")
    np.testing.assert_array_equal(there.ranges, [there.range_min, np.inf, 0.0, np.nan])
    assert there.valid.tolist() == [True, False, False, False]


def test_a_lidar_that_turns_clockwise_is_turned_around() -> None:
    message = replace(MESSAGE, angle_min=1.0, angle_increment=-0.5, ranges=np.array([1, 2, 3], np.float32))
    there = decode_laser_scan(message, "laser")
    assert there.angles.tolist() == [0.0, 0.5, 1.0]
    assert there.ranges.tolist() == [3.0, 2.0, 1.0]


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"header": ros.Header(frame_id="camera")}, "camera"),
        ({"header": ros.Header(ros.Time(-5), "laser")}, "stamp"),
        ({"angle_min": math.nan}, "not finite"),
        ({"angle_increment": math.inf}, "not finite"),
        ({"angle_increment": 0.0}, "rad apart"),
        ({"angle_increment": 3.0}, "rad apart"),
        ({"range_min": -1.0}, "ranges from"),
        ({"range_max": 0.0}, "ranges from"),
        ({"range_max": math.nan}, "not finite"),
        ({"range_max": 1e9}, "ranges from"),
        ({"ranges": np.zeros(0, np.float32)}, "0 beams"),
        ({"ranges": np.zeros(30_000, np.float32), "angle_increment": 1e-5}, "30000 beams"),
    ],
)
def test_scans_that_cannot_be_are_refused(changes: dict[str, object], reason: str) -> None:
    with pytest.raises(MessageError, match=reason):
        decode_laser_scan(replace(MESSAGE, **changes), "laser")


def test_odometry_survives() -> None:
    odometry = Odometry(3.25, Pose(1.0, 2.0, 0.5), Velocity(0.3, -0.2))
    message = encode_odometry(odometry, "odom", "base_link", np.zeros(36))
    there = decode_odometry(message, "odom", "base_link")
    assert (there.time, there.velocity) == (odometry.time, odometry.velocity)
    assert there.pose.theta == pytest.approx(0.5)
    for frame, child in (("map", "base_link"), ("odom", "base_footprint")):
        with pytest.raises(MessageError, match="instead of"):
            decode_odometry(message, frame, child)


@pytest.mark.parametrize(
    "twist",
    [
        ros.Twist(ros.Vector3(math.nan)),
        ros.Twist(ros.Vector3(y=math.nan)),
        ros.Twist(angular=ros.Vector3(z=-math.inf)),
        ros.Twist(ros.Vector3(1e3)),
    ],
)
def test_speeds_that_cannot_be_are_refused(twist: ros.Twist) -> None:
    with pytest.raises(MessageError, match="speed"):
        decode_twist(twist)


@given(st.floats(-10, 10), st.floats(-10, 10))
def test_velocities_survive(linear: float, angular: float) -> None:
    assert decode_twist(encode_twist(Velocity(linear, angular))) == Velocity(linear, angular)


@given(poses)
def test_transforms_survive(pose: Pose) -> None:
    message = encode_transform(StampedTransform("odom", "base_link", 2.0, pose), z=0.3)
    there = decode_transform(message)
    assert (there.parent, there.child, there.time) == ("odom", "base_link", 2.0)
    assert there.pose.distance_to(pose) == 0.0
    assert message.transform.translation.z == 0.3


def test_a_lidar_upside_down_is_refused() -> None:
    message = encode_transform(StampedTransform("base_link", "laser", 0.0, Pose()))
    message = replace(message, transform=ros.Transform(rotation=ros.Quaternion(1.0, 0.0, 0.0, 0.0)))
    with pytest.raises(MessageError, match="upright"):
        decode_transform(message)
    assert list(transforms_between(ros.TFMessage((message,)), "odom", "base_link")) == []  # not looked at


def test_maps_survive_as_free_occupied_or_unknown() -> None:
    probability = np.array([[0.0, 1.0, 0.5], [0.1, 0.9, 0.3]], np.float32)
    grid = OccupancyGrid(probability, 0.05, Pose(-1.0, 2.0, 0.3))
    message = encode_occupancy_grid(grid, 4.0, "map")
    assert message.data.tolist() == [0, 100, -1, 0, 100, -1]
    assert (message.info.width, message.info.height) == (3, 2)
    there = decode_occupancy_grid(message, "map")
    np.testing.assert_array_equal(there.occupied, grid.occupied)
    np.testing.assert_array_equal(there.free, grid.free)
    assert there.resolution == 0.05
    assert there.origin.theta == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"header": ros.Header(frame_id="odom")}, "odom"),
        ({"data": np.zeros(5, np.int8)}, "5 values"),
        ({"data": np.full(6, 101, np.int8)}, "percentage"),
        ({"data": np.full(6, -2, np.int8)}, "percentage"),
        ({"info": ros.MapMetaData(resolution=math.nan, width=3, height=2)}, "cells of nan"),
        ({"info": ros.MapMetaData(resolution=0.0, width=3, height=2)}, "cells of 0"),
        ({"info": ros.MapMetaData(resolution=0.05)}, "0 × 0"),
        ({"info": ros.MapMetaData(resolution=0.05, width=2**31, height=2**31)}, "possible"),
    ],
)
def test_maps_that_cannot_be_are_refused(changes: dict[str, object], reason: str) -> None:
    message = encode_occupancy_grid(OccupancyGrid(np.zeros((2, 3), np.float32), 0.05), 0.0, "map")
    with pytest.raises(MessageError, match=reason):
        decode_occupancy_grid(replace(message, **changes), "map")


def test_a_paths_poses_look_ahead() -> None:
    path = encode_path(np.array([[0, 0], [1, 0], [1, 1]], np.float32), 1.0, "map")
    headings = [decode_pose(stamped.pose).theta for stamped in path.poses]
    assert headings == pytest.approx([0.0, math.pi / 2, math.pi / 2])
    assert len(encode_path(np.empty((0, 2)), 1.0, "map").poses) == 0
    assert decode_pose(encode_path(np.array([[2.0, 3.0]]), 1.0, "map").poses[0].pose) == Pose(2.0, 3.0, 0.0)


def test_particles_become_poses() -> None:
    message = encode_pose_array(np.array([[1, 2, 0.5], [3, 4, -0.5]], np.float32), 2.0, "map")
    assert [decode_pose(pose).x for pose in message.poses] == [1.0, 3.0]
    assert decode_pose(message.poses[1]).theta == pytest.approx(-0.5)


@pytest.mark.parametrize("close", [True, False])
def test_latch_commands_survive(close: bool) -> None:
    command = LatchCommand(12.345678, close)
    assert from_latch_command(to_latch_command(command)) == command


def test_a_latchs_answer_belongs_to_one_command() -> None:
    command = LatchCommand(1_700_000_000.123456, close=True)
    there = from_latch_command(to_latch_command(command))
    state = from_latch_state(to_latch_state(LatchState(5.0, loaded=True, answered=there.number)))
    assert state.loaded
    assert state.answers(command)
    assert not state.answers(LatchCommand(command.number + 1e-3, close=True))


@pytest.mark.parametrize(
    "message",
    [
        ros.JointState(),
        ros.JointState(name=("latch",)),
        ros.JointState(name=("latch",), position=np.array([0.5])),
        ros.JointState(name=("latch",), position=np.array([math.nan])),
        ros.JointState(name=("load", "answered"), position=np.array([2.0, 0.0])),
        ros.JointState(name=("load", "answered"), position=np.array([1.0, math.nan])),
    ],
)
def test_latch_messages_that_say_nothing_are_refused(message: ros.JointState) -> None:
    with pytest.raises(MessageError):
        from_latch_command(message)
    with pytest.raises(MessageError):
        from_latch_state(message)
