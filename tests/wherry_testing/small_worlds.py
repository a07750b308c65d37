"""Worlds so small that their values can be worked out by hand or by plain linear algebra."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from wherry.oomdp.attributes import integer
from wherry.oomdp.conditional_models import PerStateModel
from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.mdp import UNKNOWN, Model, Outcome, Prediction
from wherry.oomdp.objects import ObjectClass, State

WALKER = ObjectClass("Walker", (integer("at"),))
DOMAIN = Domain("walk", (WALKER,), (), {"left": (), "right": ()})
LEFT, RIGHT = Action("left"), Action("right")

Outcomes = Mapping[tuple[int, str], tuple[tuple[float, int, float, bool], ...]]
"""By state and action: probability, next state, reward, whether that ends the episode."""


def at(number: int) -> State:
    return State((WALKER("walker", at=number),))


class Tabular:
    """The model that a table describes; what is not in it is unknown."""

    def __init__(self, outcomes: Outcomes) -> None:
        self.outcomes = outcomes

    def predict(self, state: State, action: Action) -> Prediction:
        rows = self.outcomes.get((state["walker"].at, action.name), ())
        outcomes = tuple(Outcome(at(after), reward, end, chance) for chance, after, reward, end in rows)
        return Prediction(outcomes) if outcomes else UNKNOWN


def grounded(model: Model) -> PerStateModel:
    return PerStateModel(DOMAIN, model)


def random_world(states: int, rng: np.random.Generator) -> Outcomes:
    """Three equally possible places to come to, some of them ends; rewards of at most 1."""
    outcomes = {}
    for state in range(states):
        for action in ("left", "right"):
            chances = rng.dirichlet(np.ones(3))
            after = rng.choice(states, 3, replace=False)
            outcomes[state, action] = tuple(
                (float(chance), int(place), float(rng.uniform(-1, 1)), bool(rng.random() < 0.1))
                for chance, place in zip(chances, after, strict=True)
            )
    return outcomes


def optimal_values(outcomes: Outcomes, states: int, discount: float) -> np.ndarray:
    """[S] V*, by sweeping arrays [S, 2, S] until nothing moves: no code of the planners is used."""
    chance, reward = np.zeros((states, 2, states)), np.zeros((states, 2))
    for (state, action), branches in outcomes.items():
        for probability, after, worth, end in branches:
            reward[state, int(action == "right")] += probability * worth
            if not end:
                chance[state, int(action == "right"), after] += probability
    values = np.zeros(states)
    for _ in range(5000):
        values = (reward + discount * chance @ values).max(axis=1)
    return values
