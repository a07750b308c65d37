"""Policy iteration: evaluate a policy exactly, improve it, until it stays (Howard 1960; Puterman 1994, section 6.4)."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import spsolve

from wherry.oomdp.domain import Action
from wherry.oomdp.objects import State
from wherry.oomdp.outcomes import ConditionalModel
from wherry.planning.lookahead import TIE, Choice, Lookahead

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]


class PolicyIteration:
    """Optimal policies, with values that are exact but for rounding; plans again when the model has learnt.

    It takes few rounds, each of which solves a sparse linear system of as many equations as states can be reached.

    Args:
        model: What tells what actions do.
        discount: γ.
        r_max: R_max, the most that any step can be worth.
    """

    def __init__(self, model: ConditionalModel, *, discount: float = 0.95, r_max: float = 20.0) -> None:
        self.discount = discount
        self._lookahead = Lookahead(model, discount=discount, r_max=r_max)
        self._numbers: dict[State, int] = {}  # of the states that were reached, S in all
        self._policy: list[Action] = []  # [S]
        self._values: Floats = np.zeros(0)  # [S]

    def policy(self, state: State) -> Action:
        """The best action; of equally good ones the first."""
        number = self._solve(state)
        return self._policy[number]

    def value(self, state: State) -> float:
        """V(s), the discounted sum of rewards that the best policy can expect."""
        number = self._solve(state)
        return float(self._values[number])

    def _solve(self, state: State) -> int:
        """Make policy and values right for a state and all that can be reached from it; return the state's number."""
        if self._lookahead.refresh():
            self._numbers.clear()
        if state not in self._numbers:
            self._reach(state)
            self._iterate()
        return self._numbers[state]

    def _reach(self, start: State) -> None:
        """Number all states that can be reached."""
        self._numbers[start] = len(self._numbers)
        queue = deque([start])
        while queue:
            for choice in self._lookahead.choices(queue.popleft()):
                for way in choice.ways:
                    if way.state is not None and way.state not in self._numbers:
                        self._numbers[way.state] = len(self._numbers)
                        queue.append(way.state)

    def _iterate(self) -> None:
        """Evaluate and improve by turns."""
        choices = [choice for state in self._numbers for choice in self._lookahead.choices(state)]
        sizes = [len(self._lookahead.choices(state)) for state in self._numbers]
        first = np.cumsum([0, *sizes[:-1]])  # [S] where each state's choices begin
        transitions, rewards = self._tabulate(choices)
        policy = _first_of_the_best(rewards, first)
        while True:
            values = _evaluate(transitions[policy], rewards[policy], self.discount)
            worth = rewards + self.discount * (transitions @ values)
            best = _first_of_the_best(worth, first)
            better = worth[best] > worth[policy] + TIE
            if not better.any():
                break
            policy = np.where(better, best, policy)
        self._values = values
        self._policy = [choices[at].action for at in best]

    def _tabulate(self, choices: list[Choice]) -> tuple[sparse.csr_array, Floats]:
        """P [C, S] and expected rewards [C] of all choices; a leaf has no successor, and so the row adds up to less."""
        rewards = np.array([sum(way.probability * way.worth for way in choice.ways) for choice in choices])
        entries = [
            (way.probability, row, self._numbers[way.state])
            for row, choice in enumerate(choices)
            for way in choice.ways
            if way.state is not None
        ]
        probabilities, rows, columns = (np.array(column) for column in zip(*entries, strict=True)) if entries else (
            np.zeros(0), np.zeros(0, np.intp), np.zeros(0, np.intp)
        )  # fmt: skip
        shape = (len(choices), len(self._numbers))
        return sparse.csr_array((probabilities, (rows, columns)), shape=shape), rewards


def _first_of_the_best(worth: Floats, first: Indices) -> Indices:
    """[S] of every state's choices the first one that is as good as the best.

    Args:
        worth: [C] of every choice.
        first: [S] where each state's choices begin.
    """
    sizes = np.diff(np.append(first, len(worth)))
    best = np.repeat(np.maximum.reduceat(worth, first), sizes)
    candidates = np.flatnonzero(worth >= best - TIE)
    return candidates[np.searchsorted(candidates, first)]


def _evaluate(transitions: sparse.csr_array, rewards: Floats, discount: float) -> Floats:
    """V = (I - γ P)⁻¹ r, the values of a policy.

    Args:
        transitions: P [S, S] under the policy.
        rewards: r [S].
        discount: γ.
    """
    identity = sparse.eye_array(len(rewards), format="csc")
    return np.atleast_1d(spsolve(identity - discount * transitions.tocsc(), rewards))
