"""The referee: records the ground truth of a simulated run, from which its score is computed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum, auto

import numpy as np

from wherry.floorplan.plan import Cell, FloorPlan
from wherry.simulation.physics import BodyKind, ContactBody, Physics
from wherry.simulation.static_geometry import StaticGeometry, distances_to_rectangles
from wherry.space.pose import Floats, Pose

FORK_REACH = 0.128  # m from base_link forwards to the prongs' tips
FORK_HALF_WIDTH = 0.14  # m from base_link sideways to a prong's inner face
COLLISION_GAP = 0.2  # s without contact after which another contact with the same body is a new collision
CELL_MARGIN = 0.1  # distance inside a cell's border at which the robot has entered the cell ÷ cell size


class BoxStatus(Enum):
    """Progress of a box's delivery."""

    ON_FLOOR = auto()
    HELD = auto()
    DELIVERED = auto()


@dataclass(frozen=True, slots=True)
class BoxTruth:
    """The true state of a box.

    Attributes:
        initial_cell: The cell in which it stood at the start.
        position: Centre x, y, m, world frame; of a delivered box, where it was released.
        status: On the floor, held by the robot, or delivered.
    """

    initial_cell: Cell
    position: tuple[float, float]
    status: BoxStatus


@dataclass(frozen=True, slots=True)
class Collision:
    """A contact of the robot or its load with a wall, an obstacle or another box.

    Attributes:
        time: Beginning of the contact, s.
        mover: The robot, or the box that is its load.
        touched: The wall, obstacle or other box that the mover touched.
        position: Point of contact x, y, m, world frame.
    """

    time: float
    mover: ContactBody
    touched: ContactBody
    position: tuple[float, float]


class Referee:
    """Records the ground truth of a run; the robot's own code must not read it.

    Args:
        plan: The floor plan.
        geometry: The plan's walls and obstacles.

    Attributes:
        plan: The floor plan.
        pose: base_link in the world frame.
        time: Time of the pose, s.
        collisions: Collisions so far, in order of time.
        boxes: True states of the boxes, in the order of the plan's boxes.
    """

    def __init__(self, plan: FloorPlan, geometry: StaticGeometry) -> None:
        self.plan = plan
        self.pose = Pose()
        self.time = 0.0
        self.collisions: list[Collision] = []
        self.boxes: tuple[BoxTruth, ...] = ()
        self._surfaces = geometry.surfaces()
        self._trajectory: list[tuple[float, float, float, float]] = []
        self._last_contact: dict[tuple[ContactBody, ContactBody], float] = {}
        self._visited_cells: list[Cell] = []

    @property
    def delivered(self) -> int:
        """Number of boxes delivered."""
        return sum(box.status is BoxStatus.DELIVERED for box in self.boxes)

    @property
    def trajectory(self) -> Floats:
        """[T, 4] true trajectory of base_link at 20 Hz: time, x, y, θ; s, m, m, rad, world frame."""
        return np.array(self._trajectory, dtype=np.float64).reshape(-1, 4)

    @property
    def visited_cells(self) -> tuple[Cell, ...]:
        """The cells driven through, in order; consecutive ones differ.

        A cell counts as entered at `CELL_MARGIN` inside its border, so that a robot on a border does not alternate.
        """
        return tuple(self._visited_cells)

    def wall_distance(self, points: Floats) -> Floats:
        """Distances to the nearest face of a wall or obstacle that is visible from inside the building.

        Args:
            points: [N, 2] points, m, world frame.

        Returns:
            [N] distances, m.
        """
        return distances_to_rectangles(self._surfaces, points)

    def record(self, time: float, pose: Pose) -> None:
        """Record base_link in the world frame at a time, s."""
        self.time, self.pose = time, pose
        self._trajectory.append((time, pose.x, pose.y, pose.theta))
        cell = self._entered_cell(pose)
        if cell is not None and (not self._visited_cells or self._visited_cells[-1] != cell):
            self._visited_cells.append(cell)

    def record_contacts(self, physics: Physics, held: int | None) -> None:
        """Record the collisions that begin at the present time step.

        Args:
            physics: The present state of the world.
            held: Index of the box that the latch holds; None for none.
        """
        for first, second, position in physics.contacts():
            load = held if held is not None else box_in_fork(physics.robot_pose, physics.box_positions)
            moving = {ContactBody(BodyKind.ROBOT)}
            if load is not None:
                moving.add(ContactBody(BodyKind.BOX, load))
            if (first in moving) == (second in moving):
                continue
            mover, touched = (first, second) if first in moving else (second, first)
            if physics.time - self._last_contact.get((mover, touched), -math.inf) > COLLISION_GAP:
                point = (float(position[0]), float(position[1]))
                self.collisions.append(Collision(physics.time, mover, touched, point))
            self._last_contact[mover, touched] = physics.time

    def _entered_cell(self, pose: Pose) -> Cell | None:
        """The cell that contains base_link; None within `CELL_MARGIN` of a border."""
        x, y = pose.x / self.plan.cell_size, pose.y / self.plan.cell_size
        inside = all(CELL_MARGIN <= part % 1 <= 1 - CELL_MARGIN for part in (x, y))
        return Cell(math.floor(x), math.floor(y)) if inside else None


def box_in_fork(pose: Pose, boxes: Floats) -> int | None:
    """Index of the box between the prongs; None if there is none.

    Args:
        pose: base_link in the world frame.
        boxes: [B, 3] centres of the boxes, m, world frame.
    """
    if not len(boxes):
        return None
    local = pose.inverse.transform(boxes[:, :2])
    inside = (np.abs(local[:, 0]) <= FORK_REACH) & (np.abs(local[:, 1]) <= FORK_HALF_WIDTH) & (boxes[:, 2] > 0)
    return int(np.argmax(inside)) if inside.any() else None
