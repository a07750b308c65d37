"""The referee: the only one who sees the simulator's truth, and scores a run by it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np

from wherry.floorplan.plan import Cell, FloorPlan
from wherry.simulation.physics import Kind, Physics, Thing
from wherry.simulation.solids import Solids, distances_to
from wherry.space.pose import Floats, Pose

FORK_REACH = 0.128  # m, from base_link to the prongs' tips
FORK_HALF_WIDTH = 0.14  # m, from base_link to a prong's inner face
EPISODE_GAP = 0.2  # s without contact after which touching the same thing counts again
CELL_MARGIN = 0.1  # of a cell: how far the robot must be in another cell for it to count as entered


class BoxPlace(Enum):
    """Where a box is."""

    FLOOR = "on the floor"
    HELD = "held"
    DELIVERED = "delivered"


@dataclass(frozen=True, slots=True)
class BoxTruth:
    """A box as it is.

    Attributes:
        first_cell: Where it stood at first.
        position: x and y, m, world frame; where it was let go, once it is delivered.
        place: On the floor, held by the robot, or delivered.
    """

    first_cell: Cell
    position: tuple[float, float]
    place: BoxPlace


@dataclass(frozen=True, slots=True)
class Collision:
    """A contact that must not be, from first touch to parting.

    Attributes:
        time: s, of the first touch.
        mover: What was driven: ``robot`` or, if its load touched, ``box <k>``.
        touched: What it touched: ``wall <k>``, ``obstacle <k>`` or ``box <k>``.
        position: x and y, m, world frame.
    """

    time: float
    mover: str
    touched: str
    position: tuple[float, float]


class Referee:
    """Keeps the truth of a run. The simulation tells it; nothing that drives the robot may ask it.

    Args:
        plan: The world.
        solids: Its walls and obstacles.
    """

    def __init__(self, plan: FloorPlan, solids: Solids) -> None:
        self.plan = plan
        self.pose = Pose()
        self.time = 0.0
        self.collisions: list[Collision] = []
        self.boxes: tuple[BoxTruth, ...] = ()
        self._surfaces = solids.surfaces()
        self._history: list[tuple[float, float, float, float]] = []
        self._last_touch: dict[tuple[Thing, Thing], float] = {}
        self._cells: list[Cell] = []

    @property
    def delivered(self) -> int:
        """How many boxes the warehouse has."""
        return sum(box.place is BoxPlace.DELIVERED for box in self.boxes)

    @property
    def history(self) -> Floats:
        """[T, 4] s, m, m, rad: times, and base_link in the world frame then, 20 times a second."""
        return np.array(self._history, dtype=np.float64).reshape(-1, 4)

    @property
    def trajectory(self) -> tuple[Cell, ...]:
        """The cells driven through; consecutive ones differ.

        A cell counts as entered a tenth of a cell behind its border, so that standing on a border is one visit.
        """
        return tuple(self._cells)

    def wall_distance(self, points: Floats) -> Floats:
        """How far points are from the nearest face of a wall or obstacle that can be seen from inside the building.

        Args:
            points: [N, 2] m, world frame.

        Returns:
            [N] m.
        """
        return distances_to(self._surfaces, points)

    def record(self, time: float, pose: Pose) -> None:
        """Take note of where the robot is: s, and base_link in the world frame."""
        self.time, self.pose = time, pose
        self._history.append((time, pose.x, pose.y, pose.theta))
        cell = self._entered(pose)
        if cell is not None and (not self._cells or self._cells[-1] != cell):
            self._cells.append(cell)

    def watch(self, physics: Physics, held: int | None) -> None:
        """Look at what touches what at this instant.

        Args:
            physics: The world.
            held: The box that the latch holds.
        """
        for first, second, position in physics.touching():
            load = held if held is not None else box_in_fork(physics.robot_pose, physics.box_positions)
            driven = {Thing(Kind.ROBOT), Thing(Kind.BOX, load)} if load is not None else {Thing(Kind.ROBOT)}
            if (first in driven) == (second in driven):
                continue
            mover, touched = (first, second) if first in driven else (second, first)
            if physics.time - self._last_touch.get((mover, touched), -math.inf) > EPISODE_GAP:
                place = (float(position[0]), float(position[1]))
                self.collisions.append(Collision(physics.time, str(mover), str(touched), place))
            self._last_touch[mover, touched] = physics.time

    def _entered(self, pose: Pose) -> Cell | None:
        """The cell that the robot is in, unless it is too near a border to tell."""
        x, y = pose.x / self.plan.cell_size, pose.y / self.plan.cell_size
        inside = all(CELL_MARGIN <= part % 1 <= 1 - CELL_MARGIN for part in (x, y))
        return Cell(math.floor(x), math.floor(y)) if inside else None


def box_in_fork(pose: Pose, boxes: Floats) -> int | None:
    """Which box stands between the prongs.

    Args:
        pose: base_link in the world frame.
        boxes: [B, 3] m, world frame, the boxes' centres.
    """
    if not len(boxes):
        return None
    local = pose.inverse.transform(boxes[:, :2])
    inside = (np.abs(local[:, 0]) <= FORK_REACH) & (np.abs(local[:, 1]) <= FORK_HALF_WIDTH) & (boxes[:, 2] > 0)
    return int(np.argmax(inside)) if inside.any() else None
