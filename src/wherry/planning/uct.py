"""UCT: Monte Carlo tree search with UCB1 as its tree policy (Kocsis and Szepesvári, ECML 2006).

The cost of a query depends on the number of simulations and not on the size of the state space. It is an
anytime algorithm, and its policy is approximate.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from wherry.oomdp.conditional_models import ConditionalModel
from wherry.oomdp.domain import Action
from wherry.oomdp.objects import State
from wherry.planning.lookahead import ChanceNode, Lookahead

Evaluation = Callable[[State], float]
"""Returns an estimate of V(s) for a state at which a simulation leaves the tree."""


@dataclass(slots=True)
class _Node:
    """A decision node of the tree, with A actions.

    Attributes:
        state: s.
        chance_nodes: [A] the actions with their successors.
        visits: [A] N(s, a), how often each action was simulated.
        total_return: [A] sum of the returns that followed each action.
        children: [A] the decision nodes after each action, by state.
    """

    state: State
    chance_nodes: tuple[ChanceNode, ...]
    visits: list[int] = field(init=False)
    total_return: list[float] = field(init=False)
    children: list[dict[State, _Node]] = field(init=False)

    def __post_init__(self) -> None:
        self.visits = [0] * len(self.chance_nodes)
        self.total_return = [0.0] * len(self.chance_nodes)
        self.children = [{} for _ in self.chance_nodes]

    @property
    def most_visited(self) -> int:
        """Index of the action that was simulated most often."""
        return max(range(len(self.visits)), key=self.visits.__getitem__)

    def mean_return(self, index: int) -> float:
        """Estimate of Q(s, a), the mean return of an action."""
        return self.total_return[index] / self.visits[index]


class Uct:
    """Approximately optimal actions for single states; each query builds a new tree.

    Args:
        model: The model to plan on.
        rng: Draws successors and rollouts.
        discount: γ.
        r_max: R_max, the highest reward of any step.
        simulations: Number of simulations per query.
        horizon: Length of a simulation, steps.
        exploration: C_p, the weight of the exploration bonus, for returns scaled to [0, 1].
        evaluation: Value estimate for states that are not in the tree; None for the return of a random rollout.
    """

    def __init__(
        self,
        model: ConditionalModel,
        rng: np.random.Generator,
        *,
        discount: float = 0.95,
        r_max: float = 20.0,
        simulations: int = 1000,
        horizon: int = 50,
        exploration: float = math.sqrt(0.5),
        evaluation: Evaluation | None = None,
    ) -> None:
        self.rng = rng
        self.discount = discount
        self.simulations = simulations
        self.horizon = horizon
        self.exploration = exploration
        self._lookahead = Lookahead(model, discount=discount, r_max=r_max)
        self._evaluation = evaluation

    def policy(self, state: State) -> Action:
        """The action that was simulated most often."""
        root = self._search(state)
        return root.chance_nodes[root.most_visited].action

    def value(self, state: State) -> float:
        """Estimate of V(s), the mean return of the action that was simulated most often."""
        root = self._search(state)
        return root.mean_return(root.most_visited)

    def _search(self, state: State) -> _Node:
        """Build a tree, which grows by one node with every simulation."""
        self._lookahead.refresh()
        root = _Node(state, self._lookahead.chance_nodes(state))
        lowest, highest = math.inf, -math.inf  # smallest and largest return so far
        for _ in range(max(self.simulations, len(root.chance_nodes))):
            path, end = self._descend(root, lowest, highest)
            value = 0.0 if end is None else self._evaluate(end, self.horizon - len(path))
            for node, index, reward in reversed(path):
                value = reward + self.discount * value
                node.visits[index] += 1
                node.total_return[index] += value
                lowest, highest = min(lowest, value), max(highest, value)
        return root

    def _descend(
        self, root: _Node, lowest: float, highest: float
    ) -> tuple[list[tuple[_Node, int, float]], State | None]:
        """Follow the tree policy down to a new node.

        Returns:
            The nodes visited, each with the index of the action taken and its reward; the state at the end, which is
            None in a leaf.
        """
        path: list[tuple[_Node, int, float]] = []
        node: _Node | None = root
        end: State | None = root.state
        while node is not None and len(path) < self.horizon:
            index = self._select(node, lowest, highest)
            _, reward, end = node.chance_nodes[index].sample(self.rng)
            path.append((node, index, reward))
            if end is None:
                break
            parent, node = node, node.children[index].get(end)
            if node is None:
                parent.children[index][end] = _Node(end, self._lookahead.chance_nodes(end))
        return path, end

    def _select(self, node: _Node, lowest: float, highest: float) -> int:
        """Index of the action with the highest upper confidence bound (UCB1); actions without visits come first."""
        if 0 in node.visits:
            return node.visits.index(0)
        scale = max(highest - lowest, 1e-12)
        log_visits = math.log(sum(node.visits))

        def upper_bound(index: int) -> float:
            bonus = 2 * self.exploration * math.sqrt(log_visits / node.visits[index])
            return node.mean_return(index) / scale + bonus

        return max(range(len(node.chance_nodes)), key=upper_bound)

    def _evaluate(self, state: State, steps: int) -> float:
        """The value of a state that is new to the tree, by `evaluation` or by a random rollout of some steps."""
        if self._evaluation is not None:
            return self._evaluation(state)
        total, factor = 0.0, 1.0
        current: State | None = state
        for _ in range(steps):
            if current is None:
                break
            nodes = self._lookahead.chance_nodes(current)
            successor = nodes[self.rng.integers(len(nodes))].sample(self.rng)
            total += factor * successor.reward
            factor *= self.discount
            current = successor.state
        return total
