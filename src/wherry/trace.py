"""What a run tells those who watch it: frozen records, in the order in which things happened.

Algorithms hand records to a `Sink` and know nothing of screens or files; views consume records and nothing else.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose


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


Record = Said | Seen | Explored | Stepped
Sink = Callable[[Record], None]


def ignore(record: Record) -> None:
    """A sink for runs that nobody watches."""
