"""Policy iteration: exact evaluation alternating with greedy improvement (Howard 1960; Puterman 1994, section 6.4)."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import spsolve

from wherry.oomdp.conditional_models import ConditionalModel
from wherry.oomdp.domain import Action
from wherry.oomdp.objects import State
from wherry.planning.lookahead import Q_TOLERANCE, ChanceNode, Lookahead

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]


class PolicyIteration:
    """Optimal policies with values that are exact up to rounding; plans again when the model has been revised.

    It takes few iterations, each of which solves a sparse linear system with one equation per reachable state.

    Args:
        model: The model to plan on.
        discount: γ.
        r_max: R_max, the highest reward of any step.
    """

    def __init__(self, model: ConditionalModel, *, discount: float = 0.95, r_max: float = 20.0) -> None:
        self.discount = discount
        self._lookahead = Lookahead(model, discount=discount, r_max=r_max)
        self._numbers: dict[State, int] = {}  # number of each of the S reachable states
        self._policy: list[Action] = []  # [S] greedy action
        self._values: Floats = np.zeros(0)  # [S] V(s)

    def policy(self, state: State) -> Action:
        """The best action; of equally good ones the first."""
        number = self._solve(state)
        return self._policy[number]

    def value(self, state: State) -> float:
        """V(s), the expected discounted return of an optimal policy."""
        number = self._solve(state)
        return float(self._values[number])

    def _solve(self, state: State) -> int:
        """Solve for a state and all that can be reached from it, unless they are solved; return the state's number."""
        if self._lookahead.refresh():
            self._numbers.clear()
        if state not in self._numbers:
            self._reach(state)
            self._iterate()
        return self._numbers[state]

    def _reach(self, start: State) -> None:
        """Number all states that can be reached from a state, breadth first."""
        self._numbers[start] = len(self._numbers)
        queue = deque([start])
        while queue:
            for node in self._lookahead.chance_nodes(queue.popleft()):
                for successor in node.successors:
                    if successor.state is not None and successor.state not in self._numbers:
                        self._numbers[successor.state] = len(self._numbers)
                        queue.append(successor.state)

    def _iterate(self) -> None:
        """Evaluate and improve the policy until it is stable."""
        nodes = [node for state in self._numbers for node in self._lookahead.chance_nodes(state)]
        sizes = [len(self._lookahead.chance_nodes(state)) for state in self._numbers]
        first = np.cumsum([0, *sizes[:-1]])  # [S] index of each state's first chance node
        transitions, rewards = self._tabulate(nodes)
        policy = _first_greedy(rewards, first)
        while True:
            values = _evaluate(transitions[policy], rewards[policy], self.discount)
            q_values = rewards + self.discount * (transitions @ values)
            greedy = _first_greedy(q_values, first)
            is_better = q_values[greedy] > q_values[policy] + Q_TOLERANCE
            if not is_better.any():
                break
            policy = np.where(is_better, greedy, policy)
        self._values = values
        self._policy = [nodes[index].action for index in greedy]

    def _tabulate(self, nodes: list[ChanceNode]) -> tuple[sparse.csr_array, Floats]:
        """Transition matrix P [N, S] without the leaves, and expected rewards [N], of N chance nodes."""
        rewards = [sum(successor.probability * successor.reward for successor in node.successors) for node in nodes]
        entries = [
            (row, self._numbers[successor.state], successor.probability)
            for row, node in enumerate(nodes)
            for successor in node.successors
            if successor.state is not None
        ]
        rows = np.array([row for row, _, _ in entries], np.intp)
        columns = np.array([column for _, column, _ in entries], np.intp)
        probabilities = np.array([probability for _, _, probability in entries], np.float64)
        shape = (len(nodes), len(self._numbers))
        return sparse.csr_array((probabilities, (rows, columns)), shape=shape), np.array(rewards)


def _first_greedy(q_values: Floats, first: Indices) -> Indices:
    """[S] index of the greedy chance node of every state; of equally good ones the first.

    Args:
        q_values: [N] Q value of every chance node; the nodes of one state are adjacent.
        first: [S] index of each state's first chance node.
    """
    sizes = np.diff(np.append(first, len(q_values)))
    best = np.repeat(np.maximum.reduceat(q_values, first), sizes)
    candidates = np.flatnonzero(q_values >= best - Q_TOLERANCE)
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
