"""The robot's world as an Environment, on the simulator: the paper's seven bits at every stage of a delivery."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wherry.domains.delivery import DROPOFF, PICKUP
from wherry.floorplan.plan import Cell
from wherry.oomdp.domain import Action
from wherry.oomdp.mdp import Environment
from wherry.realization.boxes import Box
from wherry.realization.environment import RobotEnvironment
from wherry.realization.tracking import PoseTracker
from wherry.simulation import BoxPlace, Simulation
from wherry.simulation.simulator import LATCH_REACH
from wherry.space.pose import Pose
from wherry_testing.deliveries import hall, stand_ready
from wherry_testing.environment_contract import EnvironmentContract
from wherry_testing.perfect_worlds import centre

N, S, E, W = (Action(name) for name in "NSEW")
HOME = 0.03  # m from a cell's middle


def bits(environment: RobotEnvironment) -> str:
    """touch_N, touch_S, touch_E, touch_W, on(robot, box), on(robot, warehouse), box.in_bot."""
    return str(environment.domain.cond(environment.reset(np.random.default_rng(0))))


def do(environment: RobotEnvironment, actions: str) -> list[bool]:
    """Do moves; which of them changed something."""
    return [not environment.step(Action(name)).failed for name in actions]


def off_centre(simulation: Simulation, cell: Cell) -> float:
    """m: how far the robot truly is from a cell's middle."""
    middle, pose = centre(simulation.plan, cell), simulation.referee.pose
    return math.hypot(pose.x - middle[0], pose.y - middle[1])


class TestContract(EnvironmentContract):
    @pytest.fixture
    def environment(self) -> Environment:
        return stand_ready(hall())[0]


def test_a_whole_delivery_bit_by_bit() -> None:
    environment, simulation = stand_ready(hall())
    assert bits(environment) == "0000000"
    assert do(environment, "W") == [True]
    assert bits(environment) == "0001000"
    assert do(environment, "EEE") == [True] * 3
    assert bits(environment) == "0000100"  # docked: on(robot, box)
    assert environment.step(PICKUP).next_state["box1"].in_bot is True
    assert bits(environment) == "0000001"  # held: no longer on(robot, box)
    assert simulation.referee.boxes[0].place is BoxPlace.HELD
    assert do(environment, "WWW") == [True] * 3
    assert bits(environment) == "0001001"
    assert do(environment, "SS") == [True] * 2
    assert bits(environment) == "0101011"
    assert simulation.referee.trajectory[-1] == Cell(0, 0)
    dropped = environment.step(DROPOFF)
    assert dropped.terminated
    assert dropped.next_state.of_class("Box") == ()
    assert bits(environment) == "0101010"
    assert (environment.delivered, environment.remaining) == (1, 0)
    assert simulation.referee.delivered == 1
    assert simulation.referee.collisions == []


@pytest.mark.parametrize(
    ("way", "cell", "expected"),
    [
        ("N", Cell(1, 3), "1000000"),
        ("NW", Cell(0, 3), "1001000"),
        ("NEEE", Cell(4, 3), "1010000"),  # beside an inner wall
        ("SS", Cell(1, 0), "0100010"),
        ("SEEEEEEN", Cell(7, 2), "1010000"),  # under an obstacle
    ],
)
def test_walls_and_obstacles_are_touched_where_they_are(way: str, cell: Cell, expected: str) -> None:
    environment, simulation = stand_ready(hall())
    assert all(do(environment, way))
    assert environment.cell == cell
    assert bits(environment) == expected
    assert off_centre(simulation, cell) < 0.04


@pytest.mark.parametrize(
    ("way", "stopped", "cell"), [("N", "N", Cell(1, 3)), ("W", "W", Cell(0, 2)), ("NEEE", "E", Cell(4, 3))]
)
def test_a_stopped_move_ends_in_the_middle_of_its_cell_without_contact(way: str, stopped: str, cell: Cell) -> None:
    for seed in range(3):
        environment, simulation = stand_ready(hall(), seed)
        assert all(do(environment, way))
        assert do(environment, stopped * 2) == [False, False]
        assert environment.cell == cell
        assert off_centre(simulation, cell) < HOME
        assert simulation.referee.collisions == []


