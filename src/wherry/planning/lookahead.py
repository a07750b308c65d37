"""One-step lookahead: the successors of a state under each action, and Q values from them.

Planners that expand single states share it, so that all treat unknown outcomes alike: they lead to s_max, a leaf whose
reward is R_max in every step (Brafman and Tennenholtz 2002).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from wherry.oomdp.conditional_models import ConditionalModel
from wherry.oomdp.domain import Action
from wherry.oomdp.mdp import Outcome, Prediction
from wherry.oomdp.objects import State
from wherry.planning.prediction_cache import PredictionCache

Q_TOLERANCE = 1e-9  # in units of reward; actions whose Q values differ by less are equally good


class Successor(NamedTuple):
    """A possible successor of a state, as backups use it.

    Attributes:
        probability: P(s'|s, a), normalized over the successors.
        reward: r; for a leaf the return of this and all later steps.
        state: s'; None for a leaf: the episode ends, or the outcome is unknown (s_max).
    """

    probability: float
    reward: float
    state: State | None


class ChanceNode(NamedTuple):
    """An action with its possible successors.

    Attributes:
        action: a.
        successors: The possible successors; their probabilities sum to 1.
    """

    action: Action
    successors: tuple[Successor, ...]

    def q_value(self, value_of: Callable[[State], float], discount: float) -> float:
        """Q(s, a) = Σ P(s'|s, a) (r + γ V(s'))."""
        return sum(
            successor.probability
            * (successor.reward + (0.0 if successor.state is None else discount * value_of(successor.state)))
            for successor in self.successors
        )

    def sample(self, rng: np.random.Generator) -> Successor:
        """A successor drawn at random."""
        if len(self.successors) == 1:
            return self.successors[0]
        remaining = rng.random()
        for successor in self.successors:
            remaining -= successor.probability
            if remaining < 0:
                return successor
        return self.successors[-1]


class Lookahead:
    """The chance nodes of every state, cached until the model is revised.

    Args:
        model: The model to plan on.
        discount: γ, below 1.
        r_max: R_max, the highest reward of any step; rewards must lie within ±R_max.

    Raises:
        ValueError: The discount is not in [0, 1).
    """

    def __init__(self, model: ConditionalModel, *, discount: float, r_max: float) -> None:
        if not 0 <= discount < 1:
            raise ValueError(f"the discount must be at least 0 and below 1, not {discount:g}")
        self.model = model
        self.discount = discount
        self.max_value = r_max / (1 - discount)  # V(s_max)
        self._cache = PredictionCache(model)
        self._nodes: dict[State, tuple[ChanceNode, ...]] = {}
        self._revisions: dict[str, int] = {}

    def refresh(self) -> bool:
        """Clear the cache if the model was revised; return whether it was."""
        if self._revisions == self.model.revisions:
            return False
        self._revisions = dict(self.model.revisions)
        self._cache.refresh()
        self._nodes.clear()
        return True

    def chance_nodes(self, state: State) -> tuple[ChanceNode, ...]:
        """The chance nodes of all ground actions in a state."""
        nodes = self._nodes.get(state)
        if nodes is None:
            nodes = tuple(
                ChanceNode(action, self._successors(prediction))
                for action, prediction in self._cache.predictions(state)
            )
            self._nodes[state] = nodes
        return nodes

    def greedy(self, state: State, value_of: Callable[[State], float]) -> tuple[ChanceNode, float]:
        """The best action, of equally good ones the first, and max_a Q(s, a)."""
        nodes = self.chance_nodes(state)
        q_values = [node.q_value(value_of, self.discount) for node in nodes]
        best_value = max(q_values)
        first = next(index for index, value in enumerate(q_values) if value >= best_value - Q_TOLERANCE)
        return nodes[first], best_value

    def _successors(self, prediction: Prediction) -> tuple[Successor, ...]:
        """The successors with normalized probabilities; a leaf of the lowest return if none is possible."""
        possible = [outcome for outcome in prediction.outcomes if outcome.probability > 0]
        if not possible:
            return (Successor(1.0, -self.max_value, None),)
        total = sum(outcome.probability for outcome in possible)
        return tuple(self._successor(outcome, outcome.probability / total) for outcome in possible)

    def _successor(self, outcome: Outcome, probability: float) -> Successor:
        if outcome.next_state is None or outcome.reward is None or outcome.terminated is None:
            return Successor(probability, self.max_value, None)
        return Successor(probability, outcome.reward, None if outcome.terminated else outcome.next_state)
