"""Delivery on the grid: the paper's terms, and the dynamics of robots and boxes that have a size."""

from __future__ import annotations

import numpy as np
import pytest

from wherry.domains.delivery import BoxState, DeliverySite, all_delivered, delivery_grid, delivery_transition
from wherry.errors import InputError
from wherry.floorplan.plan import Cell, FloorPlan, Wall
from wherry.floorplan.world_files import find_world
from wherry.oomdp.domain import Action
from wherry.oomdp.objects import State

N, S, E, W, PICKUP, DROPOFF = (Action(name) for name in ("N", "S", "E", "W", "PICKUP", "DROPOFF"))
PLAN = FloorPlan(
    "plan",
    4,
    3,
    walls=frozenset({Wall(Cell(0, 0), north=False), Wall(Cell(1, 1), north=True)}),
    obstacles=frozenset({Cell(3, 2)}),
    warehouse=frozenset({Cell(0, 2), Cell(1, 2)}),
    start=Cell(0, 0),
)
SITE = DeliverySite.of_plan(PLAN)


def bits(state: State, this: str | None = None) -> str:
    return str(SITE.domain.cond(state, None if this is None else state[this]))


def after(state: State, *actions: Action) -> State:
    for action in actions:
        state = delivery_transition(state, action).next_state
    return state


def test_terms_are_in_the_papers_order() -> None:
    assert SITE.domain.term_names == (
        "touch_N(robot, wall)",
        "touch_S(robot, wall)",
        "touch_E(robot, wall)",
        "touch_W(robot, wall)",
        "on(robot, box)",
        "on(robot, warehouse)",
        "box.in_bot",
    )


def test_touch_holds_at_walls_edges_and_obstacles() -> None:
    expected = {(0, 0): "0111", (1, 0): "0101", (1, 1): "1000", (3, 1): "1010", (2, 2): "1010", (0, 2): "1001"}
    for (x, y), touching in expected.items():
        assert bits(SITE.state(Cell(x, y), []))[:4] == touching, (x, y)


def test_walls_block_moves() -> None:
    state = SITE.state(Cell(0, 0), [BoxState("b", Cell(3, 0))])
    for action in (S, E, W):
        blocked = delivery_transition(state, action)
        assert blocked.next_state == state
        assert (blocked.reward, blocked.terminated) == (-1.0, False)
    moved = delivery_transition(state, N)
    assert (moved.next_state["robot"].x, moved.next_state["robot"].y) == (0, 1)
    assert moved.reward == -1.0


def test_delivery_from_pickup_to_dropoff() -> None:
    state = SITE.state(Cell(2, 0), [BoxState("b", Cell(2, 0))])
    assert bits(state) == "0100100"
    assert delivery_transition(state, DROPOFF).reward == -10.0
    pickup = delivery_transition(state, PICKUP)
    assert pickup.reward == -1.0
    assert pickup.next_state["b"].in_bot
    assert bits(pickup.next_state) == "0100001"  # in_bot, and no longer on(robot, box)
    assert delivery_transition(pickup.next_state, PICKUP).reward == -10.0
    state = after(pickup.next_state, W, N)
    assert (state["b"].x, state["b"].y) == (2, 0)  # a carried box keeps the cell where it was picked up
    assert delivery_transition(state, DROPOFF).next_state == state  # DROPOFF fails outside the warehouse
    state = after(state, W, N)
    assert bits(state) == "1001011"
    dropoff = delivery_transition(state, DROPOFF)
    assert dropoff.next_state == state.without("b")
    assert (dropoff.reward, dropoff.terminated) == (20.0, True)
    assert all_delivered(dropoff.next_state)


def test_delivering_one_of_two_boxes_does_not_end_the_episode() -> None:
    state = SITE.state(Cell(0, 2), [BoxState("a", Cell(2, 0), in_bot=True), BoxState("b", Cell(3, 0))])
    dropoff = delivery_transition(state, DROPOFF)
    assert [box.name for box in dropoff.next_state.of_class("Box")] == ["b"]
    assert not dropoff.terminated


def test_robot_with_a_full_fork_cannot_enter_a_boxs_cell() -> None:
    boxes = [BoxState("a", Cell(1, 0)), BoxState("b", Cell(2, 0))]
    beside = SITE.state(Cell(1, 0), boxes)
    assert bits(beside)[2] == "1"  # on box a, so that box b blocks like a wall
    assert delivery_transition(beside, E).next_state == beside
    carrying = after(beside, PICKUP)
    assert bits(carrying)[2] == "1"
    assert after(carrying, E) == carrying
    empty = SITE.state(Cell(1, 1), [BoxState("b", Cell(2, 1))])
    assert bits(empty)[2] == "0"
    assert after(empty, E)["robot"].x == 2
    back = after(carrying, N, S)  # the cell where the carried box was picked up is free
    assert (back["robot"].x, back["robot"].y) == (1, 0)


def test_box_terms_are_deictic() -> None:
    state = SITE.state(Cell(1, 0), [BoxState("a", Cell(1, 0)), BoxState("b", Cell(3, 0), in_bot=False)])
    assert bits(state)[4] == "1"
    assert bits(state, "a")[4] == "1"
    assert bits(state, "b")[4] == "0"
    carrying = after(state, PICKUP)
    assert [bits(carrying, name)[6] for name in ("a", "b", "robot")] == ["1", "0", "1"]


def test_site_can_have_negative_coordinates() -> None:
    site = DeliverySite.of_cells([Cell(-3, -2), Cell(-2, -2)], [], [Cell(-2, -2)])
    state = site.state(Cell(-3, -2), [BoxState("b", Cell(-3, -2))])
    assert str(site.domain.cond(state)) == "1101100"
    assert after(state, PICKUP, E, DROPOFF) == site.state(Cell(-2, -2), [])
    with pytest.raises(ValueError, match="x cannot be 0"):
        site.state(Cell(0, 0), [])


def test_initial_states_have_random_boxes_determined_by_the_seed() -> None:
    environment = delivery_grid(find_world("rooms"))
    initial = environment.reset(np.random.default_rng(3))
    assert initial == environment.reset(np.random.default_rng(3))
    assert len({environment.reset(np.random.default_rng(seed)) for seed in range(5)}) == 5
    assert len(initial.of_class("Box")) == 4
    assert environment.step(E).next_state["robot"].x == initial["robot"].x + 1


def test_plan_without_warehouse_or_robot_is_refused() -> None:
    with pytest.raises(InputError, match="no warehouse"):
        delivery_grid(FloorPlan("bare", 2, 2, start=Cell(0, 0)))
    with pytest.raises(InputError, match="no robot"):
        delivery_grid(FloorPlan("bare", 2, 2, warehouse=frozenset({Cell(0, 0)})))


def test_unknown_action_is_refused() -> None:
    with pytest.raises(ValueError, match="no action JUMP"):
        delivery_transition(SITE.state(Cell(0, 0), []), Action("JUMP"))
