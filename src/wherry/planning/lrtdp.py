"""Labelled real-time dynamic programming for stochastic models (Bonet and Geffner, ICAPS 2003).

Values begin too high and come down along trials: walks that follow the greedy policy from the state in question. So
only states that a good policy may come to are ever looked at, and those whose values are settled are labelled solved.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from wherry.oomdp.domain import Action
from wherry.oomdp.objects import State
from wherry.oomdp.outcomes import ConditionalModel
from wherry.planning.lookahead import Choice, Lookahead

UpperBound = Callable[[State], float]
"""Never less than V(s), the discounted sum of rewards from a state on; the closer, the faster."""


class Lrtdp:
    """Optimal policies for the states that are asked for; plans again when the model has learnt.

    Args:
        model: What tells what actions do.
        rng: Which of several possible successors a trial follows.
        discount: γ.
        r_max: R_max, the most that any step can be worth.
        tolerance: ε, by how much a solved state's value may differ from what its successors' values say.
        upper_bound: h, admissible; None for R_max / (1 - γ) in every state.
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
        best_value = self._lookahead.best_value
        self._upper_bound: UpperBound = upper_bound or (lambda state: best_value)
        # What lies further ahead is worth less than the tolerance, whatever it is.
        reach = math.log(tolerance / max(best_value, 2 * tolerance)) / math.log(discount) if discount > 0 else 1
        self._longest_trial = math.ceil(reach)
        self._values: dict[State, float] = {}
        self._solved: set[State] = set()

    @property
    def visited(self) -> int:
        """How many states were looked at since the model last learnt."""
        return len(self._values)

    def policy(self, state: State) -> Action:
        """The best action; of equally good ones the first."""
        self._solve(state)
        return self._greedy(state)[0].action

    def value(self, state: State) -> float:
        """V(s), the discounted sum of rewards that the best policy can expect."""
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
        """Follow the greedy policy to the end, then label backwards as far as values are settled (LRTDP-TRIAL)."""
        walked: list[State] = []
        state: State | None = start
        while state is not None and state not in self._solved and len(walked) < self._longest_trial:
            walked.append(state)
            choice, self._values[state] = self._greedy(state)
            state = choice.draw(self.rng).state
        while walked and self._check_solved(walked.pop()):
            pass

    def _check_solved(self, start: State) -> bool:
        """Label all states that the greedy policy may come to, if none of their values is to change (CHECK-SOLVED)."""
        settled = True
        seen, queue = {start: None}, [start]
        while queue:
            state = queue.pop()
            choice, value = self._greedy(state)
            if abs(value - self._value(state)) > self.tolerance:
                settled = False
                continue
            for way in choice.ways:
                if way.state is not None and way.state not in self._solved and way.state not in seen:
                    seen[way.state] = None
                    queue.append(way.state)
        if settled:
            self._solved.update(seen)
        else:
            for state in reversed(seen):
                self._values[state] = self._greedy(state)[1]
        return settled

    def _greedy(self, state: State) -> tuple[Choice, float]:
        """The best choice by the values as they are, and max_a Q(s, a)."""
        return self._lookahead.best(state, self._value)

    def _value(self, state: State) -> float:
        known = self._values.get(state)
        if known is None:
            known = self._values[state] = self._upper_bound(state)
        return known
