"""The simulated robot as an `Environment`: condition bits at every stage of a delivery, and failed actions."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wherry.domains.delivery import DROPOFF, PICKUP
from wherry.floorplan.plan import Cell
from wherry.oomdp.domain import Action
from wherry.oomdp.mdp import Environment
from wherry.realization.box_tracks import BoxTrack
from wherry.realization.environment import RobotEnvironment
from wherry.realization.pose_tracker import PoseTracker
from wherry.simulation import BoxStatus, Simulation
from wherry.simulation.simulator import LATCH_REACH
from wherry.space.pose import Pose
from wherry_testing.deliveries import hall, stand_ready
from wherry_testing.environment_contract import EnvironmentContract
from wherry_testing.perfect_worlds import centre

N, S, E, W = (Action(name) for name in "NSEW")
MAX_OFFSET = 0.03  # m, largest distance from a cell's centre or from an earlier position


def bits(environment: RobotEnvironment) -> str:
    """Condition bits touch_N, touch_S, touch_E, touch_W, on(robot, box), on(robot, warehouse), box.in_bot."""
    return str(environment.domain.cond(environment.reset(np.random.default_rng(0))))


def execute(environment: RobotEnvironment, actions: str) -> list[bool]:
    """Execute moves; return which of them had an effect."""
    return [not environment.step(Action(name)).failed for name in actions]


def off_centre(simulation: Simulation, cell: Cell) -> float:
    """True distance of base_link from a cell's centre, m."""
    target, pose = centre(simulation.plan, cell), simulation.referee.pose
    return math.hypot(pose.x - target[0], pose.y - target[1])


class TestContract(EnvironmentContract):
    @pytest.fixture
    def environment(self) -> Environment:
        return stand_ready(hall())[0]


def test_condition_bits_of_a_whole_delivery() -> None:
    environment, simulation = stand_ready(hall())
    assert bits(environment) == "0000000"
    assert execute(environment, "W") == [True]
    assert bits(environment) == "0001000"
    assert execute(environment, "EEE") == [True] * 3
    assert bits(environment) == "0000100"  # docked: on(robot, box)
    assert environment.step(PICKUP).next_state["box1"].in_bot is True
    assert bits(environment) == "0000001"  # held: no longer on(robot, box)
    assert simulation.referee.boxes[0].status is BoxStatus.HELD
    assert execute(environment, "WWW") == [True] * 3
    assert bits(environment) == "0001001"
    assert execute(environment, "SS") == [True] * 2
    assert bits(environment) == "0101011"
    assert simulation.referee.visited_cells[-1] == Cell(0, 0)
    dropped = environment.step(DROPOFF)
    assert dropped.terminated
    assert dropped.next_state.of_class("Box") == ()
    assert bits(environment) == "0101010"
    assert (environment.delivered, environment.remaining) == (1, 0)
    assert simulation.referee.delivered == 1
    assert simulation.referee.collisions == []


@pytest.mark.parametrize(
    ("moves", "cell", "expected"),
    [
        ("N", Cell(1, 3), "1000000"),
        ("NW", Cell(0, 3), "1001000"),
        ("NEEE", Cell(4, 3), "1010000"),  # next to an inner wall
        ("SS", Cell(1, 0), "0100010"),
        ("SEEEEEEN", Cell(7, 2), "1010000"),  # under an obstacle
    ],
)
def test_touch_holds_beside_walls_and_obstacles(moves: str, cell: Cell, expected: str) -> None:
    environment, simulation = stand_ready(hall())
    assert all(execute(environment, moves))
    assert environment.cell == cell
    assert bits(environment) == expected
    assert off_centre(simulation, cell) < 0.04


@pytest.mark.parametrize(
    ("moves", "blocked", "cell"), [("N", "N", Cell(1, 3)), ("W", "W", Cell(0, 2)), ("NEEE", "E", Cell(4, 3))]
)
def test_a_blocked_move_ends_in_the_centre_of_its_cell_without_collision(moves: str, blocked: str, cell: Cell) -> None:
    for seed in range(3):
        environment, simulation = stand_ready(hall(), seed)
        assert all(execute(environment, moves))
        assert execute(environment, blocked * 2) == [False, False]
        assert environment.cell == cell
        assert off_centre(simulation, cell) < MAX_OFFSET
        assert simulation.referee.collisions == []