def test_latch_and_conveyor_do_nothing_where_they_cannot() -> None:
    environment, simulation = stand_ready(hall())
    for action in (PICKUP, DROPOFF):
        assert environment.step(action).failed
    assert do(environment, "EE") == [True] * 2
    assert not environment.step(PICKUP).failed
    second = environment.step(PICKUP)  # it holds one already
    assert second.failed
    assert environment.step(DROPOFF).failed  # not over the warehouse
    assert simulation.held == 0
    assert bits(environment) == "0000001"


def test_leaving_a_box_that_is_not_held_leaves_it_standing() -> None:
    environment, simulation = stand_ready(hall())
    before = simulation.referee.boxes[0].position
    assert do(environment, "EE") == [True] * 2
    assert do(environment, "E") == [True]
    assert bits(environment)[4] == "0"
    assert environment.cell == Cell(4, 2)
    assert math.dist(simulation.referee.boxes[0].position, before) < HOME
    assert do(environment, "W") == [True]
    assert bits(environment) == "0000100"
    assert simulation.referee.collisions == []


@pytest.mark.parametrize("held", [False, True], ids=["docked", "held"])
def test_a_full_fork_does_not_enter_another_boxs_cell(held: bool) -> None:
    environment, simulation = stand_ready(hall(beside="o"))
    assert do(environment, "EE") == [True] * 2
    if held:
        assert not environment.step(PICKUP).failed
    assert bits(environment) == ("0010001" if held else "0010100")
    boxes = [box.position for box in simulation.referee.boxes]
    assert do(environment, "E") == [False]
    assert environment.cell == Cell(3, 2)
    fork = simulation.referee.pose.inverse.transform(np.array([simulation.referee.boxes[0].position]))[0]
    assert np.hypot(*fork) < LATCH_REACH  # it can still be picked up
    assert math.dist(simulation.referee.boxes[1].position, boxes[1]) < 0.001
    assert simulation.referee.collisions == []


def test_boxes_that_are_found_later_join_the_state_under_new_names() -> None:
    environment, _ = stand_ready(hall())
    known = environment.standing[0].place
    further = Box(known.number + 1, 3.9, 1.5, 9, 9)
    environment.learn_of(environment.frame, environment.site, [known, further])
    state = environment.reset(np.random.default_rng(0))
    assert {box.name: (box.x, box.y) for box in state.of_class("Box")} == {"box1": (3, 2), "box2": (6, 2)}
    assert environment.remaining == 2
    environment.learn_of(environment.frame, environment.site, [known, further])
    assert environment.remaining == 2


def test_a_robot_steps_aside_from_a_box_that_it_does_not_hold() -> None:
    environment, simulation = stand_ready(hall())
    assert environment.step_aside()
    assert environment.cell == Cell(1, 2)
    before = simulation.referee.boxes[0].position
    assert do(environment, "EE") == [True] * 2
    assert environment.step_aside()
    assert environment.cell in {Cell(3, 3), Cell(3, 1)}
    assert math.dist(simulation.referee.boxes[0].position, before) < HOME
    assert environment.taken == ()
    assert simulation.referee.collisions == []


def test_a_pose_beyond_the_map_counts_as_the_nearest_cell() -> None:
    environment, _ = stand_ready(hall())
    pilot = environment.pilot
    pilot.tracker = PoseTracker(pilot.tracker.corrector, Pose(-5.0, 1.5))
    assert environment.cell == Cell(0, 2)


def test_a_wall_that_the_map_does_not_show_is_perceived() -> None:
    environment, _ = stand_ready(hall())
    known = environment.site.walls
    environment.site = type(environment.site)(
        frozenset(wall for wall in known if wall.cell != Cell(4, 3)),
        environment.site.warehouse,
        environment.site.x_range,
        environment.site.y_range,
    )
    assert all(do(environment, "NEEE"))
    assert bits(environment)[2] == "1"
    assert do(environment, "E") == [False]


def test_the_same_seed_gives_the_same_run() -> None:
    runs = []
    for _ in range(2):
        environment, simulation = stand_ready(hall(), 5)
        do(environment, "EEW")
        runs.append(simulation.referee.history)
    np.testing.assert_array_equal(*runs)
