"""Taxi is the published domain: walls, marks, lengths of optimal episodes, and the paper's example."""

from __future__ import annotations

import numpy as np
import pytest

from wherry.domains.taxi import PROBES, TaxiGrid, taxi_grid
from wherry.floorplan.plan import Cell, Wall
from wherry.oomdp.domain import Action
from wherry.oomdp.objects import State
from wherry_testing.brute_force import steps_to_every_state


def optimal_length(environment: TaxiGrid, start: State) -> int:
    """Smallest number of steps until the passenger is dropped off at the destination."""
    for state, steps in steps_to_every_state(environment, start).items():
        transitions = [environment.transition(state, action) for action in environment.domain.ground_actions(state)]
        if any(transition.terminated for transition in transitions):
            return steps + 1
    raise AssertionError


def test_walls_and_marks_are_the_published_ones() -> None:
    small, large = taxi_grid(5).plan, taxi_grid(10).plan
    assert not small.warehouse | large.warehouse
    assert small.marks == {"R": Cell(0, 4), "G": Cell(4, 4), "Y": Cell(0, 0), "B": Cell(3, 0)}
    assert small.walls == {Wall(Cell(x, y), False) for x, y in [(0, 0), (0, 1), (1, 3), (1, 4), (2, 0), (2, 1)]}
    cells = {"Y": (0, 1), "R": (0, 9), "G": (5, 9), "B": (4, 0), "W": (3, 6), "M": (6, 5), "C": (8, 9), "P": (9, 0)}
    assert large.marks == {mark: Cell(*cell) for mark, cell in cells.items()}
    spans = [(0, 0, 3), (2, 6, 9), (3, 0, 3), (5, 4, 7), (7, 0, 3), (7, 6, 9)]
    assert large.walls == {Wall(Cell(x, y), False) for x, low, high in spans for y in range(low, high + 1)}


@pytest.mark.parametrize(("size", "lengths"), [(5, [10, 14, 13, 13, 10, 13]), (10, [17, 22, 20, 24, 13, 21])])
def test_optimal_lengths_are_the_published_ones(size: int, lengths: list[int]) -> None:
    environment = taxi_grid(size)
    assert [optimal_length(environment, environment.state_of(*probe)) for probe in PROBES] == lengths


def test_small_grid_has_800_states() -> None:
    environment = taxi_grid(5)
    marks = environment.plan.marks
    states = {
        state
        for passenger in marks
        for destination in marks
        for state in steps_to_every_state(environment, environment.state_of((0, 0), passenger, destination))
    }
    assert len(states) == 800


def test_condition_of_the_papers_example_is_1001001() -> None:
    environment = taxi_grid(5)
    state = environment.state_of((2, 4), "R", "B").replace("passenger", in_taxi=True)
    assert str(environment.domain.cond(state)) == "1001001"


def test_rewards_of_moves_pickup_and_dropoff() -> None:
    environment = taxi_grid(5)
    state = environment.state_of((0, 4), "R", "Y")
    north, dropoff, pickup = (environment.transition(state, Action(name)) for name in ("N", "DROPOFF", "PICKUP"))
    assert (north.next_state, north.reward) == (state, -1.0)
    assert (dropoff.next_state, dropoff.reward) == (state, -10.0)
    assert pickup.next_state["passenger"].in_taxi
    assert pickup.reward == -1.0
    arrived = pickup.next_state.replace("taxi", x=0, y=0)
    delivery = environment.transition(arrived, Action("DROPOFF"))
    assert (delivery.reward, delivery.terminated, delivery.next_state["passenger"].in_taxi) == (20.0, True, False)


def test_initial_states_are_random_and_determined_by_the_seed() -> None:
    environment = taxi_grid(5)
    starts = [environment.reset(np.random.default_rng(seed)) for seed in range(200)]
    assert starts[7] == environment.reset(np.random.default_rng(7))
    assert len({(state["taxi"].x, state["taxi"].y) for state in starts}) == 25
    assert all(
        (state["passenger"].x, state["passenger"].y) != (state["destination"].x, state["destination"].y)
        for state in starts
    )
