"""Decoding of messages: round trips with the encoder, and messages that are rejected."""

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
    ANGLE_MAX_IGNORED,
    INCREMENT_REPLACED,
    NO_RANGE_MAX,
    TIMES_IGNORED,
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
    encode_pose,
    encode_stamp,
    encode_transform,
    encode_twist,
)
from wherry.ros.transforms import StampedTransform
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose

SCAN = Scan(1.5, np.array([1.0, np.inf, np.nan, 0.01, 2.0]), -math.pi, 0.5, 0.02, 12.0)
MESSAGE = encode_laser_scan(SCAN, "laser")
poses = st.builds(Pose, st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(-3.1, 3.1))


@given(st.integers(0, 2**31 - 1), st.integers(0, 999_999_999))
def test_stamps_survive_the_round_trip(sec: int, nanosec: int) -> None:
    decoded = encode_stamp(decode_stamp(ros.Time(sec, nanosec)))
    resolution = 500  # ns, of today's time in float64
    assert abs((decoded.sec - sec) * 10**9 + decoded.nanosec - nanosec) < resolution


@pytest.mark.parametrize("stamp", [ros.Time(-1), ros.Time(0, 1_000_000_000)])
def test_impossible_stamps_are_rejected(stamp: ros.Time) -> None:
    with pytest.raises(MessageError, match="stamp"):
        decode_stamp(stamp)


@given(poses)
def test_poses_survive_the_round_trip(pose: Pose) -> None:
    decoded = decode_pose(encode_pose(pose))
    assert (decoded.x, decoded.y) == (pose.x, pose.y)
    assert decoded.theta == pytest.approx(pose.theta, abs=1e-12)


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
def test_poses_without_a_position_or_a_unit_quaternion_are_rejected(broken: ros.Pose) -> None:
    with pytest.raises(MessageError):
        decode_pose(broken)
    with pytest.raises(MessageError):
        decode_pose_estimate(
            ros.PoseWithCovarianceStamped(ros.Header(frame_id="map"), ros.PoseWithCovariance(broken)), "map"
        )


def test_scans_survive_the_round_trip_as_float32() -> None:
    decoded = decode_laser_scan(MESSAGE, "laser")
    np.testing.assert_array_equal(decoded.ranges, SCAN.ranges.astype(np.float32))
    assert (decoded.time, decoded.angle_increment, decoded.range_max) == (1.5, 0.5, 12.0)
    assert MESSAGE.angle_max == pytest.approx(SCAN.angles[-1])


def test_ranges_outside_the_limits_are_read_as_in_rep_117() -> None:
    message = replace(MESSAGE, ranges=np.array([-np.inf, 13.0, 0.0, np.nan], np.float32))
    decoded = decode_laser_scan(message, "/laser")
    np.testing.assert_array_equal(decoded.ranges, [decoded.range_min, np.inf, 0.0, np.nan])
    assert decoded.valid.tolist() == [True, False, False, False]


def test_the_beams_of_a_clockwise_lidar_are_reversed() -> None:
    message = replace(MESSAGE, angle_min=1.0, angle_increment=-0.5, ranges=np.array([1, 2, 3], np.float32))
    decoded = decode_laser_scan(message, "laser")
    assert decoded.angles.tolist() == [0.0, 0.5, 1.0]
    assert decoded.ranges.tolist() == [3.0, 2.0, 1.0]


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"header": ros.Header(frame_id="camera")}, "camera"),
        ({"header": ros.Header(ros.Time(-5), "laser")}, "stamp"),
        ({"angle_min": math.nan}, "not a possible angle_min"),
        ({"angle_min": -180.0}, "not a possible angle_min"),
        ({"angle_increment": 0.0, "angle_max": -math.pi}, "rad apart"),
        ({"angle_increment": math.nan}, "angle_increment that is not finite"),
        ({"angle_increment": math.inf}, "angle_increment that is not finite"),
        ({"angle_increment": 3.0, "angle_max": 100.0}, "rad apart"),
        ({"angle_increment": 0.1}, "contradict each other"),
        ({"angle_increment": -0.5}, "contradict each other"),
        ({"angle_min": math.pi, "angle_max": -math.pi}, "contradict each other"),
        (
            {"angle_min": -math.pi / 2, "angle_max": math.pi / 2, "angle_increment": -math.pi / 4},
            "contradict each other",
        ),
        ({"range_min": 50.0, "range_max": 8000.0}, "ranges from 50 to 8000 m; ranges are stated in m"),
        ({"range_min": -1.0}, "ranges from"),
        ({"range_min": math.nan}, "ranges from"),
        ({"range_max": 0.01}, "ranges from"),
        ({"range_max": -1.0}, "ranges from"),
        ({"range_max": math.nan}, "ranges from"),
        ({"ranges": np.zeros(0, np.float32)}, "0 beams"),
        ({"ranges": np.zeros(30_000, np.float32), "angle_increment": 1e-5}, "30000 beams"),
    ],
)
def test_scans_with_impossible_angles_or_limits_are_rejected(changes: dict[str, object], reason: str) -> None:
    with pytest.raises(MessageError, match=reason):
        decode_laser_scan(replace(MESSAGE, **changes), "laser")


