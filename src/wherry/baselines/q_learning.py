"""Q-learning (Watkins 1989): no model, one value for every state and action.

It learns with one-step backups and explores ε-greedily, or by optimistic initial values.

This is the reference implementation on object states. Experiments run `wherry.baselines.compiled.q_learning`, which is
tested against it step by step.
"""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field

import numpy as np

from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.mdp import UNKNOWN, Prediction, Transition
from wherry.oomdp.objects import State


@dataclass(eq=False)
class QLearning:
    """A table of action values; learner and planner in one.

    Attributes:
        domain: Domain whose states and actions are learnt about.
        rng: Random number generator for exploration.
        discount: γ.
        learning_rate: α, step size of the backups; 1 is right in a deterministic world.
        exploration: ε, probability of a random action.
        initial_value: Q of state–action pairs not tried yet; an upper bound of all returns makes it optimistic.
    """

    domain: Domain
    rng: np.random.Generator
    _: KW_ONLY
    discount: float = 0.95
    learning_rate: float = 1.0
    exploration: float = 0.1
    initial_value: float = 0.0
    _values: dict[State, dict[Action, float]] = field(init=False, default_factory=dict, repr=False)

    @property
    def violations(self) -> tuple[str, ...]:
        """Empty: Q-learning makes no assumptions that experience could contradict."""
        return ()

    def predict(self, state: State, action: Action) -> Prediction:
        """Return unknown: Q-learning has no model."""
        return UNKNOWN

    def policy(self, state: State) -> Action:
        """Return the ε-greedy action."""
        if self.rng.random() < self.exploration:
            actions = self.domain.ground_actions(state)
            return actions[self.rng.integers(len(actions))]
        return self.best(state)

    def value(self, state: State) -> float:
        """V(s) = max Q(s, a)."""
        return max(self._values_of(state).values())

    def best(self, state: State) -> Action:
        """Return the greedy action; the first one among equals."""
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
            values = self._values[state] = dict.fromkeys(self.domain.ground_actions(state), self.initial_value)
        return values
