"""Labelled real-time dynamic programming for stochastic models (Bonet and Geffner, ICAPS 2003).

Values start at an upper bound and are lowered along trials, which follow the greedy policy from the queried state. So
only states that a good policy may visit are expanded; states whose values have converged are labelled as solved.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from wherry.oomdp.conditional_models import ConditionalModel
from wherry.oomdp.domain import Action
from wherry.oomdp.objects import State
from wherry.planning.lookahead import ChanceNode, Lookahead

UpperBound = Callable[[State], float]
"""h(s), admissible: never less than V(s); the tighter it is, the fewer trials are needed."""


class Lrtdp:
    """Optimal policies for the queried states; plans again when the model has been revised.

    Args:
        model: The model to plan on.
        rng: Draws the successors that a trial follows.
        discount: γ.
        r_max: R_max, the highest reward of any step.
        tolerance: ε, the largest Bellman residual of a solved state.
        upper_bound: h; None for R_max / (1 - γ) in every state.
    """

    def __init__(
        self,
        model: ConditionalModel,
        rng: np.random.Generator,
        *,
        discount: float = 0.95,
        r_max: float = 20.0,
        tolerance: float = 1e-6,
        upper_bound: UpperBound | None = None,
    ) -> None:
        self.rng = rng
        self.tolerance = tolerance
        self._lookahead = Lookahead(model, discount=discount, r_max=r_max)
        max_value = self._lookahead.max_value
        self._upper_bound: UpperBound = upper_bound or (lambda state: max_value)
        # Rewards beyond the horizon are discounted to less than the tolerance.
        horizon = math.log(tolerance / max(max_value, 2 * tolerance)) / math.log(discount) if discount > 0 else 1
        self._max_trial_length = math.ceil(horizon)
        self._values: dict[State, float] = {}
        self._solved: set[State] = set()

    @property
    def expanded_count(self) -> int:
        """Number of states that were expanded since the model was last revised."""
        return len(self._values)

    def policy(self, state: State) -> Action:
        """The best action; of equally good ones the first."""
        self._solve(state)
        return self._greedy(state)[0].action

    def value(self, state: State) -> float:
        """V(s), the expected discounted return of an optimal policy."""
        self._solve(state)
        return self._value(state)

    def _solve(self, state: State) -> None:
        """Run trials until the state is solved (algorithm LRTDP)."""
        if self._lookahead.refresh():
            self._values.clear()
            self._solved.clear()
        while state not in self._solved:
            self._trial(state)

    def _trial(self, start: State) -> None:
        """Follow the greedy policy to a leaf, then label states backwards until one is not solved (LRTDP-TRIAL)."""
        visited: list[State] = []
        state: State | None = start
        while state is not None and state not in self._solved and len(visited) < self._max_trial_length:
            visited.append(state)
            node, self._values[state] = self._greedy(state)
            state = node.sample(self.rng).state
        while visited and self._check_solved(visited.pop()):
            pass

    def _check_solved(self, start: State) -> bool:
        """Label all states that the greedy policy may visit, if the residual of each is small enough (CHECK-SOLVED)."""
        has_converged = True
        seen, queue = {start: None}, [start]
        while queue:
            state = queue.pop()
            node, value = self._greedy(state)
            if abs(value - self._value(state)) > self.tolerance:
                has_converged = False
                continue
            for successor in node.successors:
                if successor.state is not None and successor.state not in self._solved and successor.state not in seen:
                    seen[successor.state] = None
                    queue.append(successor.state)
        if has_converged:
            self._solved.update(seen)
        else:
            for state in reversed(seen):
                self._values[state] = self._greedy(state)[1]
        return has_converged

    def _greedy(self, state: State) -> tuple[ChanceNode, float]:
        """The greedy action by the current values, and max_a Q(s, a)."""
        return self._lookahead.greedy(state, self._value)

    def _value(self, state: State) -> float:
        known = self._values.get(state)
        if known is None:
            known = self._values[state] = self._upper_bound(state)
        return known