@pytest.mark.parametrize("range_max", [12.0, 5.0, 0.1, float(np.float32(5.6))])
@pytest.mark.parametrize("shortfall", [-1.0, 0.0, 1e-6, 1e-4, 0.009])
def test_a_reading_at_range_max_is_no_return(range_max: float, shortfall: float) -> None:
    ranges = np.array([range_max - shortfall, range_max - 0.02, 0.05], np.float32)
    decoded = decode_laser_scan(replace(MESSAGE, ranges=ranges, range_max=range_max))
    assert np.isinf(decoded.ranges).tolist() == [True, False, False]
    assert decoded.valid.tolist() == [False, True, True]


@pytest.mark.parametrize("range_max", [math.inf, 0.0, 1e9, 3.4e38])
def test_without_a_range_max_all_ranges_of_lidars_are_valid(range_max: float) -> None:
    remarks: list[str] = []
    message = replace(MESSAGE, range_max=range_max, ranges=np.array([30.0, np.inf, 5000.0], np.float32))
    decoded = decode_laser_scan(message, None, remarks.append)
    assert decoded.valid.tolist() == [True, False, False]
    assert np.isinf(decoded.ranges).tolist() == [False, True, True]
    assert remarks == [NO_RANGE_MAX]


def test_zero_is_no_measurement_even_if_range_min_allows_it() -> None:
    message = replace(MESSAGE, range_min=0.0, ranges=np.array([0.0, -1.0, 0.001, -np.inf], np.float32))
    assert decode_laser_scan(message).valid.tolist() == [False, False, True, False]


@pytest.mark.parametrize("increment", [0.0, -0.0, 30.0])
def test_an_impossible_increment_is_computed_from_the_limits(increment: float) -> None:
    remarks: list[str] = []
    message = replace(MESSAGE, angle_min=-1.0, angle_max=1.0, angle_increment=increment)
    assert decode_laser_scan(message, None, remarks.append).angles.tolist() == [-1.0, -0.5, 0.0, 0.5, 1.0]
    assert remarks == [INCREMENT_REPLACED]


def test_an_angle_max_that_is_wrapped_at_a_half_turn_agrees() -> None:
    message = replace(MESSAGE, angle_min=0.75 * math.pi, angle_max=0.25 * math.pi, angle_increment=0.375 * math.pi)
    np.testing.assert_allclose(decode_laser_scan(message).angles, 0.75 * math.pi + 0.375 * math.pi * np.arange(5))


@pytest.mark.parametrize("beams", [357, 359, 360, 361, 363])
@pytest.mark.parametrize("last", [math.pi, math.pi - math.tau / 360])
def test_the_number_of_beams_may_vary(beams: int, last: float) -> None:
    step = math.tau / 360
    message = replace(MESSAGE, angle_max=last, angle_increment=step, ranges=np.ones(beams, np.float32))
    decoded = decode_laser_scan(message)
    np.testing.assert_allclose(decoded.angles, -math.pi + step * np.arange(beams))


def test_an_angle_max_that_is_off_by_a_few_beams_is_said() -> None:
    remarks: list[str] = []
    message = replace(MESSAGE, angle_max=math.pi, angle_increment=math.tau / 360, ranges=np.ones(354, np.float32))
    decode_laser_scan(message, None, remarks.append)
    assert remarks == [ANGLE_MAX_IGNORED]


@pytest.mark.parametrize("norm", [0.992, 1.0, 1.008])
def test_a_quaternion_rounded_by_its_sender_is_normalized(norm: float) -> None:
    half = 0.5 * 1.9
    quaternion = ros.Quaternion(0.0, 0.0, norm * math.sin(half), norm * math.cos(half))
    assert decode_pose(ros.Pose(ros.Point(), quaternion)).theta == pytest.approx(1.9, abs=1e-12)


