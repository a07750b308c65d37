"""All registered planners against values computed without them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from wherry.oomdp.mdp import IMPOSSIBLE, UNKNOWN, Prediction
from wherry.oomdp.objects import State
from wherry.planning.lookahead import Lookahead
from wherry.planning.planner import Planner
from wherry.planning.registry import PLANNERS
from wherry.planning.uct import Uct
from wherry_testing.small_worlds import (
    CORRIDOR,
    LEFT,
    RIGHT,
    TableModel,
    optimal_values,
    per_state,
    random_world,
    state_at,
)

EXACT = ("value-iteration", "policy-iteration", "lrtdp")
SLIPPERY = {  # half of all steps to the right slip: V(1) = ½·10 + ½(−1 + ½ V(1))
    (1, "left"): ((1.0, 1, -1.0, False),),
    (1, "right"): ((0.5, 2, 10.0, True), (0.5, 1, -1.0, False)),
}


def make(name: str, model: TableModel, **settings: float) -> Planner:
    return PLANNERS[name].make(per_state(model), np.random.default_rng(0), **settings)


@pytest.mark.parametrize("name", PLANNERS)
def test_documentation_lists_every_planner_as_the_registry_describes_it(name: str) -> None:
    page = (Path(__file__).parents[2] / "docs/planners.md").read_text("utf-8")
    entry = PLANNERS[name]
    (row,) = [line for line in page.splitlines() if line.startswith(f"| `{name}` |")]
    assert row.endswith(f"| {entry.summary} | {entry.suited_for} |")


@pytest.mark.parametrize("name", PLANNERS)
def test_policy_and_values_in_a_corridor(name: str) -> None:
    planner = make(name, TableModel(CORRIDOR), discount=0.5, r_max=10.0)
    assert planner.policy(state_at(0)) == planner.policy(state_at(1)) == RIGHT
    assert planner.value(state_at(1)) == pytest.approx(10.0)
    tolerance = 1e-5 if name in EXACT else 0.1  # UCT's mean includes its first, random simulations
    assert planner.value(state_at(0)) == pytest.approx(-1 + 0.5 * 10, abs=tolerance)


@pytest.mark.parametrize("name", EXACT)
def test_value_of_a_step_that_may_slip(name: str) -> None:
    planner = make(name, TableModel(SLIPPERY), discount=0.5, r_max=10.0)
    assert planner.policy(state_at(1)) == RIGHT
    assert planner.value(state_at(1)) == pytest.approx((0.5 * 10 - 0.5) / 0.75, abs=1e-5)


def test_uct_approximates_the_value_of_a_step_that_may_slip() -> None:
    planner = Uct(per_state(TableModel(SLIPPERY)), np.random.default_rng(3), discount=0.5, r_max=10.0, simulations=4000)
    assert planner.policy(state_at(1)) == RIGHT
    assert planner.value(state_at(1)) == pytest.approx(6.0, abs=0.4)


@pytest.mark.parametrize("name", PLANNERS)
def test_unknown_outcome_is_worth_r_max_in_every_step(name: str) -> None:
    known = {key: value for key, value in CORRIDOR.items() if key != (0, "left")}
    planner = make(name, TableModel(known), discount=0.5, r_max=10.0)
    assert planner.policy(state_at(0)) == LEFT
    assert planner.value(state_at(0)) == pytest.approx(20.0, abs=1e-5 if name in EXACT else 0.5)


@pytest.mark.parametrize("name", PLANNERS)
def test_impossible_action_is_not_tried(name: str) -> None:
    class LeftIsImpossible(TableModel):
        def predict(self, state: State, action: object) -> Prediction:
            return IMPOSSIBLE if action == LEFT else super().predict(state, RIGHT)

    planner = make(name, LeftIsImpossible(CORRIDOR), discount=0.5, r_max=10.0)
    assert planner.policy(state_at(0)) == RIGHT


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("name", EXACT)
def test_values_in_random_worlds_with_three_outcomes(name: str, seed: int) -> None:
    outcomes = random_world(12, np.random.default_rng(seed))
    values = optimal_values(outcomes, 12, discount=0.9)
    planner = make(name, TableModel(outcomes), discount=0.9, r_max=1.0)
    assert [planner.value(state_at(number)) for number in range(12)] == pytest.approx(values, abs=1e-4)


def test_uct_finds_the_better_action_in_most_random_worlds() -> None:
    agreements = 0
    for seed in range(10):
        model = TableModel(random_world(12, np.random.default_rng(seed)))
        best = make("policy-iteration", model, discount=0.9, r_max=1.0)
        uct = Uct(per_state(model), np.random.default_rng(seed), discount=0.9, r_max=1.0, simulations=1500)
        agreements += uct.policy(state_at(0)) == best.policy(state_at(0))
    assert agreements >= 8  # in the other worlds the Q values of both actions are nearly equal


@pytest.mark.parametrize("name", ["lrtdp", "uct"])
def test_same_seed_gives_the_same_values(name: str) -> None:
    outcomes = random_world(12, np.random.default_rng(7))
    first, second = (make(name, TableModel(outcomes), discount=0.9, r_max=1.0) for _ in range(2))
    states = [state_at(number) for number in range(12)]
    assert [first.value(state) for state in states] == [second.value(state) for state in states]


def test_grounding_keeps_every_outcome_with_its_probability() -> None:
    conditional = per_state(TableModel(SLIPPERY)).conditional_prediction(state_at(1), RIGHT)
    assert [probability for _, probability in conditional.outcomes] == [0.5, 0.5]
    prediction = conditional.ground(state_at(1), RIGHT)
    found = [(outcome.next_state, outcome.probability) for outcome in prediction.outcomes]
    assert found == [(state_at(2), 0.5), (state_at(1), 0.5)]


def test_grounding_keeps_an_unknown_outcome() -> None:
    assert per_state(TableModel({})).conditional_prediction(state_at(1), RIGHT).ground(state_at(1), RIGHT) == UNKNOWN


@pytest.mark.parametrize("discount", [-0.1, 1.0, math.nan])
def test_discount_outside_0_to_1_is_refused(discount: float) -> None:
    with pytest.raises(ValueError, match="discount"):
        Lookahead(per_state(TableModel(CORRIDOR)), discount=discount, r_max=1.0)
