"""Somebody else's map and pose: what is refused of them, and the robot that stands ready on them."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from wherry.cli import app
from wherry.errors import InputError
from wherry.pipelines.delivery.ros import Stack, is_own, order_from
from wherry.pipelines.delivery.simulator import node_of
from wherry.realization.mission import SurveyedWorld, order_from_plan
from wherry.robot import Odometry, Scan, Velocity
from wherry.ros import messages as ros
from wherry.ros.body_files import load_body
from wherry.ros.decoding import decode_odometry, decode_pose_estimate
from wherry.ros.encoding import encode_header, encode_occupancy_grid, encode_pose, encode_transform
from wherry.ros.names import load_names
from wherry.ros.nodes.outside import OutsideMap, OutsidePose
from wherry.ros.nodes.robot import RosRobot
from wherry.ros.transforms import StampedTransform
from wherry.simulation import Simulation
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry.trace.records import null_sink
from wherry_testing.bus import Bus
from wherry_testing.perfect_worlds import frame_of, perfect_map
from wherry_testing.worlds import hall

NAMES = load_names()
TOPICS = NAMES.topics
GRID = OccupancyGrid(np.zeros((4, 6), np.float32), 0.05)
STILL = Odometry(1.0, Pose(1.0), Velocity())


def tell_pose(bus: Bus, pose: Pose, time: float = 1.0) -> None:
    bus.say(TOPICS.tf, ros.TFMessage((encode_transform(StampedTransform("map", "odom", time, pose)),)))


def test_a_map_may_grow() -> None:
    bus = Bus()
    outside = OutsideMap(bus.node(), NAMES)
    bus.say(TOPICS.map, encode_occupancy_grid(GRID, 0.0, "map"))
    outside.wait(1.0)
    assert outside.grid().shape == (4, 6)
    larger = replace(GRID, probability=np.zeros((8, 9), np.float32))
    bus.say(TOPICS.map, encode_occupancy_grid(larger, 1.0, "map"))
    assert outside.grid().shape == (8, 9)


def test_of_gmappings_map_of_200_metres_what_is_known_is_taken() -> None:
    """With a metre around it, so that there are frontiers; everything is where it was."""
    bus = Bus()
    outside = OutsideMap(bus.node(), NAMES)
    data = np.full((4000, 4000), -1, np.int8)
    data[2000:2101, 1980:2001] = 0
    data[2100, 1980] = 100
    corner = Pose(-100.0, -100.0, 0.3)
    info = ros.MapMetaData(resolution=0.05, width=4000, height=4000, origin=encode_pose(corner))
    bus.say(TOPICS.map, ros.OccupancyGrid(encode_header(0.0, "map"), info, data.ravel()))
    grid = outside.grid()
    assert grid.shape == (101 + 40, 21 + 40)
    assert grid.free.sum() == 101 * 21 - 1
    ((row, column),) = np.argwhere(grid.occupied).tolist()
    assert (row, column) == (20 + 100, 20)
    there = corner.transform(np.array([[1980.5, 2100.5]]) * 0.05)
    np.testing.assert_allclose(grid.origin.transform(np.array([[column + 0.5, row + 0.5]]) * 0.05), there, atol=1e-9)


def test_a_map_of_which_nothing_is_known_stays_as_it_is() -> None:
    bus = Bus()
    outside = OutsideMap(bus.node(), NAMES)
    info = ros.MapMetaData(resolution=0.05, width=3, height=2)
    bus.say(TOPICS.map, ros.OccupancyGrid(encode_header(0.0, "map"), info, np.full(6, -1, np.int8)))
    assert outside.grid().shape == (2, 3)
    assert not outside.grid().occupied.any()


@pytest.mark.parametrize(
    "changes",
    [
        {"data": np.zeros(3, np.int8)},
        {"info": ros.MapMetaData(resolution=0.05, width=7, height=4)},
        {"header": ros.Header(frame_id="odom")},
    ],
)
def test_a_map_of_another_size_or_frame_is_refused_and_the_last_one_kept(changes: dict[str, Any]) -> None:
    bus = Bus()
    outside = OutsideMap(bus.node(), NAMES)
    broken = replace(encode_occupancy_grid(GRID, 0.0, "map"), **changes)
    bus.say(TOPICS.map, broken)
    with pytest.raises(InputError, match="/map: not heard within 0 s; refused /map"):
        outside.wait(0.0)
    bus.say(TOPICS.map, encode_occupancy_grid(GRID, 0.0, "map"))
    bus.say(TOPICS.map, broken)
    outside.wait(0.0)
    assert outside.grid().shape == GRID.shape


def test_a_pose_is_the_transform_after_the_odometry() -> None:
    bus = Bus()
    outside = OutsidePose(bus.node(), NAMES, lambda: STILL)
    with pytest.raises(InputError, match="map → odom on /tf, or /amcl_pose"):
        outside.wait(0.0)
    tell_pose(bus, Pose(2.0, 3.0, math.pi / 2))
    outside.wait(0.0)
    there = outside.pose(STILL)
    assert (there.x, there.y) == pytest.approx((2.0, 4.0))


def test_transforms_outrank_estimates() -> None:
    bus = Bus()
    outside = OutsidePose(bus.node(), NAMES, lambda: STILL)
    estimate = ros.PoseWithCovarianceStamped(encode_header(1.0, "map"), ros.PoseWithCovariance(encode_pose(Pose(5.0))))
    bus.say(TOPICS.amcl_pose, estimate)
    assert outside.pose(STILL).x == pytest.approx(5.0)
    assert not outside.is_lost
    tell_pose(bus, Pose(1.0))
    bus.say(TOPICS.amcl_pose, estimate)
    assert outside.pose(STILL).x == pytest.approx(2.0)


def test_a_pose_that_nobody_confirms_is_lost() -> None:
    bus = Bus()
    outside = OutsidePose(bus.node(), NAMES, lambda: STILL)
    tell_pose(bus, Pose(), time=10.0)
    for time, lost in ((10.0, False), (11.9, False), (12.1, True)):
        outside.update(STILL, Scan(time, np.ones(4), 0.0, 1.0, 0.0, 9.0))
        assert outside.is_lost is lost
    tell_pose(bus, Pose(), time=12.0)
    assert not outside.is_lost


@pytest.mark.parametrize("pose", [Pose(math.nan), Pose(theta=math.inf), Pose(1e9)])
def test_poses_that_cannot_be_are_refused(pose: Pose) -> None:
    bus = Bus()
    outside = OutsidePose(bus.node(), NAMES, lambda: STILL)
    tell_pose(bus, Pose(1.0))
    message = encode_transform(StampedTransform("map", "odom", 1.0, Pose()))
    broken = ros.Transform(ros.Vector3(pose.x), ros.Quaternion(z=pose.theta, w=1.0))
    bus.say(TOPICS.tf, ros.TFMessage((replace(message, transform=broken),)))
    assert outside.pose(STILL).x == 2.0
    assert outside.refusals.counts["/tf"] == 1


def test_orders_are_checked() -> None:
    np.testing.assert_array_equal(order_from(["3.6,-1.8", " 1, 2"], 0.6).warehouse, [[3.6, -1.8], [1.0, 2.0]])
    for texts in ([], ["3.6"], ["a,b"], ["1,2,3"], ["nan,0"], ["1e9,0"]):
        with pytest.raises(InputError, match="--warehouse"):
            order_from(texts, 0.6)
    with pytest.raises(InputError, match="--cell-size"):
        order_from(["1,2"], math.nan)


# ---- a whole stack, that knows the truth


@dataclass
class OtherStack:
    """map_server and amcl, as it were: the true map, and the true pose once it has been told about where to begin."""

    bus: Bus
    simulation: Simulation
    localizing: bool = True
    deaf: int = 0
    asked: Pose | None = None
    map_frame: Pose = Pose()  # noqa: RUF009 - frozen

    def start(self) -> None:
        node = self.bus.node()
        node.subscribe(TOPICS.odom, self._localize)
        node.subscribe(TOPICS.initialpose, self._begin)

    def tell_map(self) -> None:
        self.bus.say(TOPICS.map, encode_occupancy_grid(perfect_map(self.simulation.plan), 0.0, "map"))

    def _begin(self, message: ros.PoseWithCovarianceStamped) -> None:
        if self.deaf > 0:
            self.deaf -= 1
            return
        self.asked = decode_pose_estimate(message, "map")[1]
        self.map_frame = self.simulation.referee.pose @ self.asked.inverse
        self.localizing = True

    def _localize(self, message: ros.Odometry) -> None:
        if self.localizing:
            odometry = decode_odometry(message, "odom", "base_link")
            true = self.map_frame.inverse @ self.simulation.referee.pose
            tell_pose(self.bus, true @ odometry.pose.inverse, odometry.time)


@pytest.fixture
def other() -> OtherStack:
    return OtherStack(Bus(), hall())


@pytest.fixture
def robot(other: OtherStack) -> Iterator[RosRobot]:
    over = threading.Event()
    with RosRobot(other.bus.node(), NAMES, load_body()) as robot:
        other.start()
        node = node_of(other.simulation, other.bus.node(), NAMES, 5.0)
        thread = threading.Thread(target=node.run, args=(over.is_set,))
        thread.start()
        try:
            robot.wait_until_ready(30.0)
            yield robot
        finally:
            over.set()
            thread.join()


def get_ready(
    other: OtherStack, robot: RosRobot, mapping: str, localization: str, patience: float = 10.0
) -> SurveyedWorld:
    own = {"owns_map": is_own("--mapping", mapping), "owns_pose": is_own("--localization", localization)}
    stack = Stack(robot, other.bus.node(), NAMES, patience, **own)
    if mapping == "ros":
        other.tell_map()
    return stack.get_ready(order_from_plan(other.simulation.plan), None, null_sink, np.random.default_rng(0))


def check_ready(ready: SurveyedWorld, other: OtherStack, map_frame: Pose) -> None:
    """The robot, the box and the warehouse are where they truly are."""
    environment, plan = ready.environment, other.simulation.plan
    true = map_frame.inverse @ other.simulation.referee.pose
    assert environment.pilot.pose.distance_to(true) < 0.08
    assert environment.remaining == 1
    middles = np.array([ready.frame.centre(cell.x, cell.y) for cell in environment.site.warehouse])
    cells = {tuple(cell) for cell in frame_of(plan).cells_at(map_frame.transform(middles)).tolist()}
    assert cells == {(cell.x, cell.y) for cell in plan.warehouse}


def test_ready_on_somebody_elses_map_and_pose(other: OtherStack, robot: RosRobot) -> None:
    check_ready(get_ready(other, robot, "ros", "ros"), other, Pose())


def test_ready_on_somebody_elses_map_by_the_own_pose(other: OtherStack, robot: RosRobot) -> None:
    other.localizing = False
    check_ready(get_ready(other, robot, "ros", "own"), other, Pose())


def test_ready_on_the_own_map_by_somebody_elses_pose(other: OtherStack, robot: RosRobot) -> None:
    other.localizing = False
    ready = get_ready(other, robot, "own", "ros")
    assert other.asked is not None  # it was told where to begin
    check_ready(ready, other, other.map_frame)


def test_a_localization_that_was_elsewhere_and_misses_what_it_is_told_is_told_again(
    other: OtherStack, robot: RosRobot
) -> None:
    other.localizing, other.deaf, other.map_frame = True, 2, Pose(1.0, 1.0, 1.0)
    ready = get_ready(other, robot, "own", "ros")
    assert other.deaf == 0
    check_ready(ready, other, other.map_frame)


def test_a_localization_that_does_not_take_what_it_is_told_is_named(other: OtherStack, robot: RosRobot) -> None:
    other.deaf, other.map_frame = 1000, Pose(1.0, 1.0, 1.0)
    with pytest.raises(InputError, match=r"/initialpose: told where the robot is, .* within 1 s"):
        get_ready(other, robot, "own", "ros", patience=1.0)


def test_a_stack_that_says_nothing_is_named(other: OtherStack, robot: RosRobot) -> None:
    stack = Stack(robot, other.bus.node(), NAMES, 0.2, owns_map=False, owns_pose=True)
    with pytest.raises(InputError, match=r"/map: not heard within 0\.2 s"):
        stack.get_ready(order_from_plan(other.simulation.plan), None, null_sink, np.random.default_rng(0))


@pytest.mark.parametrize("option", ["--mapping", "--localization"])
def test_a_side_that_there_is_not_is_told_before_any_robot_is_waited_for(option: str) -> None:
    result = CliRunner().invoke(app, ["ros2", "deliver", "--warehouse", "1,0", option, "theirs"])
    assert str(result.exception) == f"{option}: theirs: is neither own nor ros"
    assert "Waiting for the robot" not in result.output
