"""Moves between cells by a robot without physics: final positions of the robot and the boxes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wherry.floorplan.plan import Cell, Direction
from wherry.realization.execution import move_to_cell
from wherry.realization.pilot import Pilot
from wherry.realization.pose_tracker import PoseTracker
from wherry.simulation.model import BODY
from wherry.trace.records import null_sink
from wherry_testing.deliveries import hall
from wherry_testing.kinematic import KinematicRobot, OdometryPoseEstimator
from wherry_testing.perfect_worlds import centre

PLAN = hall()  # the robot in (1, 2), a box in (3, 2), a wall east of (4, 2)


def make(beside: str = " ") -> tuple[Pilot, KinematicRobot]:
    robot = KinematicRobot(hall(beside=beside))
    return Pilot(robot, PoseTracker(OdometryPoseEstimator(), robot.pose), null_sink), robot


def go(
    pilot: Pilot, here: Cell, direction: Direction, *, docking: bool = False, full: bool = False, held: bool = False
) -> bool:
    start, goal = centre(PLAN, here), centre(PLAN, here.neighbour(direction))
    return move_to_cell(pilot, start, goal, is_docking=docking, is_fork_full=full, is_holding=held)


def offset(robot: KinematicRobot, cell: Cell) -> float:
    """Distance of base_link from a cell's centre, m."""
    target = centre(PLAN, cell)
    return math.hypot(robot.pose.x - target[0], robot.pose.y - target[1])


@pytest.mark.parametrize("direction", list(Direction))
def test_a_free_move_ends_in_the_centre_of_the_next_cell(direction: Direction) -> None:
    pilot, robot = make()
    assert go(pilot, Cell(1, 2), direction) is True
    assert offset(robot, Cell(1, 2).neighbour(direction)) < 0.015
    heading = math.atan2(direction.dy, direction.dx)  # forwards: the fork leads
    assert abs(math.remainder(robot.pose.theta - heading, math.tau)) < 0.05


def test_a_blocked_move_returns_to_the_start() -> None:
    pilot, robot = make()
    assert go(pilot, Cell(1, 2), Direction.WEST) is True
    assert go(pilot, Cell(0, 2), Direction.WEST) is False
    assert offset(robot, Cell(0, 2)) < 0.015
    assert robot.nearest_wall > BODY.radius


def test_the_robot_docks_forwards_and_leaves_in_reverse_with_the_box() -> None:
    pilot, robot = make()
    assert go(pilot, Cell(1, 2), Direction.EAST) is True
    assert go(pilot, Cell(2, 2), Direction.EAST, docking=True) is True
    assert robot.close_latch()
    assert go(pilot, Cell(3, 2), Direction.SOUTH, full=True, held=True) is True
    assert offset(robot, Cell(3, 1)) < 0.015
    assert abs(math.remainder(robot.pose.theta - math.pi / 2, math.tau)) < 0.05  # the lidar leads
    assert math.dist(robot.boxes[0], centre(PLAN, Cell(3, 1))) < 0.02


def test_a_box_blocks_a_move_without_docking() -> None:
    pilot, robot = make()
    assert go(pilot, Cell(1, 2), Direction.EAST) is True
    assert go(pilot, Cell(2, 2), Direction.EAST) is False
    assert offset(robot, Cell(2, 2)) < 0.015


@pytest.mark.parametrize("held", [False, True])
def test_a_blocked_robot_with_a_full_fork_returns_to_its_cell(held: bool) -> None:
    pilot, robot = make(beside="o")
    assert go(pilot, Cell(1, 2), Direction.EAST) is True
    assert go(pilot, Cell(2, 2), Direction.EAST, docking=True) is True
    if held:
        assert robot.close_latch()
    assert go(pilot, Cell(3, 2), Direction.EAST, full=True, held=held) is False
    assert offset(robot, Cell(3, 2)) < 0.02
    np.testing.assert_allclose(robot.boxes[0], centre(PLAN, Cell(3, 2)), atol=0.02)
    assert robot.close_latch()
