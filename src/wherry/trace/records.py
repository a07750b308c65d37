"""Trace records: immutable messages about a run, emitted in order of time.

Algorithms pass records to a `Sink` and do not depend on screens or files; views are built from records alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from wherry.space.frame import CellFrame
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose

TIME_TOLERANCE = 1e-6  # s, rounding error of summed periods


class Phase(StrEnum):
    """Part of a run that a narration belongs to; the values are those of trace files, ROS topics and the page."""

    EXPLORE = "explore"
    MAP = "map"
    LOCALIZE = "localize"
    SURVEY = "survey"
    LEARN = "learn"
    DELIVER = "deliver"
    DONE = "done"


@dataclass(frozen=True, slots=True)
class RunStarted:
    """The task of the run; the first record of every trace.

    Attributes:
        task: The command's name: "deliver", "map", "localize" or "learn".
        subject: Name of the world or the log.
        learner: Name of the learner; "" if the run has none.
        terms: Names of the terms, in the order of condition bits; empty if the run has no conditions.
        actions: Names of the actions; empty if the run has none.
        robot_radius: Radius of the robot's footprint, m; 0 without a robot.
        box_radius: Radius of a box, m; 0 without boxes.
    """

    task: str
    subject: str
    learner: str = ""
    terms: tuple[str, ...] = ()
    actions: tuple[str, ...] = ()
    robot_radius: float = 0.0
    box_radius: float = 0.0


@dataclass(frozen=True, slots=True)
class CellLayout:
    """The cell grid of the symbolic half, placed on the map.

    Attributes:
        time: Time on the robot's clock, s.
        frame: Pose of the cell grid in the map frame, and side of a cell, m.
        warehouse: [K, 2] int32, x and y of the warehouse's cells.
        walls: [W, 3] int32, x and y of a cell and 1 for a wall on its north edge, 0 for one on its east edge.
    """

    time: float
    frame: CellFrame
    warehouse: NDArray[np.int32]
    walls: NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class Narration:
    """A sentence in which the robot explains its actions.

    Attributes:
        time: Time on the robot's clock, s.
        phase: Part of the run that the sentence belongs to.
        text: One sentence in the first person.
    """

    time: float
    phase: Phase
    text: str


@dataclass(frozen=True, slots=True)
class RobotSnapshot:
    """Measurements and estimates of the robot at one time, all in the map frame.

    Attributes:
        time: Time on the robot's clock, s.
        pose: Estimated pose of base_link.
        lidar: Estimated pose of the lidar.
        points: [P, 2] float32 m, end points of the scan's valid beams.
        particles: [N, 3] float32 m, m, rad, particles of the localization; empty during mapping.
        path: [M, 2] float32 m, the path that the robot follows.
        boxes: [B, 2] float32 m, estimated centres of the boxes on the floor.
        has_load: Whether the latch holds a box.
    """

    time: float
    pose: Pose
    lidar: Pose
    points: NDArray[np.float32]
    particles: NDArray[np.float32]
    path: NDArray[np.float32]
    boxes: NDArray[np.float32]
    has_load: bool


@dataclass(frozen=True, slots=True)
class MapUpdate:
    """The map and the progress of exploration.

    Attributes:
        time: Time on the robot's clock, s.
        grid: The occupancy grid.
        explored_fraction: Known area ÷ (known area + area estimated behind the frontiers), 0 to 1; for a recorded log,
            the fraction of its scans that are mapped.
        frontier_length: Total length of the frontiers between free and unknown space, m.
    """

    time: float
    grid: OccupancyGrid
    explored_fraction: float
    frontier_length: float


@dataclass(frozen=True, slots=True)
class StepTaken:
    """One action of the symbolic half and its outcome.

    Attributes:
        time: Time on the robot's clock, s.
        condition: cond(s) before the action, one bit for each term, such as "1001001".
        action: Name of the action.
        is_learning: Whether the step was exploration, or its prediction was wrong.
        has_effect: Whether the action changed the state.
        unknown_pairs: Number of (condition, action) pairs observed so far whose outcome the learner cannot predict.
        delivered: Number of boxes delivered so far.
        remaining: Number of boxes still to be delivered.
        plan: [M, 2] float32 m, map frame, centres of the cells along the plan.
    """

    time: float
    condition: str
    action: str
    is_learning: bool
    has_effect: bool
    unknown_pairs: int
    delivered: int
    remaining: int
    plan: NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class ObjectSnapshot:
    """One object of a state.

    Attributes:
        class_name: Name of the object's class, such as "Box".
        name: Name of the object.
        attributes: Names and values of the attributes, in the class's order.
    """

    class_name: str
    name: str
    attributes: tuple[tuple[str, bool | int | float | str], ...]


@dataclass(frozen=True, slots=True)
class PerceivedState:
    """The OO-MDP state that the robot perceives.

    Attributes:
        time: Time on the robot's clock, s.
        condition: cond(s), one bit for each term, such as "1001001".
        objects: The objects that can change; walls and warehouse are in `CellLayout`.
    """

    time: float
    condition: str
    objects: tuple[ObjectSnapshot, ...]


@dataclass(frozen=True, slots=True)
class LearntRule:
    """One learnt rule: the effect of an action under a condition.

    Attributes:
        action: Name of the action.
        condition: 0, 1 or * (either) for each term, such as "1**0***".
        effect: The effect as text, such as "robot.y += 1".
    """

    action: str
    condition: str
    effect: str


@dataclass(frozen=True, slots=True)
class LearntModel:
    """The learnt model of the actions; emitted again whenever it changes.

    Attributes:
        time: Time on the robot's clock, s.
        rules: The learnt rules.
        failures: For each action, the conditions under which it has no effect.
    """

    time: float
    rules: tuple[LearntRule, ...]
    failures: tuple[tuple[str, tuple[str, ...]], ...]


Record = RunStarted | Narration | RobotSnapshot | MapUpdate | CellLayout | StepTaken | PerceivedState | LearntModel
Sink = Callable[[Record], None]


def null_sink(record: Record) -> None:
    """Discard a record."""


def combine_sinks(*sinks: Sink) -> Sink:
    """A sink that passes every record to each of the given sinks, in their order."""

    def pass_on(record: Record) -> None:
        for sink in sinks:
            sink(record)

    return pass_on


def throttle_snapshots(sink: Sink, period: float) -> Sink:
    """A sink that limits the rate of snapshots and passes on all other records.

    Args:
        sink: The sink that records are passed on to.
        period: Minimum time between two snapshots on the robot's clock, s.
    """
    latest = -math.inf

    def pass_on(record: Record) -> None:
        nonlocal latest
        if isinstance(record, RobotSnapshot):
            if record.time < latest + period - TIME_TOLERANCE:
                return
            latest = record.time
        sink(record)

    return pass_on
