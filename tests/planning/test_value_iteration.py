"""Values of worlds that can be worked out by hand; unknown steps; models that learn."""

from __future__ import annotations

import time

import numpy as np
import pytest

from wherry.domains.taxi import PROBES, taxi_grid
from wherry.learning.doormax import Doormax
from wherry.oomdp.conditional_models import PerStateModel
from wherry.planning.state_space import StateSpace
from wherry.planning.value_iteration import ValueIteration
from wherry_testing.small_worlds import LEFT, RIGHT, Tabular, at, grounded

CORRIDOR = {
    (0, "left"): ((1.0, 0, -1.0, False),),
    (0, "right"): ((1.0, 1, -1.0, False),),
    (1, "left"): ((1.0, 0, -1.0, False),),
    (1, "right"): ((1.0, 2, 10.0, True),),
}


def test_an_unknown_step_is_worth_r_max_for_ever() -> None:
    known = {key: value for key, value in CORRIDOR.items() if key != (0, "left")}
    optimist = ValueIteration(grounded(Tabular(known)), discount=0.5, r_max=100.0)
    assert optimist.policy(at(0)) == LEFT
    assert optimist.value(at(0)) == pytest.approx(200.0)
    assert optimist.value(at(1)) == pytest.approx(-1 + 0.5 * 200.0)
    pessimist = ValueIteration(grounded(Tabular(known)), discount=0.5, optimistic=False)
    assert pessimist.policy(at(0)) == RIGHT
    assert pessimist.value(at(0)) == pytest.approx(4.0)


def test_it_plans_again_when_the_model_has_learnt() -> None:
    environment = taxi_grid(5)
    learner = Doormax(environment.domain)
    planner = ValueIteration(learner)
    state = environment.state_of((2, 2), "Y", "R")
    seen = set()
    for _ in range(12):
        action = planner.policy(state)
        assert not learner.predict(state, action).most_likely.is_known or (state, action) in seen
        seen.add((state, action))
        done = environment.transition(state, action)
        if not done.failed:
            break
        learner.add_experience(done)
    assert planner.value(state) > 300  # much is still unknown nearby


def test_learners_can_share_a_space() -> None:
    environment = taxi_grid(5)
    space = StateSpace()
    probes = [environment.state_of(*probe) for probe in PROBES]
    model = PerStateModel(environment.domain, environment)
    alone = [ValueIteration(model, optimistic=False).value(probe) for probe in probes]
    for _ in range(2):
        planner = ValueIteration(model, optimistic=False, space=space)
        assert [planner.value(probe) for probe in probes] == alone
    assert len(space.states) == len({*space.states})


def test_conditions_are_worked_out_once_for_equal_states() -> None:
    environment, space = taxi_grid(5), StateSpace()
    learner = Doormax(environment.domain)
    first, again = (environment.state_of(*PROBES[0]) for _ in range(2))
    for state in (first, again):
        space.number(state, learner)
    assert environment.domain.conditions(again) is environment.domain.conditions(first)


def test_all_states_of_the_large_taxi_at_once() -> None:
    """12,800 states: values as found one by one, tables that grow with the states and not with their square, speed.

    The aim is 10 ms for a sweep to the end; the limit is ten times that, since machines are shared.
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
