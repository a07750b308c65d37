"""Planners on Taxi: the published optimal lengths, agreement among planners, and planning while a model is learnt."""

from __future__ import annotations

import time
from collections import deque

import numpy as np
import pytest

from wherry.domains.taxi import PROBES, TaxiGrid, taxi_grid
from wherry.learning.doormax import Doormax
from wherry.oomdp.conditional_models import PerStateModel
from wherry.oomdp.objects import State
from wherry.planning.lrtdp import Lrtdp
from wherry.planning.planner import Planner
from wherry.planning.policy_iteration import PolicyIteration
from wherry.planning.registry import PLANNERS
from wherry.planning.state_space import StateSpace
from wherry.planning.uct import Uct
from wherry.planning.value_iteration import ValueIteration


def steps_to_the_end(environment: TaxiGrid, planner: Planner, state: State) -> int:
    for steps in range(1, 60):
        result = environment.transition(state, planner.policy(state))
        if result.terminated:
            return steps
        state = result.next_state
    raise AssertionError


@pytest.mark.parametrize("name", ["value-iteration", "policy-iteration", "lrtdp"])
def test_policies_have_the_published_optimal_lengths(name: str) -> None:
    environment = taxi_grid(5)
    planner = PLANNERS[name].make(PerStateModel(environment.domain, environment), np.random.default_rng(0))
    lengths = [steps_to_the_end(environment, planner, environment.state_of(*probe)) for probe in PROBES]
    assert lengths == [10, 14, 13, 13, 10, 13]


def test_policy_iteration_and_lrtdp_agree_with_value_iteration() -> None:
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
            result = environment.transition(state, action)
            if not result.terminated and result.next_state not in seen:
                seen.add(result.next_state)
                queue.append(result.next_state)
    assert len(seen) == 50


def test_lrtdp_with_a_tight_bound_expands_few_states() -> None:
    """One episode of 10×10 Taxi has 200 states."""
    environment = taxi_grid(10)
    model = PerStateModel(environment.domain, environment)
    state = environment.state_of(*PROBES[0])
    guide = ValueIteration(model)
    planner = Lrtdp(model, np.random.default_rng(0), upper_bound=lambda state: guide.value(state) + 1e-9)
    assert steps_to_the_end(environment, planner, state) == 17
    assert planner.expanded_count < 60


def test_uct_solves_a_short_episode_alone_and_a_long_one_with_an_evaluation() -> None:
    environment = taxi_grid(5)
    model = PerStateModel(environment.domain, environment)
    near = environment.state_of((0, 2), "R", "Y").replace("passenger", in_taxi=True)
    assert steps_to_the_end(environment, Uct(model, np.random.default_rng(0)), near) == 3
    guide = ValueIteration(model)
    guided = Uct(model, np.random.default_rng(0), simulations=100, evaluation=guide.value)
    assert steps_to_the_end(environment, guided, environment.state_of(*PROBES[0])) == 10


@pytest.mark.parametrize("name", ["policy-iteration", "lrtdp"])
def test_planners_agree_on_every_model_while_it_is_learnt(name: str) -> None:
    environment, rng = taxi_grid(5), np.random.default_rng(1)
    learner = Doormax(environment.domain)
    planner = PLANNERS[name].make(learner, np.random.default_rng(0))
    swept = ValueIteration(learner)
    state = environment.reset(rng)
    for number in range(200):
        if number % 25 == 0:
            assert planner.value(state) == pytest.approx(swept.value(state), abs=1e-3)
        actions = environment.domain.ground_actions(state)
        result = environment.step(actions[rng.integers(len(actions))])
        learner.add_experience(result)
        state = environment.reset(rng) if result.terminated else result.next_state


def test_value_iteration_plans_again_after_a_revision() -> None:
    environment = taxi_grid(5)
    learner = Doormax(environment.domain)
    planner = ValueIteration(learner)
    state = environment.state_of((2, 2), "Y", "R")
    for _ in environment.domain.actions:
        action = planner.policy(state)
        if learner.predict(state, action).most_likely.is_known:
            break
        result = environment.transition(state, action)
        learner.add_experience(result)
        assert planner.policy(state) != action or not result.failed  # a failed action is not tried again here
        if not result.failed:
            break
    assert learner.revisions != dict.fromkeys(environment.domain.actions, 0)
    assert planner.value(state) > 300  # since most outcomes are still unknown


def test_planners_can_share_a_state_space() -> None:
    environment = taxi_grid(5)
    space = StateSpace()
    probes = [environment.state_of(*probe) for probe in PROBES]
    model = PerStateModel(environment.domain, environment)
    alone = [ValueIteration(model, optimistic=False).value(probe) for probe in probes]
    for _ in range(2):
        planner = ValueIteration(model, optimistic=False, space=space)
        assert [planner.value(probe) for probe in probes] == alone
    assert len(space.states) == len({*space.states})


def test_equal_states_share_their_conditions() -> None:
    environment, space = taxi_grid(5), StateSpace()
    learner = Doormax(environment.domain)
    first, again = (environment.state_of(*PROBES[0]) for _ in range(2))
    for state in (first, again):
        space.number(state, learner)
    assert environment.domain.conditions(again) is environment.domain.conditions(first)


def test_all_states_of_the_large_taxi_at_once() -> None:
    """12,800 states: values equal to those of single states, one table row per action, and fast sweeps.

    Sweeping until convergence should take 10 ms; the limit is ten times that, since machines are shared.
    """
    environment = taxi_grid(10)
    model = PerStateModel(environment.domain, environment)
    planner = ValueIteration(model, optimistic=False)
    marks = sorted(environment.plan.marks)
    starts = [environment.state_of((0, 0), one, other) for one in marks for other in marks]
    values = planner.values(starts)
    assert values[1] == pytest.approx(ValueIteration(model, optimistic=False).value(starts[1]), abs=1e-5)
    assert planner.space.successor.shape[0] <= 8  # a row for each action
    seconds = []
    for _ in range(5):
        before = time.perf_counter()
        assert planner.sweep() == 12_800
        seconds.append(time.perf_counter() - before)
    assert planner.values(starts) == pytest.approx(values)
    assert np.median(seconds) < 0.1
