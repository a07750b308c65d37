"""Q-learning (Watkins 1989): no model at all, one value for every state and action.

The baseline that most people know. It learns with one-step backups and explores ε-greedily, or by optimistic first
values.
"""

from __future__ import annotations

import numpy as np

from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.mdp import UNKNOWN, Prediction, Transition
from wherry.oomdp.objects import State


class QLearning:
    """A table of action values; learner and planner in one.

    Args:
        domain: What states are described with.
        rng: Where the randomness of exploring comes from.
        discount: γ.
        learning_rate: α, how far a value moves to what was seen; 1 suits a world where nothing is random.
        exploration: ε, how often a random action is taken.
        first_value: Q of what was never tried; optimistic where it is more than anything can be worth.
    """

    violations: tuple[str, ...] = ()

    def __init__(
        self,
        domain: Domain,
        rng: np.random.Generator,
        *,
        discount: float = 0.95,
        learning_rate: float = 1.0,
        exploration: float = 0.1,
        first_value: float = 0.0,
    ) -> None:
        self.domain = domain
        self.rng = rng
        self.discount = discount
        self.learning_rate = learning_rate
        self.exploration = exploration
        self.first_value = first_value
        self._values: dict[State, dict[Action, float]] = {}

    def predict(self, state: State, action: Action) -> Prediction:
        """Nothing: it has no model."""
        return UNKNOWN

    def policy(self, state: State) -> Action:
        """The action to learn with: the best, or now and then any."""
        if self.rng.random() < self.exploration:
            actions = self.domain.ground_actions(state)
            return actions[self.rng.integers(len(actions))]
        return self.best(state)

    def value(self, state: State) -> float:
        """V(s) = max Q(s, a)."""
        return max(self._values_of(state).values())

    def best(self, state: State) -> Action:
        """The action of the highest value; of equals the first."""
        values = self._values_of(state)
        return max(values, key=values.__getitem__)

    def add_experience(self, transition: Transition) -> None:
        """Back up one step: Q(s, a) ← Q(s, a) + α (r + γ max Q(s', a') − Q(s, a))."""
        values = self._values_of(transition.state)
        target = transition.reward
        if not transition.terminated:
            target += self.discount * self.value(transition.next_state)
        values[transition.action] += self.learning_rate * (target - values[transition.action])

    def _values_of(self, state: State) -> dict[Action, float]:
        values = self._values.get(state)
        if values is None:
            values = self._values[state] = dict.fromkeys(self.domain.ground_actions(state), self.first_value)
        return values
