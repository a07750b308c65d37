"""What a run tells those who watch it: frozen records, in the order in which things happened.

Algorithms hand records to a `Sink` and know nothing of screens or files; views consume records and nothing else.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.space.frame import CellFrame
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose

TIME_SLACK = 1e-6  # s; sums of periods are not exact


@dataclass(frozen=True, slots=True)
class Began:
    """What is about to run; the first record of every trace.

    Attributes:
        task: "deliver", "map", "localize" or "learn".
        subject: The world, or the log.
        learner: What the symbolic half learns with; "" where there is none.
        terms: The terms' names in the order of conditions; empty where there are none.
        actions: The actions' names.
        robot_radius: m; 0 where there is no robot.
        box_radius: m; 0 where there are no boxes.
    """

    task: str
    subject: str
    learner: str = ""
    terms: tuple[str, ...] = ()
    actions: tuple[str, ...] = ()
    robot_radius: float = 0.0
    box_radius: float = 0.0


@dataclass(frozen=True, slots=True)
class CellsLaid:
    """The grid of cells that was laid on the map.

    Attributes:
        time: s.
        frame: Where the cells lie in the map frame.
        warehouse: [K, 2] int32, x and y of the warehouse's cells.
        walls: [W, 3] int32, x and y of a cell and 1 for a wall on its north edge, 0 for one on its east edge.
    """

    time: float
    frame: CellFrame
    warehouse: NDArray[np.int32]
    walls: NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class Said:
    """What the robot does and why, in words.

    Attributes:
        time: s, on the robot's clock.
        phase: "explore", "localize", "survey", "learn", "deliver" or "done".
        text: One sentence.
    """

    time: float
    phase: str
    text: str


@dataclass(frozen=True, slots=True)
class Seen:
    """What the robot senses and believes at an instant, all in the map frame.

    Attributes:
        time: s.
        pose: Where it believes base_link to be.
        lidar: Where its lidar is then.
        points: [P, 2] float32 m, where the laser's beams ended.
        particles: [N, 3] float32 x m, y m, θ rad; empty while the robot maps.
        path: [M, 2] float32 m, where it is about to drive.
        boxes: [B, 2] float32 m, the boxes that it believes to stand on the floor.
        loaded: Whether its latch holds a box.
    """

    time: float
    pose: Pose
    lidar: Pose
    points: NDArray[np.float32]
    particles: NDArray[np.float32]
    path: NDArray[np.float32]
    boxes: NDArray[np.float32]
    loaded: bool


@dataclass(frozen=True, slots=True)
class Explored:
    """How far mapping has come.

    Attributes:
        time: s.
        grid: The map so far.
        fraction: Known area ÷ (known area + the area that the frontiers are expected to open), 0 to 1.
        frontier: m, how long the edges between known free space and the unknown are.
    """

    time: float
    grid: OccupancyGrid
    fraction: float
    frontier: float


@dataclass(frozen=True, slots=True)
class Stepped:
    """One action of the symbolic half and what came of it.

    Attributes:
        time: s.
        condition: The terms' values before it, in the domain's order, such as "1001001".
        action: Its name.
        learning: Whether the learner could not tell beforehand what it would do.
        moved: Whether anything changed.
        unknown: How many (condition, action) pairs met so far the learner cannot predict yet.
        delivered: Boxes that the robot believes to have delivered.
        remaining: Boxes that it believes to be left.
        plan: [M, 2] float32 m, map frame: the cells that it means to drive through.
    """

    time: float
    condition: str
    action: str
    learning: bool
    moved: bool
    unknown: int
    delivered: int
    remaining: int
    plan: NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Thing:
    """An object of the state, as people look at it.

    Attributes:
        kind: Its class.
        name: Its name.
        values: Attribute and value, in the class's order.
    """

    kind: str
    name: str
    values: tuple[tuple[str, bool | int | float | str], ...]


@dataclass(frozen=True, slots=True)
class Perceived:
    """The state that the robot takes itself to be in.

    Attributes:
        time: s.
        condition: cond(s), such as "1001001".
        things: The objects that change; walls and warehouse are in `CellsLaid`.
    """

    time: float
    condition: str
    things: tuple[Thing, ...]


@dataclass(frozen=True, slots=True)
class LearntRule:
    """What an action does, and when.

    Attributes:
        action: Its name.
        condition: Signs 0, 1 and * for the terms in the domain's order, such as "1**0***".
        effect: Such as "robot.y += 1".
    """

    action: str
    condition: str
    effect: str


@dataclass(frozen=True, slots=True)
class Learnt:
    """All that is believed of what actions do; told whenever it changes.

    Attributes:
        time: s.
        rules: The rules.
        failures: For each action, the conditions in which it is known to do nothing.
    """

    time: float
    rules: tuple[LearntRule, ...]
    failures: tuple[tuple[str, tuple[str, ...]], ...]


Record = Began | Said | Seen | Explored | CellsLaid | Stepped | Perceived | Learnt
Sink = Callable[[Record], None]


def ignore(record: Record) -> None:
    """A sink for runs that nobody watches."""


def both(*sinks: Sink) -> Sink:
    """A sink that hands every record to all of these, in their order."""

    def hand_on(record: Record) -> None:
        for sink in sinks:
            sink(record)

    return hand_on


def thinned(sink: Sink, period: float) -> Sink:
    """A sink that lets `Seen` through only so often, and everything else always.

    Args:
        sink: What is handed on to.
        period: s, on the robot's clock, from one `Seen` to the next.
    """
    latest = -math.inf

    def hand_on(record: Record) -> None:
        nonlocal latest
        if isinstance(record, Seen):
            if record.time < latest + period - TIME_SLACK:
                return
            latest = record.time
        sink(record)

    return hand_on
