"""The referee: trajectory, visited cells, collisions and distances to walls."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from wherry.floorplan.plan import Cell
from wherry.simulation.physics import BodyKind, ContactBody
from wherry.simulation.referee import FORK_HALF_WIDTH, FORK_REACH, Referee, box_in_fork
from wherry.simulation.static_geometry import StaticGeometry
from wherry.space.pose import Pose
from wherry_testing.halls import CELL, drive, drive_to_x, hall, noise_free, stop, turn_to


def test_distance_to_walls_and_obstacles() -> None:
    referee = noise_free(hall()).referee
    points = np.array([[0.03, 1.0], [0.5, 0.03 + 0.2], [7.0 * CELL - 0.1, 3.5 * CELL], [0.0, 1.0], [0.05, 1.0]])
    assert_allclose(referee.wall_distance(points), [0.0, 0.2, 0.1, 0.03, 0.02], atol=1e-12)


def test_the_trajectory_has_times_and_true_poses() -> None:
    simulation = noise_free(hall(o=" "))
    drive(simulation, 0.4, 0.0, 3.0)
    trajectory = simulation.referee.trajectory
    assert trajectory.shape == (61, 4)
    assert_allclose(np.diff(trajectory[:, 0]), 0.05)
    assert_allclose(np.diff(trajectory[-10:, 1]), 0.02, rtol=0.02)
    assert_allclose(trajectory[-1, 1:], simulation.referee.pose.as_array())


def test_visited_cells_are_those_driven_through() -> None:
    simulation = noise_free(hall(o=" "))
    drive_to_x(simulation, 4.5 * CELL)
    drive_to_x(simulation, 2.5 * CELL)
    turn_to(simulation, -math.pi / 2)
    drive(simulation, 0.4, 0.0, 1.5)
    cells = [Cell(x, 2) for x in (1, 2, 3, 4, 3, 2)]
    assert simulation.referee.visited_cells == (*cells, Cell(2, 1))


def test_a_robot_on_a_border_does_not_change_cells() -> None:
    plan = hall()
    referee = Referee(plan, StaticGeometry.from_plan(plan))
    for x in (0.8, 0.95, 1.05, 0.99, 1.01, 0.95, 1.08, 1.15, 1.05, 0.95, 1.2):
        referee.record(0.0, Pose(x * CELL, 0.5 * CELL, 0.0))
    assert referee.visited_cells == (Cell(0, 0), Cell(1, 0))


def test_driving_into_a_wall_is_one_collision_until_contact_ends() -> None:
    simulation = noise_free(hall(o=" "))
    turn_to(simulation, math.pi / 2)
    drive(simulation, 0.3, 0.0, 4.0)
    assert len(simulation.referee.collisions) == 1
    (collision,) = simulation.referee.collisions
    assert collision.mover == ContactBody(BodyKind.ROBOT)
    assert collision.touched.kind is BodyKind.WALL
    assert collision.position[1] == pytest.approx(4 * CELL - 0.03, abs=0.01)
    assert 0 < collision.time < simulation.time
    drive(simulation, -0.3, 0.0, 1.0)
    drive(simulation, 0.3, 0.0, 2.0)
    assert len(simulation.referee.collisions) == 2
    assert simulation.referee.collisions[1].time > collision.time + 1.0


def test_a_short_contact_is_a_collision() -> None:
    simulation = noise_free(hall(o=" "))
    turn_to(simulation, math.pi / 2)
    for _ in range(200):
        drive(simulation, 0.3, 0.0, 0.05)
        if simulation.referee.collisions:
            break
    drive(simulation, -0.5, 0.0, 1.0)
    assert len(simulation.referee.collisions) == 1


def test_driving_into_an_obstacle_is_a_collision() -> None:
    simulation = noise_free(hall(o=" "))
    drive_to_x(simulation, 7.5 * CELL)
    turn_to(simulation, math.pi / 2)
    drive(simulation, 0.3, 0.0, 2.0)
    assert simulation.referee.collisions[0].touched == ContactBody(BodyKind.OBSTACLE, 0)


def test_knocking_a_box_with_a_prong_is_a_collision() -> None:
    simulation = noise_free(hall(), ((0.0, 0.12),))
    drive(simulation, 0.4, 0.0, 5.0)
    assert [collision.touched for collision in simulation.referee.collisions] == [ContactBody(BodyKind.BOX, 0)]


def test_contact_with_the_box_in_the_fork_is_no_collision() -> None:
    simulation = noise_free(hall(), ((0.0, 0.03),))
    drive_to_x(simulation, 4.5 * CELL)
    drive(simulation, 0.0, 2.0, 4.0)
    drive(simulation, 0.0, -2.0, 4.0)
    turn_to(simulation, 0.0)
    drive(simulation, 0.2, 0.0, 1.5)  # the beam behind the fork pushes it
    assert simulation.physics.box_positions[0, 0] > 4.6 * CELL
    assert simulation.referee.collisions == []


def test_a_contact_of_the_load_is_a_collision() -> None:
    simulation = noise_free(hall())
    drive_to_x(simulation, 4.5 * CELL)
    simulation.robot.close_latch()
    drive(simulation, 0.0, 0.0, 0.2)
    drive(simulation, 0.4, 0.0, 6.0)
    movers = {collision.mover for collision in simulation.referee.collisions}
    assert movers & {ContactBody(BodyKind.ROBOT), ContactBody(BodyKind.BOX, 0)}
    assert all(collision.touched.kind is BodyKind.WALL for collision in simulation.referee.collisions)


def test_a_box_pushed_by_a_box_is_a_collision_of_the_load() -> None:
    simulation = noise_free(hall(o=" ").with_boxes([Cell(4, 2), Cell(6, 2)]))
    drive_to_x(simulation, 4.5 * CELL)
    drive(simulation, 0.4, 0.0, 3.0)  # unlatched: the beam pushes one box against the other
    stop(simulation)
    pairs = {(collision.mover, collision.touched) for collision in simulation.referee.collisions}
    pushed = ContactBody(BodyKind.BOX, 1)
    assert (ContactBody(BodyKind.BOX, 0), pushed) in pairs or (ContactBody(BodyKind.ROBOT), pushed) in pairs


def test_free_driving_has_no_collisions() -> None:
    simulation = noise_free(hall(o=" "))
    drive(simulation, 0.6, 0.0, 4.0)
    drive(simulation, 0.0, 2.5, 2.0)
    drive(simulation, 0.0, -2.5, 2.0)
    stop(simulation)
    assert simulation.referee.collisions == []


def test_a_box_between_the_prongs_is_in_the_fork() -> None:
    robot = Pose(1.0, 2.0, math.pi / 2)
    assert box_in_fork(robot, np.empty((0, 3))) is None
    boxes = np.array([[5.0, 5.0, 0.15], [1.0 - FORK_HALF_WIDTH + 0.01, 2.0 + FORK_REACH - 0.01, 0.15]])
    assert box_in_fork(robot, boxes) == 1
    assert box_in_fork(Pose(1.0, 2.0, math.pi), boxes) is None
    assert box_in_fork(Pose(1.0, 1.9, math.pi / 2), boxes) is None
    assert box_in_fork(robot, boxes - (0.0, 0.0, 0.5)) is None
