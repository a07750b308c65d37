"""UCT: Monte Carlo tree search that treats every choice as a bandit (Kocsis and Szepesvári, ECML 2006).

It looks at no more states than it has time for, whatever the size of the world, and gets better with every simulation;
it never proves that it is right.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from wherry.oomdp.domain import Action
from wherry.oomdp.objects import State
from wherry.oomdp.outcomes import ConditionalModel
from wherry.planning.lookahead import Choice, Lookahead

Evaluation = Callable[[State], float]
"""A guess at V(s), used where the tree ends."""


@dataclass(slots=True)
class _Node:
    """A state in the tree, with A choices.

    Attributes:
        state: s.
        choices: [A].
        tried: [A] how often each was simulated, N(s, a).
        total: [A] the sum of what followed.
        children: [A] what it led to.
    """

    state: State
    choices: tuple[Choice, ...]
    tried: list[int] = field(init=False)
    total: list[float] = field(init=False)
    children: list[dict[State, _Node]] = field(init=False)

    def __post_init__(self) -> None:
        self.tried = [0] * len(self.choices)
        self.total = [0.0] * len(self.choices)
        self.children = [{} for _ in self.choices]

    def mean(self, at: int) -> float:
        """Q(s, a) as simulated so far."""
        return self.total[at] / self.tried[at]


class Uct:
    """Good actions for the states that are asked for, searched anew each time.

    Args:
        model: What tells what actions do.
        rng: What simulations draw from.
        discount: γ.
        r_max: R_max, the most that any step can be worth.
        simulations: How many to run for a decision.
        horizon: How many steps a simulation looks ahead.
        exploration: C_p, for returns that are scaled to [0, 1].
        evaluation: What a state is worth where the tree ends; None for what a random walk from there brings.
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
        """The action that simulations came back to most often."""
        root = self._search(state)
        return root.choices[max(range(len(root.choices)), key=root.tried.__getitem__)].action

    def value(self, state: State) -> float:
        """V(s), what followed on average from the action that simulations came back to most often."""
        root = self._search(state)
        return root.mean(max(range(len(root.choices)), key=root.tried.__getitem__))

    def _search(self, state: State) -> _Node:
        """Grow a tree by one state with every simulation."""
        self._lookahead.refresh()
        root = _Node(state, self._lookahead.choices(state))
        lowest, highest = math.inf, -math.inf  # of all returns so far
        for _ in range(max(self.simulations, len(root.choices))):
            path, end = self._descend(root, lowest, highest)
            value = 0.0 if end is None else self._evaluate(end, self.horizon - len(path))
            for node, at, worth in reversed(path):
                value = worth + self.discount * value
                node.tried[at] += 1
                node.total[at] += value
                lowest, highest = min(lowest, value), max(highest, value)
        return root

    def _descend(
        self, root: _Node, lowest: float, highest: float
    ) -> tuple[list[tuple[_Node, int, float]], State | None]:
        """Walk down the tree and one state out of it.

        Returns:
            The nodes on the way, each with the choice taken and the reward; and the state at the end, None in a leaf.
        """
        path: list[tuple[_Node, int, float]] = []
        node: _Node | None = root
        end: State | None = root.state
        while node is not None and len(path) < self.horizon:
            at = self._select(node, lowest, highest)
            _, worth, end = node.choices[at].draw(self.rng)
            path.append((node, at, worth))
            if end is None:
                break
            parent, node = node, node.children[at].get(end)
            if node is None:
                parent.children[at][end] = _Node(end, self._lookahead.choices(end))
        return path, end

    def _select(self, node: _Node, lowest: float, highest: float) -> int:
        """The choice with the highest upper confidence bound (UCB1); those never tried come first."""
        if 0 in node.tried:
            return node.tried.index(0)
        scale = max(highest - lowest, 1e-12)
        log_visits = math.log(sum(node.tried))

        def bound(at: int) -> float:
            return node.mean(at) / scale + 2 * self.exploration * math.sqrt(log_visits / node.tried[at])

        return max(range(len(node.choices)), key=bound)

    def _evaluate(self, state: State, steps: int) -> float:
        """What a state at the end of the tree is worth."""
        if self._evaluation is not None:
            return self._evaluation(state)
        total, factor = 0.0, 1.0
        here: State | None = state
        for _ in range(steps):
            if here is None:
                break
            choices = self._lookahead.choices(here)
            way = choices[self.rng.integers(len(choices))].draw(self.rng)
            total += factor * way.worth
            factor *= self.discount
            here = way.state
        return total
