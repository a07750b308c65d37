"""A delivery on any ROS robot: the agent loop of `pipelines.delivery.agent`, with own or external navigation."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import numpy as np

from wherry.errors import InputError
from wherry.learning.rule_files.files import save_rules
from wherry.learning.rules import RuleLearner
from wherry.pipelines.delivery.agent import DeliveryEpisode, run_started
from wherry.realization.mission import Mission, Order, SurveyedWorld
from wherry.ros.encoding import encode_header, encode_pose
from wherry.ros.messages import PoseWithCovariance, PoseWithCovarianceStamped
from wherry.ros.names import RosNames
from wherry.ros.nodes.external import ExternalMap, ExternalMapper, ExternalPose
from wherry.ros.nodes.robot import RosRobot
from wherry.ros.transports.protocol import Transport
from wherry.space.map_files import save_map
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose
from wherry.trace.records import Sink

MAX_COORDINATE = 1000.0  # m, absolute value, of a warehouse cell's centre
MIN_CELL_SIZE, MAX_CELL_SIZE = 0.1, 10.0  # m
INITIAL_POSE_PERIOD = 1.0  # s between two messages on /initialpose
INITIAL_COVARIANCE = np.diag([0.03**2, 0.03**2, 0.0, 0.0, 0.0, 0.02**2]).ravel()  # m² and rad², of a pose from SLAM


class Provider(StrEnum):
    """Source of the map or of the pose: the agent itself, or an external navigation stack."""

    OWN = "own"
    EXTERNAL = "ros"


@dataclass(frozen=True, slots=True)
class RosDeliverySettings:
    """What to deliver, with which map and rules, and with which navigation.

    Attributes:
        order: The warehouse's position relative to the robot's start.
        learner: Learner of the actions' rules, which may start with learnt rules.
        grid: A map to use instead of exploring; None to explore, or to use an external map.
        mapping: Provider of the map.
        localization: Provider of the pose.
        timeout: Maximum waiting time for an external map or pose, s.
        seed: Seed of all randomness.
    """

    order: Order
    learner: RuleLearner
    grid: OccupancyGrid | None
    mapping: Provider
    localization: Provider
    timeout: float
    seed: int


@dataclass(frozen=True, slots=True)
class RosDeliverySummary:
    """Result of a delivery as the agent knows it, since a real robot has no referee.

    Attributes:
        delivered: Number of boxes delivered.
        remaining: Number of known boxes not delivered.
        actions: Number of actions.
        learning_steps: Number of actions taken in order to learn.
        robot_seconds: Duration on the robot's clock, s.
    """

    delivered: int
    remaining: int
    actions: int
    learning_steps: int
    robot_seconds: float


def parse_order(warehouse: Sequence[str], cell_size: float) -> Order:
    """Parse an order.

    Args:
        warehouse: Centres of the warehouse's cells as "X,Y", m, in the frame of base_link at the start.
        cell_size: Side of a cell, m.

    Raises:
        InputError: There is no cell, or a coordinate or the cell size is out of range.
    """
    if not warehouse:
        raise InputError("--warehouse", "", "is missing: X,Y of each of its cells, m, from where the robot starts")
    if not MIN_CELL_SIZE <= cell_size <= MAX_CELL_SIZE:
        raise InputError("--cell-size", f"{cell_size}", f"is not from {MIN_CELL_SIZE:g} to {MAX_CELL_SIZE:g} m")
    return Order(np.array([_parse_point(text) for text in warehouse]), cell_size)


def _parse_point(text: str) -> Floats:
    try:
        point = np.array([float(word) for word in text.split(",")])
    except ValueError as error:
        raise InputError("--warehouse", text, "is not X,Y") from error
    if point.shape != (2,) or not (np.abs(point) <= MAX_COORDINATE).all():  # also NaN
        raise InputError("--warehouse", text, f"is not X,Y, both within {MAX_COORDINATE:g} m")
    return point


def parse_provider(option: str, value: str) -> Provider:
    """Parse the value of ``--mapping`` or ``--localization``.

    Raises:
        InputError: There is no such provider.
    """
    try:
        return Provider(value)
    except ValueError as error:
        raise InputError(option, value, f"is neither {Provider.OWN} nor {Provider.EXTERNAL}") from error


class NavigationStack:
    """Mapping and localization by the agent itself or by an external stack.

    Args:
        robot: The robot, which must be ready.
        transport: Connection to ROS.
        names: Names of topics and frames.
        mapping: Provider of the map.
        localization: Provider of the pose.
        timeout: Maximum waiting time for an external map or pose, s.
    """

    def __init__(
        self,
        robot: RosRobot,
        transport: Transport,
        names: RosNames,
        *,
        mapping: Provider,
        localization: Provider,
        timeout: float,
    ) -> None:
        self._robot = robot
        self._transport = transport
        self._names = names
        self._timeout = timeout
        is_own_map, is_own_pose = mapping is Provider.OWN, localization is Provider.OWN
        self._map = None if is_own_map else ExternalMap(transport, names)
        self._pose = None if is_own_pose else ExternalPose(transport, names, lambda: robot.odometry)
        if is_own_map and not is_own_pose:
            transport.advertise(names.topics.initialpose)

    def get_ready(
        self, order: Order, grid: OccupancyGrid | None, sink: Sink, rng: np.random.Generator
    ) -> SurveyedWorld:
        """Get a map and a pose, and find the boxes.

        Args:
            order: The warehouse's position relative to the robot's start.
            grid: A finished map; None to explore, or to use the external map.
            sink: Receives trace records.
            rng: Source of all randomness.

        Raises:
            InputError: The external stack does not provide a map or a pose in time.
        """
        latest_map = self._latest_map(grid)
        if self._pose is None:
            mission = Mission(self._robot, order, sink, rng)
            return mission.explore() if latest_map is None else mission.localize(latest_map())
        if latest_map is None:
            return Mission(self._robot, order, sink, rng, localizer=self.initialize_localization).explore()
        return self._explore_externally(order, latest_map, self._pose, sink, rng)

    def _latest_map(self, grid: OccupancyGrid | None) -> Callable[[], OccupancyGrid] | None:
        """Returns a function that returns the latest map; None if the agent has to explore first."""
        if self._map is not None:
            self._map.wait(self._timeout)
            return self._map.grid
        return None if grid is None else lambda: grid

    def _explore_externally(
        self,
        order: Order,
        latest_map: Callable[[], OccupancyGrid],
        pose: ExternalPose,
        sink: Sink,
        rng: np.random.Generator,
    ) -> SurveyedWorld:
        """Explore while the external stack localizes."""
        pose.wait(self._timeout)
        if self._robot.odometry is None:
            raise RuntimeError("the robot is not ready")
        mapper = ExternalMapper(latest_map, pose, self._robot.odometry)
        return Mission(self._robot, order, sink, rng, mapper=lambda _: mapper, localizer=lambda *_: pose).explore()

    def initialize_localization(self, grid: OccupancyGrid, pose: Pose) -> ExternalPose:
        """Publish ``/initialpose`` until the external localization has accepted it.

        Repetition is needed: the localization may still be receiving the map, and ``/initialpose`` is not latched.

        Raises:
            InputError: The localization does not accept the pose in time.
        """
        del grid
        odometry, topic = self._robot.odometry, self._names.topics.initialpose
        if self._pose is None or odometry is None:
            raise RuntimeError("there is no external localization, or the robot is not ready")
        deadline = time.monotonic() + self._timeout
        while time.monotonic() < deadline:
            self._transport.publish(topic, self._initial_pose(pose @ odometry.pose.inverse))
            if self._pose.wait_until_near(pose, odometry, INITIAL_POSE_PERIOD):
                return self._pose
        raise InputError("ROS", topic.name, f"the localization has not accepted the pose within {self._timeout:g} s")

    def _initial_pose(self, map_from_odom: Pose) -> PoseWithCovarianceStamped:
        """The pose at the newest odometry, stamped with its time, since the robot may still be moving.

        amcl adds the motion from the stamp to the present.
        """
        odometry = self._robot.newest_odometry
        if odometry is None:
            raise RuntimeError("the robot is not ready")
        header = encode_header(odometry.time, self._names.frames.map)
        pose = encode_pose(map_from_odom @ odometry.pose)
        return PoseWithCovarianceStamped(header, PoseWithCovariance(pose, INITIAL_COVARIANCE))


def run(
    robot: RosRobot, stack: NavigationStack, settings: RosDeliverySettings, sink: Sink
) -> tuple[RosDeliverySummary, OccupancyGrid]:
    """Deliver every box; returns the summary and the map.

    Args:
        robot: The robot, which must be ready.
        stack: Provides the map and the pose.
        settings: What to deliver.
        sink: Receives trace records.

    Raises:
        InputError: The external stack does not provide a map or a pose in time, or the map does not fit.
        RobotLostError: The connection to the robot is lost.
    """
    rng = np.random.default_rng(settings.seed)
    sink(run_started("ROS", settings.learner, robot.body))
    started_at = robot.time
    delivery = DeliveryEpisode(stack.get_ready(settings.order, settings.grid, sink, rng), settings.learner, sink, rng)
    actions = learning_steps = 0
    for step in delivery:
        actions += 1
        learning_steps += step.is_learning
    environment = delivery.world.environment
    duration = robot.time - started_at
    summary = RosDeliverySummary(environment.delivered, environment.remaining, actions, learning_steps, duration)
    return summary, delivery.world.grid


def save(out: Path, grid: OccupancyGrid, learner: RuleLearner) -> None:
    """Write map and rules into an existing folder."""
    save_map(grid, out / "map.yaml")
    save_rules(learner, out / "rules.json")
