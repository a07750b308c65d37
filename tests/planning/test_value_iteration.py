"""Values of worlds that can be worked out by hand; unknown steps; models that learn."""

from __future__ import annotations

import time

import numpy as np
import pytest

from planning.small_worlds import LEFT, RIGHT, Tabular, at, grounded
from wherry.domains.taxi import PROBES, taxi_grid
from wherry.learning.doormax import Doormax
from wherry.oomdp.outcomes import Grounded
from wherry.planning.state_space import StateSpace
from wherry.planning.value_iteration import ValueIteration

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
        assert not learner.predict(state, action).known or (state, action) in seen
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
    model = Grounded(environment.domain, environment)
    alone = [ValueIteration(model, optimistic=False).value(probe) for probe in probes]
    for _ in range(2):
        planner = ValueIteration(model, optimistic=False, space=space)
        assert [planner.value(probe) for probe in probes] == alone
    assert len(space.states) == len({*space.states})


def test_a_space_once_compiled_is_swept_at_once() -> None:
    """All 12,800 states of the 10×10 Taxi; the stated limit is generous, since machines are shared."""
    environment = taxi_grid(10)
    planner = ValueIteration(Grounded(environment.domain, environment), optimistic=False)
    marks = sorted(environment.plan.marks)
    pairs = [(one, other) for one in marks for other in marks if one != other][:8]
    starts = [environment.state_of((0, 0), *pair) for pair in pairs]
    for start in starts:
        planner.value(start)
    before = time.perf_counter()
    again = ValueIteration(planner.model, optimistic=False, space=planner.space)
    again.value(starts[0])
    first = time.perf_counter() - before
    assert np.isfinite(first)
    assert first < 1.0
