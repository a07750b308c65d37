"""Every built-in world can be solved by this robot on this physics: a driver who sees the truth delivers all boxes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wherry.floorplan.generation import place_boxes
from wherry.floorplan.plan import Cell, Direction, FloorPlan
from wherry.floorplan.world_files import find_world
from wherry.simulation import Simulation, build
from wherry_testing.halls import drive, stop, turn_to


def _way(plan: FloorPlan, start: Cell, goal: Cell, avoid: set[Cell]) -> list[Cell]:
    """A shortest way: the cells after the start."""
    distances = plan.distances(goal, avoid)
    way = [start]
    while way[-1] != goal:
        steps = [way[-1].neighbour(side) for side in Direction if not plan.is_blocked(way[-1], side)]
        way.append(min(steps, key=lambda cell: distances.get(cell, math.inf)))
    return way[1:]


def _drive_to(simulation: Simulation, x: float, y: float, *, backwards: bool) -> None:
    """Turn on the spot and drive a straight line."""
    sign = -1 if backwards else 1
    pose = simulation.referee.pose
    turn_to(simulation, math.atan2(sign * (y - pose.y), sign * (x - pose.x)))
    while (ahead := sign * simulation.referee.pose.inverse.transform(np.array([[x, y]]))[0, 0]) > 0.005:
        dx, dy = x - simulation.referee.pose.x, y - simulation.referee.pose.y
        aside = math.remainder(math.atan2(sign * dy, sign * dx) - simulation.referee.pose.theta, math.tau)
        drive(simulation, sign * min(0.5, 2 * ahead), 3 * aside if ahead > 0.1 else 0.0, 0.05)
    stop(simulation)


def _deliver_all(simulation: Simulation) -> int:
    """Deliver the boxes, always the nearest first; return how many cells were to be driven."""
    plan, boxes = simulation.plan, set(simulation.plan.boxes)
    at, driven = plan.start, 0
    while boxes:
        goal = min(boxes, key=plan.distances(at).__getitem__)
        boxes.remove(goal)
        way = _way(plan, at, goal, boxes)
        for cell in way[:-1]:
            _drive_to(simulation, *_centre(plan, cell), backwards=False)
        _drive_to(simulation, *simulation.referee.boxes[plan.boxes.index(goal)].position, backwards=False)
        assert simulation.robot.close_latch()
        at = min(plan.warehouse, key=lambda place: (plan.distances(goal, boxes)[place], place))
        way += _way(plan, goal, at, boxes)
        for cell in way[way.index(goal) + 1 :]:
            _drive_to(simulation, *_centre(plan, cell), backwards=True)
        assert simulation.robot.open_latch()
        driven += len(way)
    return driven


def _centre(plan: FloorPlan, cell: Cell) -> tuple[float, float]:
    return (cell.x + 0.5) * plan.cell_size, (cell.y + 0.5) * plan.cell_size


@pytest.mark.parametrize("name", ["small", "taxi", "rooms"])
def test_a_driver_who_sees_the_truth_delivers_every_box(name: str) -> None:
    plan = find_world(name)
    if not plan.boxes:
        plan = place_boxes(plan, plan.box_count, np.random.default_rng(0))
    simulation = build(plan, np.random.default_rng(0))
    driven = _deliver_all(simulation)
    assert simulation.referee.delivered == len(plan.boxes)
    assert simulation.referee.collisions == []
    assert len(simulation.referee.trajectory) - 1 == driven
