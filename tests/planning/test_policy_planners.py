"""Policy iteration, LRTDP and UCT against values worked out without them, and against value iteration on Taxi."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
import pytest

from wherry.domains.taxi import PROBES, TaxiGrid, taxi_grid
from wherry.learning.doormax import Doormax
from wherry.oomdp.conditional_models import PerStateModel
from wherry.oomdp.mdp import IMPOSSIBLE, UNKNOWN, Prediction
from wherry.oomdp.objects import State
from wherry.planning.lookahead import Lookahead
from wherry.planning.lrtdp import Lrtdp
from wherry.planning.planners import PLANNERS
from wherry.planning.policy import Planner
from wherry.planning.policy_iteration import PolicyIteration
from wherry.planning.uct import Uct
from wherry.planning.value_iteration import ValueIteration
from wherry_testing.small_worlds import LEFT, RIGHT, Tabular, at, grounded, optimal_values, random_world

EXACT = ("value-iteration", "policy-iteration", "lrtdp")
CORRIDOR = {
    (0, "left"): ((1.0, 0, -1.0, False),),
    (0, "right"): ((1.0, 1, -1.0, False),),
    (1, "left"): ((1.0, 0, -1.0, False),),
    (1, "right"): ((1.0, 2, 10.0, True),),
}
SLIPPERY = {  # half of all steps to the right slip: V(1) = ½·10 + ½(−1 + ½ V(1))
    (1, "left"): ((1.0, 1, -1.0, False),),
    (1, "right"): ((0.5, 2, 10.0, True), (0.5, 1, -1.0, False)),
}


def make(name: str, model: Tabular, **settings: float) -> Planner:
    return PLANNERS[name].make(grounded(model), np.random.default_rng(0), **settings)


def steps_to_the_end(environment: TaxiGrid, planner: Planner, state: State) -> int:
    for steps in range(1, 60):
        done = environment.transition(state, planner.policy(state))
        if done.terminated:
            return steps
        state = done.next_state
    raise AssertionError


@pytest.mark.parametrize("name", PLANNERS)
def test_a_corridor(name: str) -> None:
    planner = make(name, Tabular(CORRIDOR), discount=0.5, r_max=10.0)
    assert planner.policy(at(0)) == planner.policy(at(1)) == RIGHT
    assert planner.value(at(1)) == pytest.approx(10.0)
    exact = name != "uct"  # which averages over what it tried first, too
    assert planner.value(at(0)) == pytest.approx(-1 + 0.5 * 10, abs=1e-5 if exact else 0.1)


@pytest.mark.parametrize("name", EXACT)
def test_a_step_that_may_slip(name: str) -> None:
    planner = make(name, Tabular(SLIPPERY), discount=0.5, r_max=10.0)
    assert planner.policy(at(1)) == RIGHT
    assert planner.value(at(1)) == pytest.approx((0.5 * 10 - 0.5) / 0.75, abs=1e-5)


def test_uct_is_near_on_a_step_that_may_slip() -> None:
    planner = Uct(grounded(Tabular(SLIPPERY)), np.random.default_rng(3), discount=0.5, r_max=10.0, simulations=4000)
    assert planner.policy(at(1)) == RIGHT
    assert planner.value(at(1)) == pytest.approx(6.0, abs=0.4)


@pytest.mark.parametrize("name", PLANNERS)
def test_not_to_know_is_worth_r_max_for_ever(name: str) -> None:
    known = {key: value for key, value in CORRIDOR.items() if key != (0, "left")}
    planner = make(name, Tabular(known), discount=0.5, r_max=10.0)
    assert planner.policy(at(0)) == LEFT
    assert planner.value(at(0)) == pytest.approx(20.0, abs=1e-5 if name in EXACT else 0.5)


@pytest.mark.parametrize("name", PLANNERS)
def test_what_nothing_can_be_learnt_about_is_not_tried(name: str) -> None:
    class Hopeless(Tabular):
        def predict(self, state: State, action: object) -> Prediction:
            return IMPOSSIBLE if action == LEFT else super().predict(state, RIGHT)

    planner = make(name, Hopeless(CORRIDOR), discount=0.5, r_max=10.0)
    assert planner.policy(at(0)) == RIGHT


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("name", EXACT)
def test_three_outcomes_in_random_worlds(name: str, seed: int) -> None:
    outcomes = random_world(12, np.random.default_rng(seed))
    values = optimal_values(outcomes, 12, discount=0.9)
    planner = make(name, Tabular(outcomes), discount=0.9, r_max=1.0)
    assert [planner.value(at(number)) for number in range(12)] == pytest.approx(values, abs=1e-4)


def test_uct_finds_the_better_action_in_random_worlds() -> None:
    right = 0
    for seed in range(10):
        outcomes = random_world(12, np.random.default_rng(seed))
        best = make("policy-iteration", Tabular(outcomes), discount=0.9, r_max=1.0)
        uct = Uct(grounded(Tabular(outcomes)), np.random.default_rng(seed), discount=0.9, r_max=1.0, simulations=1500)
        right += uct.policy(at(0)) == best.policy(at(0))
    assert right >= 8  # in the others the actions are nearly equal


def test_policy_iteration_and_lrtdp_agree_with_value_iteration_on_taxi() -> None:
    environment = taxi_grid(5)
    model = PerStateModel(environment.domain, environment)
    swept, iterated = ValueIteration(model), PolicyIteration(model)
    trial_based = Lrtdp(model, np.random.default_rng(0), upper_bound=lambda state: 20.0)
    state = environment.state_of((2, 2), "Y", "R")
    seen, queue = {state}, deque([state])
    while queue:
        state = queue.popleft()
        assert iterated.value(state) == pytest.approx(swept.value(state), abs=1e-4)
        assert iterated.policy(state) == swept.policy(state)
        assert trial_based.value(state) == pytest.approx(swept.value(state), abs=1e-4)
        for action in environment.domain.ground_actions(state):
            done = environment.transition(state, action)
            if not done.terminated and done.next_state not in seen:
                seen.add(done.next_state)
                queue.append(done.next_state)
    assert len(seen) == 50


@pytest.mark.parametrize("name", EXACT)
def test_the_published_optimal_lengths(name: str) -> None:
    environment = taxi_grid(5)
    planner = PLANNERS[name].make(PerStateModel(environment.domain, environment), np.random.default_rng(0))
    lengths = [steps_to_the_end(environment, planner, environment.state_of(*probe)) for probe in PROBES]
    assert lengths == [10, 14, 13, 13, 10, 13]


def test_lrtdp_looks_only_where_a_good_policy_may_come_to() -> None:
    """With a bound that knows the way it hardly leaves the way: 10×10 Taxi has 200 states for one episode."""
    environment = taxi_grid(10)
    model = PerStateModel(environment.domain, environment)
    state = environment.state_of(*PROBES[0])
    guide = ValueIteration(model)
    planner = Lrtdp(model, np.random.default_rng(0), upper_bound=lambda state: guide.value(state) + 1e-9)
    assert steps_to_the_end(environment, planner, state) == 17
    assert planner.visited < 60


def test_uct_delivers_when_the_way_is_short_or_it_is_told_what_states_are_worth() -> None:
    environment = taxi_grid(5)
    model = PerStateModel(environment.domain, environment)
    near = environment.state_of((0, 2), "R", "Y")
    riding = near.replace("passenger", in_taxi=True)
    assert steps_to_the_end(environment, Uct(model, np.random.default_rng(0)), riding) == 3
    guide = ValueIteration(model)
    guided = Uct(model, np.random.default_rng(0), simulations=100, evaluation=guide.value)
    assert steps_to_the_end(environment, guided, environment.state_of(*PROBES[0])) == 10


@pytest.mark.parametrize("name", ["policy-iteration", "lrtdp"])
def test_plans_again_when_the_model_has_learnt(name: str) -> None:
    """On every half-learnt model along a random walk, what it says equals what value iteration says."""
    environment, rng = taxi_grid(5), np.random.default_rng(1)
    learner = Doormax(environment.domain)
    planner = PLANNERS[name].make(learner, np.random.default_rng(0))
    swept = ValueIteration(learner)
    state = environment.reset(rng)
    for number in range(200):
        if number % 25 == 0:
            assert planner.value(state) == pytest.approx(swept.value(state), abs=1e-3)
        actions = environment.domain.ground_actions(state)
        done = environment.step(actions[rng.integers(len(actions))])
        learner.add_experience(done)
        state = environment.reset(rng) if done.terminated else done.next_state


@pytest.mark.parametrize("name", ["lrtdp", "uct"])
def test_the_same_seed_gives_the_same_answer(name: str) -> None:
    outcomes = random_world(12, np.random.default_rng(7))
    first, second = (make(name, Tabular(outcomes), discount=0.9, r_max=1.0) for _ in range(2))
    assert [first.value(at(number)) for number in range(12)] == [second.value(at(number)) for number in range(12)]


def test_grounding_keeps_every_outcome_with_its_probability() -> None:
    conditional = grounded(Tabular(SLIPPERY)).conditional_prediction(at(1), RIGHT)
    assert [probability for _, probability in conditional.outcomes] == [0.5, 0.5]
    prediction = conditional.ground(at(1), RIGHT)
    assert [(outcome.next_state, outcome.probability) for outcome in prediction.outcomes] == [
        (at(2), 0.5),
        (at(1), 0.5),
    ]
    assert grounded(Tabular({})).conditional_prediction(at(1), RIGHT).ground(at(1), RIGHT) == UNKNOWN


@pytest.mark.parametrize("discount", [-0.1, 1.0, math.nan])
def test_a_discount_that_makes_no_sense_is_refused(discount: float) -> None:
    with pytest.raises(ValueError, match="discount"):
        Lookahead(grounded(Tabular(CORRIDOR)), discount=discount, r_max=1.0)
