"""A delivery on a ROS robot up to the first action: orders, and every combination of own and external navigation."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.pipelines.delivery.ros import NavigationStack, Provider, parse_order
from wherry.realization.mission import SurveyedWorld, order_from_plan
from wherry.robot import Odometry, Velocity
from wherry.ros import messages as ros
from wherry.ros.body_files import load_body
from wherry.ros.decoding import decode_odometry, decode_pose_estimate
from wherry.ros.encoding import encode_occupancy_grid, encode_odometry, encode_transform
from wherry.ros.names import load_names
from wherry.ros.nodes.robot import RosRobot
from wherry.ros.nodes.simulator import simulator_node
from wherry.ros.transforms import StampedTransform
from wherry.simulation import Simulation
from wherry.space.pose import Pose
from wherry.trace.records import null_sink
from wherry_testing.bus import Bus
from wherry_testing.node_thread import running
from wherry_testing.perfect_worlds import frame_of, perfect_map
from wherry_testing.worlds import hall

NAMES = load_names()
TOPICS = NAMES.topics


def test_invalid_orders_are_rejected() -> None:
    np.testing.assert_array_equal(parse_order(["3.6,-1.8", " 1, 2"], 0.6).warehouse, [[3.6, -1.8], [1.0, 2.0]])
    for texts in ([], ["3.6"], ["a,b"], ["1,2,3"], ["nan,0"], ["1e9,0"]):
        with pytest.raises(InputError, match="--warehouse"):
            parse_order(texts, 0.6)
    with pytest.raises(InputError, match="--cell-size"):
        parse_order(["1,2"], math.nan)


# ---- navigation


@dataclass
class ExternalStack:
    """A stand-in for map_server and amcl: the true map, and the true pose relative to ``/initialpose``.

    Attributes:
        bus: ROS.
        simulation: The truth.
        is_localizing: Whether it publishes a pose.
        ignored_poses: Number of initial poses that it will ignore.
        initial_pose: Last initial pose accepted.
        map_frame: The map frame in the simulation's world frame.
        true_poses: True pose of base_link in the world frame, by the time of the odometry published with it, s.
    """

    bus: Bus
    simulation: Simulation
    is_localizing: bool = True
    ignored_poses: int = 0
    initial_pose: Pose | None = None
    map_frame: Pose = Pose()  # noqa: RUF009 - frozen
    true_poses: dict[float, Pose] = field(default_factory=dict)

    def start(self) -> None:
        node = self.bus.node()
        node.subscribe(TOPICS.odom, self._on_odometry)
        node.subscribe(TOPICS.initialpose, self._on_initial_pose)

    def publish_map(self) -> None:
        self.bus.publish(TOPICS.map, encode_occupancy_grid(perfect_map(self.simulation.plan), 0.0, "map"))

    def _on_initial_pose(self, message: ros.PoseWithCovarianceStamped) -> None:
        if self.ignored_poses > 0:
            self.ignored_poses -= 1
            return
        stamp, self.initial_pose = decode_pose_estimate(message, "map")
        self.map_frame = self.true_poses[stamp] @ self.initial_pose.inverse  # the robot may have moved on since
        self.is_localizing = True

    def _on_odometry(self, message: ros.Odometry) -> None:
        odometry = decode_odometry(message, "odom", "base_link")
        self.true_poses[odometry.time] = self.simulation.referee.pose
        if self.is_localizing:
            true = self.map_frame.inverse @ self.simulation.referee.pose
            link = StampedTransform("map", "odom", odometry.time, true @ odometry.pose.inverse)
            self.bus.publish(TOPICS.tf, ros.TFMessage((encode_transform(link),)))


@pytest.fixture
def external() -> ExternalStack:
    return ExternalStack(Bus(), hall())


@pytest.fixture
def robot(external: ExternalStack) -> Iterator[RosRobot]:
    external.start()  # before the robot, so that it knows the true pose at all odometry that the robot has received
    with RosRobot(external.bus.node(), NAMES, load_body()) as robot:
        node = simulator_node(external.simulation, external.bus.node(), NAMES, 5.0)
        with running(node):
            robot.wait_until_ready(30.0)
            yield robot


def get_ready(
    external: ExternalStack, robot: RosRobot, mapping: Provider, localization: Provider, timeout: float = 10.0
) -> SurveyedWorld:
    stack = NavigationStack(
        robot, external.bus.node(), NAMES, mapping=mapping, localization=localization, timeout=timeout
    )
    if mapping is Provider.EXTERNAL:
        external.publish_map()
    return stack.get_ready(order_from_plan(external.simulation.plan), None, null_sink, np.random.default_rng(0))


def check_ready(ready: SurveyedWorld, external: ExternalStack, map_frame: Pose) -> None:
    """Check the poses of robot, box and warehouse against the simulation."""
    environment, plan = ready.environment, external.simulation.plan
    true = map_frame.inverse @ external.simulation.referee.pose
    assert environment.pilot.pose.distance_to(true) < 0.08
    assert environment.remaining == 1
    middles = np.array([ready.frame.centre(cell.x, cell.y) for cell in environment.site.warehouse])
    cells = {tuple(cell) for cell in frame_of(plan).cells_at(map_frame.transform(middles)).tolist()}
    assert cells == {(cell.x, cell.y) for cell in plan.warehouse}


def test_external_map_and_external_pose(external: ExternalStack, robot: RosRobot) -> None:
    check_ready(get_ready(external, robot, Provider.EXTERNAL, Provider.EXTERNAL), external, Pose())


def test_external_map_and_own_pose(external: ExternalStack, robot: RosRobot) -> None:
    external.is_localizing = False
    check_ready(get_ready(external, robot, Provider.EXTERNAL, Provider.OWN), external, Pose())


def test_own_map_and_external_pose(external: ExternalStack, robot: RosRobot) -> None:
    external.is_localizing = False
    ready = get_ready(external, robot, Provider.OWN, Provider.EXTERNAL)
    assert external.initial_pose is not None
    check_ready(ready, external, external.map_frame)


def test_initial_pose_is_repeated_until_the_localization_accepts_it(external: ExternalStack, robot: RosRobot) -> None:
    external.is_localizing, external.ignored_poses, external.map_frame = True, 2, Pose(1.0, 1.0, 1.0)
    ready = get_ready(external, robot, Provider.OWN, Provider.EXTERNAL)
    assert external.ignored_poses == 0
    check_ready(ready, external, external.map_frame)


def test_localization_that_ignores_the_initial_pose_is_an_error(external: ExternalStack, robot: RosRobot) -> None:
    external.ignored_poses, external.map_frame = 1000, Pose(1.0, 1.0, 1.0)
    with pytest.raises(InputError, match=r"/initialpose: the localization has not accepted the pose within 1 s"):
        get_ready(external, robot, Provider.OWN, Provider.EXTERNAL, timeout=1.0)


def test_stack_without_a_map_is_an_error(external: ExternalStack, robot: RosRobot) -> None:
    stack = NavigationStack(
        robot,
        external.bus.node(),
        NAMES,
        mapping=Provider.EXTERNAL,
        localization=Provider.OWN,
        timeout=0.2,
    )
    with pytest.raises(InputError, match=r"/map: not received within 0\.2 s"):
        stack.get_ready(order_from_plan(external.simulation.plan), None, null_sink, np.random.default_rng(0))


def test_initial_pose_includes_the_motion_that_is_not_processed_yet() -> None:
    bus = Bus()
    with RosRobot(bus.node(), NAMES, load_body()) as robot:
        stack = NavigationStack(
            robot, bus.node(), NAMES, mapping=Provider.OWN, localization=Provider.EXTERNAL, timeout=0.01
        )
        for seconds, x in ((10.0, 0.0), (10.25, 0.5)):
            odometry = Odometry(seconds, Pose(x), Velocity(2.0))
            bus.publish(TOPICS.odom, encode_odometry(odometry, "odom", "base_link", np.zeros(36)))
        assert robot.receive().time == 10.0
        with pytest.raises(InputError, match="has not accepted"):
            stack.initialize_localization(perfect_map(hall().plan), Pose(1.0, 2.0, math.pi / 2))
    (message,) = bus.published[TOPICS.initialpose.name]
    stamp, pose = decode_pose_estimate(message, "map")
    assert stamp == 10.25
    assert pose.is_near(Pose(1.0, 2.5, math.pi / 2), 1e-9, 1e-9)