def test_the_times_of_the_beams_follow_their_order() -> None:
    message = replace(MESSAGE, time_increment=0.01)
    assert decode_laser_scan(message).time_increment == 0.01
    clockwise = decode_laser_scan(replace(message, angle_min=1.0, angle_max=-1.0, angle_increment=-0.5))
    assert clockwise.time_increment == -0.01
    assert clockwise.duration == pytest.approx(0.04)


@pytest.mark.parametrize("time_increment", [-0.01, math.nan, math.inf])
def test_impossible_times_of_beams_are_ignored(time_increment: float) -> None:
    remarks: list[str] = []
    assert (
        decode_laser_scan(replace(MESSAGE, time_increment=time_increment), None, remarks.append).time_increment == 0.0
    )
    assert remarks == [TIMES_IGNORED]


def test_clockwise_scans_survive_the_round_trip() -> None:
    scan = replace(SCAN, time_increment=-0.01)
    message = encode_laser_scan(scan, "laser")
    assert (message.angle_increment, message.time_increment) == (-0.5, 0.01)
    decoded = decode_laser_scan(message)
    np.testing.assert_allclose(decoded.angles, scan.angles)
    np.testing.assert_array_equal(decoded.ranges, scan.ranges.astype(np.float32))
    assert decoded.time_increment == -0.01


def test_a_scan_corrected_for_motion_has_no_message() -> None:
    scan = replace(SCAN, time_increment=0.01).deskewed(Pose(), Pose(0.1))
    with pytest.raises(ValueError, match="corrected for motion"):
        encode_laser_scan(scan, "laser")


def test_odometry_survives_the_round_trip() -> None:
    odometry = Odometry(3.25, Pose(1.0, 2.0, 0.5), Velocity(0.3, -0.2))
    message = encode_odometry(odometry, "odom", "base_link", np.zeros(36))
    decoded = decode_odometry(message, "odom", "base_link")
    assert (decoded.time, decoded.velocity) == (odometry.time, odometry.velocity)
    assert decoded.pose.theta == pytest.approx(0.5)
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
def test_impossible_speeds_are_rejected(twist: ros.Twist) -> None:
    with pytest.raises(MessageError, match="speed"):
        decode_twist(twist)


@given(st.floats(-10, 10), st.floats(-10, 10))
def test_velocities_survive_the_round_trip(linear: float, angular: float) -> None:
    assert decode_twist(encode_twist(Velocity(linear, angular))) == Velocity(linear, angular)


@given(poses)
def test_transforms_survive_the_round_trip(pose: Pose) -> None:
    message = encode_transform(StampedTransform("odom", "base_link", 2.0, pose), z=0.3)
    decoded = decode_transform(message)
    assert (decoded.parent, decoded.child, decoded.time) == ("odom", "base_link", 2.0)
    assert decoded.pose.distance_to(pose) == 0.0
    assert message.transform.translation.z == 0.3


def test_a_frame_upside_down_has_no_pose_in_the_plane() -> None:
    message = encode_transform(StampedTransform("base_link", "laser", 0.0, Pose()))
    message = replace(message, transform=ros.Transform(rotation=ros.Quaternion(1.0, 0.0, 0.0, 0.0)))
    with pytest.raises(MessageError, match="tilts the frame 'laser' by 180°; only level frames"):
        decode_transform(message)
    others = transforms_between(ros.TFMessage((message,)), "odom", "base_link")
    assert list(others) == [], "transforms of other frames are not checked"


def test_maps_survive_the_round_trip_as_free_occupied_or_unknown() -> None:
    probability = np.array([[0.0, 1.0, 0.5], [0.1, 0.9, 0.3]], np.float32)
    grid = OccupancyGrid(probability, 0.05, Pose(-1.0, 2.0, 0.3))
    message = encode_occupancy_grid(grid, 4.0, "map")
    assert message.data.tolist() == [0, 100, -1, 0, 100, -1]
    assert (message.info.width, message.info.height) == (3, 2)
    decoded = decode_occupancy_grid(message, "map")
    np.testing.assert_array_equal(decoded.occupied, grid.occupied)
    np.testing.assert_array_equal(decoded.free, grid.free)
    assert decoded.resolution == 0.05
    assert decoded.origin.theta == pytest.approx(0.3)


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
def test_impossible_maps_are_rejected(changes: dict[str, object], reason: str) -> None:
    message = encode_occupancy_grid(OccupancyGrid(np.zeros((2, 3), np.float32), 0.05), 0.0, "map")
    with pytest.raises(MessageError, match=reason):
        decode_occupancy_grid(replace(message, **changes), "map")
