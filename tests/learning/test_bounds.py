"""DOORMAX says "I don't know" no more often than the theorem allows."""

from __future__ import annotations

import numpy as np
import pytest

from wherry.domains.delivery import delivery_grid
from wherry.domains.taxi import taxi_grid
from wherry.floorplan.world_files import find_world
from wherry.learning.bounds import UnknownAnswers, attribute_bound, unknown_answers_bound
from wherry.learning.doormax import Doormax
from wherry.oomdp.mdp import DeterministicMdp, Transition
from wherry_testing.machine import PRESS, machine_domain, state_of


def test_the_formulas() -> None:
    assert unknown_answers_bound(7, 1) == 9
    assert unknown_answers_bound(7, 2) == 17
    assert attribute_bound(7, 1, 2) == 19


@pytest.mark.parametrize("environment", [taxi_grid(5), delivery_grid(find_world("small"))], ids=["taxi", "delivery"])
@pytest.mark.parametrize("options", [{}, {"failure_scope": "attribute"}, {"refutation": False}, {"max_effects": 3}])
def test_the_bound_holds(environment: DeterministicMdp, options: dict) -> None:
    learner = Doormax(environment.domain, **options)
    answers = UnknownAnswers(learner)
    rng = np.random.default_rng(1)
    state = environment.reset(rng)
    for _ in range(2500):
        actions = environment.domain.ground_actions(state)
        done = environment.step(actions[rng.integers(len(actions))])
        answers.observe(done)
        learner.add_experience(done)
        state = environment.reset(rng) if done.terminated else done.next_state
    assert 0 < answers.most <= answers.bound


def test_the_worst_case_is_counted() -> None:
    """One term less at every success: n merges after the first sight, each of them unknown."""
    size = 6
    learner = Doormax(machine_domain(size))
    answers = UnknownAnswers(learner)
    for flipped in range(size + 1):
        switches = "1" * flipped + "0" * (size - flipped)
        before = state_of(learner.domain, switches)
        done = Transition(before, PRESS, before.replace("machine", counter=1), 0.0, False)
        answers.observe(done)
        learner.add_experience(done)
    assert answers.most == size + 1
    assert answers.most <= unknown_answers_bound(size, 1)


def test_failures_do_not_count() -> None:
    learner = Doormax(machine_domain(3))
    answers = UnknownAnswers(learner)
    for bits in range(8):
        before = state_of(learner.domain, format(bits, "03b"))
        done = Transition(before, PRESS, before, 0.0, False)
        answers.observe(done)
        learner.add_experience(done)
    assert answers.most == 0
