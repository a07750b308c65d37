"""What can go wrong with a robot, on demand: it is carried off, its wheels slip, its lidar goes blind."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from wherry.floorplan.plan import Cell, FloorPlan
from wherry.simulation.model import BODY, BOX_RADIUS, WHEEL_GRIP
from wherry.simulation.referee import BoxPlace
from wherry.simulation.simulator import Simulation
from wherry.simulation.solids import clearance
from wherry.space.pose import Pose

ELBOW_ROOM = 0.03  # m, between the robot and anything else where it is put down


def kidnap(simulation: Simulation, pose: Pose) -> None:
    """Carry the robot, and the box that it holds, to another place; its wheels do not notice.

    Raises:
        ValueError: The robot would stand in something.
    """
    if not _is_free(simulation, pose):
        raise ValueError(f"something stands at {pose}")
    simulation.physics.place_robot(pose, simulation.held)


def random_pose(simulation: Simulation, rng: np.random.Generator) -> Pose:
    """A place where the robot could be, in a cell that it can reach; uniform over the free floor and all headings."""
    plan = simulation.plan
    assert plan.start is not None  # noqa: S101 - `build` made sure of it
    cells = sorted(plan.distances(plan.start))
    while True:
        cell = cells[rng.integers(len(cells))]
        x, y = rng.uniform((cell.x, cell.y), (cell.x + 1, cell.y + 1)) * plan.cell_size
        pose = Pose(float(x), float(y), float(rng.uniform(-math.pi, math.pi)))
        if _is_free(simulation, pose):
            return pose


def random_cell_pose(plan: FloorPlan, rng: np.random.Generator) -> Pose:
    """A random heading at the centre of a random cell that the robot can reach and that holds no box.

    Args:
        plan: The building, with its boxes at their cells.
        rng: Source of the randomness.
    """
    cells = [cell for cell in reachable_cells(plan) if cell not in plan.boxes]
    return cell_pose(plan, cells[int(rng.integers(len(cells)))], float(rng.uniform(-math.pi, math.pi)))


def reachable_cells(plan: FloorPlan) -> list[Cell]:
    """The cells that the robot can reach from its start, in order; none if the plan has no robot."""
    return sorted(plan.distances(plan.start)) if plan.start is not None else []


def cell_pose(plan: FloorPlan, cell: Cell, heading: float) -> Pose:
    """The pose of base_link at the centre of a cell with a heading in rad, world frame."""
    return Pose((cell.x + 0.5) * plan.cell_size, (cell.y + 0.5) * plan.cell_size, heading)


@contextmanager
def slippery(simulation: Simulation, friction: float = 0.03) -> Iterator[None]:
    """Let the wheels slip whenever the robot speeds up, slows down or turns.

    Args:
        simulation: The world.
        friction: Coefficient of friction between wheels and floor; 1.0 when all is well.
    """
    simulation.physics.grip_wheels(friction)
    try:
        yield
    finally:
        simulation.physics.grip_wheels(WHEEL_GRIP)


@contextmanager
def blind(simulation: Simulation) -> Iterator[None]:
    """Let the lidar turn without a reading: every range is NaN."""
    simulation.lidar.blind = True
    try:
        yield
    finally:
        simulation.lidar.blind = False


def _is_free(simulation: Simulation, pose: Pose) -> bool:
    """Whether the robot, turned any way, would touch nothing."""
    room = clearance(simulation.solids, np.array([[pose.x, pose.y]]))[0] - BODY.radius
    for index, box in enumerate(simulation.referee.boxes):
        if box.place is BoxPlace.FLOOR and index != simulation.held:
            distance = math.hypot(box.position[0] - pose.x, box.position[1] - pose.y)
            room = min(room, distance - BOX_RADIUS - BODY.radius)
    return bool(room >= ELBOW_ROOM)
