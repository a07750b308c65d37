"""A controller that knows the true pose delivers all boxes of the built-in worlds without a collision."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wherry.floorplan.generation import place_boxes
from wherry.floorplan.plan import Cell, Direction, FloorPlan
from wherry.floorplan.world_files import find_world
from wherry.simulation import Simulation, build
from wherry_testing.halls import drive, stop, turn_to
from wherry_testing.perfect_worlds import centre


def _path(plan: FloorPlan, start: Cell, goal: Cell, avoid: set[Cell]) -> list[Cell]:
    """The cells of a shortest path, without its start."""
    distances = plan.distances(goal, avoid)
    path = [start]
    while path[-1] != goal:
        steps = [path[-1].neighbour(side) for side in Direction if not plan.is_blocked(path[-1], side)]
        path.append(min(steps, key=lambda cell: distances.get(cell, math.inf)))
    return path[1:]


def _drive_to(simulation: Simulation, x: float, y: float, *, backwards: bool) -> None:
    """Turn on the spot and drive straight to a point, m, world frame."""
    sign = -1 if backwards else 1
    pose = simulation.referee.pose
    turn_to(simulation, math.atan2(sign * (y - pose.y), sign * (x - pose.x)))
    while (ahead := sign * simulation.referee.pose.inverse.transform(np.array([[x, y]]))[0, 0]) > 0.005:
        dx, dy = x - simulation.referee.pose.x, y - simulation.referee.pose.y
        error = math.remainder(math.atan2(sign * dy, sign * dx) - simulation.referee.pose.theta, math.tau)
        drive(simulation, sign * min(0.5, 2 * ahead), 3 * error if ahead > 0.1 else 0.0, 0.05)
    stop(simulation)


def _deliver_all(simulation: Simulation) -> int:
    """Deliver the boxes, the nearest first; return the number of cells driven."""
    plan, boxes = simulation.plan, set(simulation.plan.boxes)
    cell_of_robot, cells_driven = plan.start, 0
    while boxes:
        goal = min(boxes, key=plan.distances(cell_of_robot).__getitem__)
        boxes.remove(goal)
        path = _path(plan, cell_of_robot, goal, boxes)
        for cell in path[:-1]:
            _drive_to(simulation, *centre(plan, cell), backwards=False)
        _drive_to(simulation, *simulation.referee.boxes[plan.boxes.index(goal)].position, backwards=False)
        assert simulation.robot.close_latch()
        cell_of_robot = min(plan.warehouse, key=lambda cell: (plan.distances(goal, boxes)[cell], cell))
        path += _path(plan, goal, cell_of_robot, boxes)
        for cell in path[path.index(goal) + 1 :]:
            _drive_to(simulation, *centre(plan, cell), backwards=True)
        assert simulation.robot.open_latch()
        cells_driven += len(path)
    return cells_driven


@pytest.mark.parametrize("name", ["small", "taxi", "rooms"])
def test_all_boxes_can_be_delivered_with_the_true_pose(name: str) -> None:
    plan = find_world(name)
    if not plan.boxes:
        plan = place_boxes(plan, plan.box_count, np.random.default_rng(0))
    simulation = build(plan, np.random.default_rng(0))
    cells_driven = _deliver_all(simulation)
    assert simulation.referee.delivered == len(plan.boxes)
    assert simulation.referee.collisions == []
    assert len(simulation.referee.visited_cells) - 1 == cells_driven
