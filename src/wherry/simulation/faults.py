"""Faults that a simulation can inject: a kidnapped robot, slipping wheels, a blinded lidar."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from wherry.floorplan.plan import Cell, FloorPlan
from wherry.simulation.model import BODY, BOX_RADIUS, WHEEL_FRICTION
from wherry.simulation.referee import BoxStatus
from wherry.simulation.simulator import Simulation
from wherry.simulation.static_geometry import clearance
from wherry.space.pose import Pose

MIN_CLEARANCE = 0.03  # m between a placed robot's footprint and any wall, obstacle or box


def kidnap(simulation: Simulation, pose: Pose) -> None:
    """Move the robot and its load to a pose in the world frame without a change in its odometry.

    Raises:
        ValueError: The robot would collide there.
    """
    if not _is_free(simulation, pose):
        raise ValueError(f"the robot would collide at {pose}")
    simulation.physics.place_robot(pose, simulation.held)


def random_pose(simulation: Simulation, rng: np.random.Generator) -> Pose:
    """Draw a collision-free pose, world frame, uniform over the free floor of the reachable cells and all headings."""
    plan = simulation.plan
    cells = reachable_cells(plan)
    while True:
        cell = cells[rng.integers(len(cells))]
        x, y = rng.uniform((cell.x, cell.y), (cell.x + 1, cell.y + 1)) * plan.cell_size
        pose = Pose(float(x), float(y), float(rng.uniform(-math.pi, math.pi)))
        if _is_free(simulation, pose):
            return pose


def random_cell_pose(plan: FloorPlan, rng: np.random.Generator) -> Pose:
    """Draw a reachable cell without a box and a heading; return the pose at the cell's centre, world frame.

    Args:
        plan: The floor plan with its boxes placed.
        rng: Source of the randomness.
    """
    cells = [cell for cell in reachable_cells(plan) if cell not in plan.boxes]
    return cell_pose(plan, cells[int(rng.integers(len(cells)))], float(rng.uniform(-math.pi, math.pi)))


def reachable_cells(plan: FloorPlan) -> list[Cell]:
    """The cells that the robot can reach from its start, sorted; empty if the plan has no robot."""
    return sorted(plan.distances(plan.start)) if plan.start is not None else []


def cell_pose(plan: FloorPlan, cell: Cell, heading: float) -> Pose:
    """The pose of base_link at the centre of a cell with a heading in rad, world frame."""
    return Pose(*plan.centre(cell), heading)


@contextmanager
def slippery_wheels(simulation: Simulation, friction: float = 0.03) -> Iterator[None]:
    """Lower the wheels' friction in the context, so that they slip when the robot accelerates, brakes or turns.

    Args:
        simulation: The simulation.
        friction: Friction coefficient of the wheels on the floor; without the fault it is `WHEEL_FRICTION`.
    """
    simulation.physics.set_wheel_friction(friction)
    try:
        yield
    finally:
        simulation.physics.set_wheel_friction(WHEEL_FRICTION)


@contextmanager
def blind_lidar(simulation: Simulation) -> Iterator[None]:
    """Make every range of the lidar NaN in the context."""
    simulation.lidar.is_blind = True
    try:
        yield
    finally:
        simulation.lidar.is_blind = False


def _is_free(simulation: Simulation, pose: Pose) -> bool:
    """Whether the robot's round footprint has enough clearance at a pose."""
    gap = clearance(simulation.geometry, np.array([[pose.x, pose.y]]))[0] - BODY.radius
    for index, box in enumerate(simulation.referee.boxes):
        if box.status is BoxStatus.ON_FLOOR and index != simulation.held:
            distance = math.hypot(box.position[0] - pose.x, box.position[1] - pose.y)
            gap = min(gap, distance - BOX_RADIUS - BODY.radius)
    return bool(gap >= MIN_CLEARANCE)
