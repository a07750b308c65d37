"""MDPs so small that their values can be computed by hand or with dense arrays."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from wherry.oomdp.attributes import integer
from wherry.oomdp.conditional_models import PerStateModel
from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.mdp import UNKNOWN, Model, Outcome, Prediction
from wherry.oomdp.objects import ObjectClass, State

WALKER = ObjectClass("Walker", (integer("x"),))
DOMAIN = Domain("walk", (WALKER,), (), {"left": (), "right": ()})
LEFT, RIGHT = Action("left"), Action("right")

Outcomes = Mapping[tuple[int, str], tuple[tuple[float, int, float, bool], ...]]
"""By state number and action name, a row for each outcome: probability, next state number, reward, termination."""

CORRIDOR: Outcomes = {  # two steps to the right end the episode
    (0, "left"): ((1.0, 0, -1.0, False),),
    (0, "right"): ((1.0, 1, -1.0, False),),
    (1, "left"): ((1.0, 0, -1.0, False),),
    (1, "right"): ((1.0, 2, 10.0, True),),
}


def state_at(number: int) -> State:
    """The state with the walker at a position."""
    return State((WALKER("walker", x=number),))


class TableModel:
    """A model given by a table; outcomes of states and actions without an entry are unknown."""

    def __init__(self, outcomes: Outcomes) -> None:
        self.outcomes = outcomes

    def predict(self, state: State, action: Action) -> Prediction:
        rows = self.outcomes.get((state["walker"].x, action.name), ())
        outcomes = tuple(Outcome(state_at(after), reward, end, probability) for probability, after, reward, end in rows)
        return Prediction(outcomes) if outcomes else UNKNOWN


def per_state(model: Model) -> PerStateModel:
    """A model of the walk as a conditional one."""
    return PerStateModel(DOMAIN, model)


def random_world(states: int, rng: np.random.Generator) -> Outcomes:
    """Three outcomes of random probability for every state and action, some of them terminal; |reward| ≤ 1."""
    outcomes = {}
    for state in range(states):
        for action in ("left", "right"):
            probabilities = rng.dirichlet(np.ones(3))
            successors = rng.choice(states, 3, replace=False)
            outcomes[state, action] = tuple(
                (float(probability), int(after), float(rng.uniform(-1, 1)), bool(rng.random() < 0.1))
                for probability, after in zip(probabilities, successors, strict=True)
            )
    return outcomes


def optimal_values(outcomes: Outcomes, states: int, discount: float) -> np.ndarray:
    """[S] V*, by value iteration on dense arrays [S, 2, S], without any code of the planners."""
    transition, reward = np.zeros((states, 2, states)), np.zeros((states, 2))
    for (state, action), rows in outcomes.items():
        for probability, after, step_reward, end in rows:
            reward[state, int(action == "right")] += probability * step_reward
            if not end:
                transition[state, int(action == "right"), after] += probability
    values = np.zeros(states)
    for _ in range(5000):
        values = (reward + discount * transition @ values).max(axis=1)
    return values
