"""A delivery on any robot of ROS: the agent loop of `experiments.robot_delivery`, and what an outside stack may do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wherry.errors import InputError
from wherry.experiments.robot_delivery import beginning, deliver
from wherry.learning.learners import RuleLearner
from wherry.learning.rules import save_rules
from wherry.realization.mission import Mission, Order, Ready
from wherry.ros.agent_node import AgentNode
from wherry.ros.robot import RosRobot
from wherry.space.map_files import save_map
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats
from wherry.trace import Sink, both

OWN, OUTSIDE = "own", "ros"
FARTHEST = 1000.0  # m


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


def run(
    robot: RosRobot,
    node: AgentNode,
    order: Order,
    learner: RuleLearner,
    grid: OccupancyGrid | None,
    watch: Sink,
    seed: int,
) -> tuple[Figures, Ready]:
    """Deliver every box.

    Args:
        robot: Ready.
        node: Tells ROS what happens.
        order: What to do.
        learner: Goes on from what it knows.
        grid: A map to use instead of exploring.
        watch: Told what happens too.
        seed: Of everything that is random.
    """
    rng = np.random.default_rng(seed)
    sink = both(node, watch)
    sink(beginning("ROS", learner, robot.body))
    started = robot.time
    mission = Mission(robot, order, sink, rng)
    if grid is not None:
        node.tell_map(grid)
    ready = mission.explore() if grid is None else mission.find_itself(grid)
    actions = learning = 0
    for step in deliver(ready, learner, sink, rng):
        actions += 1
        learning += step.learning
    environment = ready.environment
    figures = Figures(environment.delivered, environment.remaining, actions, learning, robot.time - started)
    return figures, ready


def write(out: Path, ready: Ready, learner: RuleLearner) -> None:
    """Map and rules into a folder that exists."""
    save_map(ready.grid, out / "map.yaml")
    save_rules(learner, out / "rules.json")
