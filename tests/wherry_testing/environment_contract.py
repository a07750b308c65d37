"""The contract of every `Environment`.

The tests of an environment subclass `EnvironmentContract` and define a fixture ``environment``, in which at least one
action of a tour has an effect and at least one fails.
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
    """The domain's actions without parameters."""
    return [Action(name) for name, parameters in environment.domain.actions.items() if not parameters]


def tour(environment: Environment) -> tuple[State, list[Transition]]:
    """Begin an episode and carry out every action twice, in turn, unless the episode ends."""
    first = environment.reset(np.random.default_rng(0))
    experiences: list[Transition] = []
    for action in every_action(environment) * 2:
        experiences.append(environment.step(action))
        if experiences[-1].terminated:
            break
    return first, experiences


class EnvironmentContract:
    """The tests that every environment has to pass."""

    def test_initial_state_belongs_to_the_domain(self, environment: Environment) -> None:
        state = environment.reset(np.random.default_rng(0))
        known = {item.name for item in environment.domain.classes}
        assert {item.object_class.name for item in (*state.objects, *state.scene.objects)} <= known
        assert environment.domain.cond(state).size == len(environment.domain.term_names)

    def test_experience_begins_in_the_last_next_state(self, environment: Environment) -> None:
        first, experiences = tour(environment)
        assert experiences[0].state.objects == first.objects
        for earlier, later in zip(experiences, islice(experiences, 1, None), strict=False):
            assert later.state.objects == earlier.next_state.objects

    def test_experience_holds_the_action(self, environment: Environment) -> None:
        _, experiences = tour(environment)
        assert [transition.action for transition in experiences] == (every_action(environment) * 2)[: len(experiences)]
        assert all(math.isfinite(transition.reward) for transition in experiences)
        assert all(transition.terminated in (True, False) for transition in experiences)

    def test_some_actions_have_an_effect_and_some_fail(self, environment: Environment) -> None:
        _, experiences = tour(environment)
        assert {transition.failed for transition in experiences} == {True, False}

    def test_no_objects_appear(self, environment: Environment) -> None:
        first, experiences = tour(environment)
        names = {item.name for item in first.objects}
        for transition in experiences:
            assert {item.name for item in transition.next_state.objects} <= names

    def test_unknown_action_is_refused(self, environment: Environment) -> None:
        environment.reset(np.random.default_rng(0))
        with pytest.raises(ValueError, match="JUMP"):
            environment.step(Action("JUMP"))
