"""Map and pose of an external stack: which messages are accepted, and when the robot counts as lost."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.robot import Odometry, Scan, Velocity
from wherry.ros import messages as ros
from wherry.ros.encoding import encode_header, encode_occupancy_grid, encode_pose, encode_transform
from wherry.ros.names import load_names
from wherry.ros.nodes.external import ExternalMap, ExternalPose
from wherry.ros.transforms import StampedTransform
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry_testing.bus import Bus

NAMES = load_names()
TOPICS = NAMES.topics
GRID = OccupancyGrid(np.zeros((4, 6), np.float32), 0.05)
STILL = Odometry(1.0, Pose(1.0), Velocity())


def publish_transform(bus: Bus, pose: Pose, time: float = 1.0) -> None:
    bus.publish(TOPICS.tf, ros.TFMessage((encode_transform(StampedTransform("map", "odom", time, pose)),)))


def test_map_can_grow() -> None:
    bus = Bus()
    external = ExternalMap(bus.node(), NAMES)
    bus.publish(TOPICS.map, encode_occupancy_grid(GRID, 0.0, "map"))
    external.wait(1.0)
    assert external.grid().shape == (4, 6)
    larger = replace(GRID, probability=np.zeros((8, 9), np.float32))
    bus.publish(TOPICS.map, encode_occupancy_grid(larger, 1.0, "map"))
    assert external.grid().shape == (8, 9)


def test_unknown_border_of_a_gmapping_map_is_cropped() -> None:
    """A margin of 1 m stays, so that there are frontiers; the known cells keep their positions."""
    bus = Bus()
    external = ExternalMap(bus.node(), NAMES)
    data = np.full((4000, 4000), -1, np.int8)
    data[2000:2101, 1980:2001] = 0
    data[2100, 1980] = 100
    corner = Pose(-100.0, -100.0, 0.3)
    info = ros.MapMetaData(resolution=0.05, width=4000, height=4000, origin=encode_pose(corner))
    bus.publish(TOPICS.map, ros.OccupancyGrid(encode_header(0.0, "map"), info, data.ravel()))
    grid = external.grid()
    assert grid.shape == (101 + 40, 21 + 40)
    assert grid.free.sum() == 101 * 21 - 1
    ((row, column),) = np.argwhere(grid.occupied).tolist()
    assert (row, column) == (20 + 100, 20)
    expected = corner.transform(np.array([[1980.5, 2100.5]]) * 0.05)
    np.testing.assert_allclose(grid.origin.transform(np.array([[column + 0.5, row + 0.5]]) * 0.05), expected, atol=1e-9)


def test_map_without_known_cells_is_not_cropped() -> None:
    bus = Bus()
    external = ExternalMap(bus.node(), NAMES)
    info = ros.MapMetaData(resolution=0.05, width=3, height=2)
    bus.publish(TOPICS.map, ros.OccupancyGrid(encode_header(0.0, "map"), info, np.full(6, -1, np.int8)))
    assert external.grid().shape == (2, 3)
    assert not external.grid().occupied.any()


@pytest.mark.parametrize(
    "changes",
    [
        {"data": np.zeros(3, np.int8)},
        {"info": ros.MapMetaData(resolution=0.05, width=7, height=4)},
        {"header": ros.Header(frame_id="odom")},
    ],
)
def test_map_with_wrong_size_or_frame_is_rejected_and_the_last_one_kept(changes: dict[str, Any]) -> None:
    bus = Bus()
    external = ExternalMap(bus.node(), NAMES)
    broken = replace(encode_occupancy_grid(GRID, 0.0, "map"), **changes)
    bus.publish(TOPICS.map, broken)
    with pytest.raises(InputError, match="/map: not received within 0 s; rejected /map"):
        external.wait(0.0)
    bus.publish(TOPICS.map, encode_occupancy_grid(GRID, 0.0, "map"))
    bus.publish(TOPICS.map, broken)
    external.wait(0.0)
    assert external.grid().shape == GRID.shape


def test_pose_is_the_transform_times_odometry() -> None:
    bus = Bus()
    external = ExternalPose(bus.node(), NAMES, lambda: STILL)
    with pytest.raises(InputError, match="map → odom on /tf, or /amcl_pose"):
        external.wait(0.0)
    publish_transform(bus, Pose(2.0, 3.0, math.pi / 2))
    external.wait(0.0)
    pose = external.pose(STILL)
    assert (pose.x, pose.y) == pytest.approx((2.0, 4.0))


def test_transforms_take_precedence_over_estimates() -> None:
    bus = Bus()
    external = ExternalPose(bus.node(), NAMES, lambda: STILL)
    estimate = ros.PoseWithCovarianceStamped(encode_header(1.0, "map"), ros.PoseWithCovariance(encode_pose(Pose(5.0))))
    bus.publish(TOPICS.amcl_pose, estimate)
    assert external.pose(STILL).x == pytest.approx(5.0)
    assert not external.is_lost
    publish_transform(bus, Pose(1.0))
    bus.publish(TOPICS.amcl_pose, estimate)
    assert external.pose(STILL).x == pytest.approx(2.0)


def test_robot_is_lost_without_recent_transforms() -> None:
    bus = Bus()
    external = ExternalPose(bus.node(), NAMES, lambda: STILL)
    publish_transform(bus, Pose(), time=10.0)
    for time, lost in ((10.0, False), (11.9, False), (12.1, True)):
        external.update(STILL, Scan(time, np.ones(4), 0.0, 1.0, 0.0, 9.0))
        assert external.is_lost is lost
    publish_transform(bus, Pose(), time=12.0)
    assert not external.is_lost


@pytest.mark.parametrize("pose", [Pose(math.nan), Pose(theta=math.inf), Pose(1e9)])
def test_invalid_poses_are_rejected(pose: Pose) -> None:
    bus = Bus()
    external = ExternalPose(bus.node(), NAMES, lambda: STILL)
    publish_transform(bus, Pose(1.0))
    message = encode_transform(StampedTransform("map", "odom", 1.0, Pose()))
    broken = ros.Transform(ros.Vector3(pose.x), ros.Quaternion(z=pose.theta, w=1.0))
    bus.publish(TOPICS.tf, ros.TFMessage((replace(message, transform=broken),)))
    assert external.pose(STILL).x == 2.0
    assert external.rejected.counts["/tf"] == 1