def test_pickup_and_dropoff_fail_where_they_are_not_possible() -> None:
    environment, simulation = stand_ready(hall())
    for action in (PICKUP, DROPOFF):
        assert environment.step(action).failed
    assert execute(environment, "EE") == [True] * 2
    assert not environment.step(PICKUP).failed
    second = environment.step(PICKUP)  # it holds one already
    assert second.failed
    assert environment.step(DROPOFF).failed  # not over the warehouse
    assert simulation.held == 0
    assert bits(environment) == "0000001"


def test_an_unheld_box_stays_where_it_is() -> None:
    environment, simulation = stand_ready(hall())
    before = simulation.referee.boxes[0].position
    assert execute(environment, "EE") == [True] * 2
    assert execute(environment, "E") == [True]
    assert bits(environment)[4] == "0"
    assert environment.cell == Cell(4, 2)
    assert math.dist(simulation.referee.boxes[0].position, before) < MAX_OFFSET
    assert execute(environment, "W") == [True]
    assert bits(environment) == "0000100"
    assert simulation.referee.collisions == []


@pytest.mark.parametrize("held", [False, True], ids=["docked", "held"])
def test_a_full_fork_does_not_enter_another_boxs_cell(held: bool) -> None:
    environment, simulation = stand_ready(hall(beside="o"))
    assert execute(environment, "EE") == [True] * 2
    if held:
        assert not environment.step(PICKUP).failed
    assert bits(environment) == ("0010001" if held else "0010100")
    boxes = [box.position for box in simulation.referee.boxes]
    assert execute(environment, "E") == [False]
    assert environment.cell == Cell(3, 2)
    fork = simulation.referee.pose.inverse.transform(np.array([simulation.referee.boxes[0].position]))[0]
    assert np.hypot(*fork) < LATCH_REACH  # it can still be picked up
    assert math.dist(simulation.referee.boxes[1].position, boxes[1]) < 0.001
    assert simulation.referee.collisions == []


def test_boxes_found_later_are_added_to_the_state_under_new_names() -> None:
    environment, _ = stand_ready(hall())
    known = environment.boxes_on_floor[0].track
    new_track = BoxTrack(known.track_id + 1, 3.9, 1.5, 9, 9)
    environment.update_map(environment.frame, environment.site, [known, new_track])
    state = environment.reset(np.random.default_rng(0))
    assert {box.name: (box.x, box.y) for box in state.of_class("Box")} == {"box1": (3, 2), "box2": (6, 2)}
    assert environment.remaining == 2
    environment.update_map(environment.frame, environment.site, [known, new_track])
    assert environment.remaining == 2


def test_a_robot_leaves_the_cell_of_an_unheld_box() -> None:
    environment, simulation = stand_ready(hall())
    assert environment.leave_unheld_box()
    assert environment.cell == Cell(1, 2)
    before = simulation.referee.boxes[0].position
    assert execute(environment, "EE") == [True] * 2
    assert environment.leave_unheld_box()
    assert environment.cell in {Cell(3, 3), Cell(3, 1)}
    assert math.dist(simulation.referee.boxes[0].position, before) < MAX_OFFSET
    assert environment.picked_up == ()
    assert simulation.referee.collisions == []


def test_a_pose_outside_the_map_is_clipped_to_the_nearest_cell() -> None:
    environment, _ = stand_ready(hall())
    pilot = environment.pilot
    pilot.tracker = PoseTracker(pilot.tracker.estimator, Pose(-5.0, 1.5))
    assert environment.cell == Cell(0, 2)


def test_a_wall_missing_on_the_map_is_perceived_in_a_scan() -> None:
    environment, _ = stand_ready(hall())
    known = environment.site.walls
    environment.site = type(environment.site)(
        frozenset(wall for wall in known if wall.cell != Cell(4, 3)),
        environment.site.warehouse,
        environment.site.x_range,
        environment.site.y_range,
    )
    assert all(execute(environment, "NEEE"))
    assert bits(environment)[2] == "1"
    assert execute(environment, "E") == [False]


def test_the_same_seed_gives_the_same_run() -> None:
    runs = []
    for _ in range(2):
        environment, simulation = stand_ready(hall(), 5)
        execute(environment, "EEW")
        runs.append(simulation.referee.trajectory)
    np.testing.assert_array_equal(*runs)
