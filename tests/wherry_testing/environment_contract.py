"""What every `Environment` keeps to; a test file for one subclasses this and gives the fixture ``environment``.

The fixture's environment can do every action of its domain at least once, and an action now and then changes something.
"""

from __future__ import annotations

import math
from itertools import islice

import numpy as np
import pytest

from wherry.oomdp.domain import Action
from wherry.oomdp.mdp import Environment, Transition
from wherry.oomdp.objects import State


def every_action(environment: Environment) -> list[Action]:
    """All the domain's actions, those without parameters."""
    return [Action(name) for name, parameters in environment.domain.actions.items() if not parameters]


def tour(environment: Environment) -> tuple[State, list[Transition]]:
    """Begin an episode and do every action in turn, twice, unless it ends."""
    first = environment.reset(np.random.default_rng(0))
    done: list[Transition] = []
    for action in every_action(environment) * 2:
        done.append(environment.step(action))
        if done[-1].terminated:
            break
    return first, done


class EnvironmentContract:
    """The checks."""

    def test_it_begins_in_a_state_of_its_domain(self, environment: Environment) -> None:
        state = environment.reset(np.random.default_rng(0))
        known = {item.name for item in environment.domain.classes}
        assert {item.object_class.name for item in (*state.objects, *state.scene.objects)} <= known
        assert environment.domain.cond(state).size == len(environment.domain.term_names)

    def test_an_experience_begins_where_the_last_one_ended(self, environment: Environment) -> None:
        first, done = tour(environment)
        assert done[0].state.objects == first.objects
        for earlier, later in zip(done, islice(done, 1, None), strict=False):
            assert later.state.objects == earlier.next_state.objects

    def test_an_experience_says_what_was_done(self, environment: Environment) -> None:
        _, done = tour(environment)
        assert [transition.action for transition in done] == (every_action(environment) * 2)[: len(done)]
        assert all(math.isfinite(transition.reward) for transition in done)
        assert all(transition.terminated in (True, False) for transition in done)

    def test_something_moves_and_something_fails(self, environment: Environment) -> None:
        _, done = tour(environment)
        assert {transition.failed for transition in done} == {True, False}

    def test_what_does_not_change_stays(self, environment: Environment) -> None:
        first, done = tour(environment)
        names = {item.name for item in first.objects}
        for transition in done:
            assert {item.name for item in transition.next_state.objects} <= names

    def test_an_action_that_there_is_not_is_refused(self, environment: Environment) -> None:
        environment.reset(np.random.default_rng(0))
        with pytest.raises(ValueError, match="JUMP"):
            environment.step(Action("JUMP"))
