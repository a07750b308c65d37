"""The delivery heuristic is admissible: it never overestimates the number of steps to the end."""

from __future__ import annotations

import numpy as np
import pytest

from wherry.domains.delivery import DeliveryHeuristic, boxes_left, delivery_grid
from wherry.floorplan.generation import generate_world
from wherry_testing.brute_force import steps_to_every_state


@pytest.mark.parametrize("seed", range(3))
def test_heuristic_is_admissible_in_random_worlds(seed: int) -> None:
    environment = delivery_grid(generate_world(6, 5, np.random.default_rng(seed), min_room_size=2), 2)
    start = environment.reset(np.random.default_rng(seed))
    heuristic = DeliveryHeuristic()
    for state in list(steps_to_every_state(environment, start))[::40]:
        ends = [steps for after, steps in steps_to_every_state(environment, state).items() if not boxes_left(after)]
        assert heuristic(state) <= min(ends, default=float("inf"))


def test_heuristic_is_exact_for_one_box_on_open_floor() -> None:
    environment = delivery_grid(generate_world(5, 5, np.random.default_rng(1), min_room_size=5), 1)
    start = environment.reset(np.random.default_rng(0))
    shortest = min(steps for state, steps in steps_to_every_state(environment, start).items() if not boxes_left(state))
    assert DeliveryHeuristic()(start) == shortest
