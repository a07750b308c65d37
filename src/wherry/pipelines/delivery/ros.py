"""A delivery on any robot of ROS: the agent loop of `experiments.robot_delivery`, and what an outside stack may do."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wherry.errors import InputError
from wherry.learning.learners import RuleLearner
from wherry.learning.rule_files.files import save_rules
from wherry.pipelines.delivery.agent import DeliveryEpisode, run_started
from wherry.realization.mission import Mission, Order, SurveyedWorld
from wherry.ros.encoding import encode_header, encode_pose
from wherry.ros.messages import PoseWithCovariance, PoseWithCovarianceStamped
from wherry.ros.names import RosNames
from wherry.ros.nodes.outside import OutsideMap, OutsideMapper, OutsidePose
from wherry.ros.nodes.robot import RosRobot
from wherry.ros.transports.protocol import Transport
from wherry.space.map_files import save_map
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose
from wherry.trace.records import Sink

OWN, OUTSIDE = "own", "ros"
FARTHEST = 1000.0  # m
TELL_AGAIN = 1.0  # s until a localization that does not follow is told again
INITIAL_COVARIANCE = np.diag([0.03**2, 0.03**2, 0.0, 0.0, 0.0, 0.02**2]).ravel()  # m², rad²: the pose is known well


@dataclass(frozen=True, slots=True)
class Figures:
    """What the robot believes to have done; there is no referee.

    Attributes:
        delivered: Boxes.
        remaining: Boxes that it knows of.
        actions: Actions taken.
        learning_steps: Of which to learn.
        robot_seconds: s on the robot's clock.
    """

    delivered: int
    remaining: int
    actions: int
    learning_steps: int
    robot_seconds: float


def order_from(warehouse: Sequence[str], cell_size: float) -> Order:
    """Read an order from "X,Y" of each of the warehouse's cells, m, as seen from where the robot starts.

    Raises:
        InputError: There is none, or one is no place.
    """
    if not warehouse:
        raise InputError("--warehouse", "", "is missing: X,Y of each of its cells, m, from where the robot starts")
    if not 0.1 <= cell_size <= 10.0:
        raise InputError("--cell-size", f"{cell_size}", "is not from 0.1 to 10 m")
    return Order(np.array([_place(text) for text in warehouse]), cell_size)


def _place(text: str) -> Floats:
    try:
        place = np.array([float(word) for word in text.split(",")])
    except ValueError as error:
        raise InputError("--warehouse", text, "is not X,Y") from error
    if place.shape != (2,) or not (np.abs(place) <= FARTHEST).all():  # also NaN
        raise InputError("--warehouse", text, f"is not X,Y, both within {FARTHEST:g} m")
    return place


def is_own(option: str, value: str) -> bool:
    """Whether something is ours to do: `OWN`, else `OUTSIDE`.

    Raises:
        InputError: It is neither.
    """
    if value not in (OWN, OUTSIDE):
        raise InputError(option, value, f"is neither {OWN} nor {OUTSIDE}")
    return value == OWN


class Stack:
    """Who maps and who localizes: we, or an outside stack.

    Args:
        robot: Ready.
        transport: ROS.
        names: What everything is called.
        patience: s to wait for an outside map or pose.
        owns_map: Whether we map.
        owns_pose: Whether we localize.
    """

    def __init__(
        self,
        robot: RosRobot,
        transport: Transport,
        names: RosNames,
        patience: float,
        *,
        owns_map: bool,
        owns_pose: bool,
    ) -> None:
        self._robot = robot
        self._transport = transport
        self._names = names
        self._patience = patience
        self._map = None if owns_map else OutsideMap(transport, names)
        self._pose = None if owns_pose else OutsidePose(transport, names, lambda: robot.odometry)
        if owns_map and not owns_pose:
            transport.advertise(names.topics.initialpose)

    def get_ready(
        self, order: Order, grid: OccupancyGrid | None, sink: Sink, rng: np.random.Generator
    ) -> SurveyedWorld:
        """Map, or take a map; localize, or be told; find the boxes.

        Args:
            order: What is to be done.
            grid: A finished map; None to make one, or to take that of the outside stack.
            sink: Told what happens.
            rng: Where all randomness comes from.

        Raises:
            InputError: The outside stack does not say what it should.
        """
        maps = None if grid is None else _always(grid)
        if self._map is not None:
            self._map.wait(self._patience)
            maps = self._map.grid
        pose = self._pose
        if pose is None:
            mission = Mission(self._robot, order, sink, rng)
            return mission.explore() if maps is None else mission.localize(maps())
        if maps is None:
            return Mission(self._robot, order, sink, rng, localizer=self._hand_over).explore()
        pose.wait(self._patience)
        odometry = self._robot.odometry
        if odometry is None:
            raise RuntimeError("the robot is not ready")
        mapper = OutsideMapper(maps, pose, odometry)
        return Mission(self._robot, order, sink, rng, mapper=lambda _: mapper, localizer=lambda *_: pose).explore()

    def _hand_over(self, grid: OccupancyGrid, pose: Pose) -> OutsidePose:
        """Tell the outside localization where the robot is on our map, again and again until it has it there.

        It may have been somewhere else before, it may need time to take the map in, and who comes late hears nothing of
        what was told on ``/initialpose``.

        Raises:
            InputError: It does not take what it is told.
        """
        del grid
        odometry, topic = self._robot.odometry, self._names.topics.initialpose
        if self._pose is None or odometry is None:
            raise RuntimeError("nobody else localizes, or the robot is not ready")
        estimate = PoseWithCovariance(encode_pose(pose), INITIAL_COVARIANCE)
        deadline = time.monotonic() + self._patience
        while time.monotonic() < deadline:
            header = encode_header(self._robot.time, self._names.frames.map)
            self._transport.publish(topic, PoseWithCovarianceStamped(header, estimate))
            if self._pose.wait_until_near(pose, odometry, TELL_AGAIN):
                return self._pose
        raise InputError(
            "ROS",
            topic.name,
            f"told where the robot is, the localization has not put it there within {self._patience:g} s",
        )


def _always(grid: OccupancyGrid) -> Callable[[], OccupancyGrid]:
    """A map that does not grow."""
    return lambda: grid


def run(
    robot: RosRobot,
    stack: Stack,
    order: Order,
    learner: RuleLearner,
    grid: OccupancyGrid | None,
    sink: Sink,
    seed: int,
) -> tuple[Figures, SurveyedWorld]:
    """Deliver every box.

    Args:
        robot: Ready.
        stack: Maps and localizes.
        order: What to do.
        learner: Goes on from what it knows.
        grid: A map to use instead of exploring.
        sink: Told what happens.
        seed: Of everything that is random.

    Raises:
        InputError: The outside stack does not say what it should, or the map does not fit.
        RobotLostError: The robot cannot be reached any more.
    """
    rng = np.random.default_rng(seed)
    sink(run_started("ROS", learner, robot.body))
    started = robot.time
    delivery = DeliveryEpisode(stack.get_ready(order, grid, sink, rng), learner, sink, rng)
    actions = learning = 0
    for step in delivery:
        actions += 1
        learning += step.is_learning
    ready = delivery.world
    environment = ready.environment
    figures = Figures(environment.delivered, environment.remaining, actions, learning, robot.time - started)
    return figures, ready


def write(out: Path, ready: SurveyedWorld, learner: RuleLearner) -> None:
    """Map and rules into a folder that exists."""
    save_map(ready.grid, out / "map.yaml")
    save_rules(learner, out / "rules.json")
