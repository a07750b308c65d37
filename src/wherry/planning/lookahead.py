"""One step ahead: what the actions in a state may lead to, and what that is worth.

What planners that look at single states share: not to know is worth R_max for ever, in a leaf that ends the search, so
that optimism in the face of uncertainty is the same in all of them (Brafman and Tennenholtz 2002).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from wherry.oomdp.domain import Action
from wherry.oomdp.mdp import Prediction
from wherry.oomdp.objects import State
from wherry.oomdp.outcomes import ConditionalModel
from wherry.planning.successors import Successors

TIE = 1e-9  # values this close are equally good


class Way(NamedTuple):
    """One thing that an action may do.

    Attributes:
        probability: P(s'|s, a).
        worth: The reward of the step; in a leaf, all that will ever follow.
        state: s', or None in a leaf: the episode has ended, or the model cannot tell.
    """

    probability: float
    worth: float
    state: State | None


class Choice(NamedTuple):
    """An action with all that it may do.

    Attributes:
        action: a.
        ways: What it may do; the probabilities add up to 1.
    """

    action: Action
    ways: tuple[Way, ...]

    def value(self, value_of: Callable[[State], float], discount: float) -> float:
        """Q(s, a) = Σ P(s'|s, a) (r + γ V(s'))."""
        return sum(
            way.probability * (way.worth + (0.0 if way.state is None else discount * value_of(way.state)))
            for way in self.ways
        )

    def draw(self, rng: np.random.Generator) -> Way:
        """One of the ways, at random."""
        if len(self.ways) == 1:
            return self.ways[0]
        left = rng.random()
        for way in self.ways:
            left -= way.probability
            if left < 0:
                return way
        return self.ways[-1]


class Lookahead:
    """The choices in every state, remembered until the model has learnt more.

    Args:
        model: What tells what actions do.
        discount: γ, below 1.
        r_max: R_max, the most that any step can be worth; none is worth less than -R_max.

    Raises:
        ValueError: The discount is not in [0, 1).
    """

    def __init__(self, model: ConditionalModel, *, discount: float, r_max: float) -> None:
        if not 0 <= discount < 1:
            raise ValueError(f"the discount must be at least 0 and below 1, not {discount:g}")
        self.model = model
        self.discount = discount
        self.best_value = r_max / (1 - discount)  # V(s_max)
        self._successors = Successors(model)
        self._choices: dict[State, tuple[Choice, ...]] = {}
        self._revisions: dict[str, int] = {}

    def refresh(self) -> bool:
        """Notice whether the model has learnt; then all that was worked out before is void."""
        if self._revisions == self.model.revisions:
            return False
        self._revisions = dict(self.model.revisions)
        self._successors.refresh()
        self._choices.clear()
        return True

    def choices(self, state: State) -> tuple[Choice, ...]:
        """All that can be done in a state."""
        known = self._choices.get(state)
        if known is None:
            known = tuple(Choice(action, self._ways(prediction)) for action, prediction in self._successors.of(state))
            self._choices[state] = known
        return known

    def best(self, state: State, value_of: Callable[[State], float]) -> tuple[Choice, float]:
        """The first of the best choices, and max_a Q(s, a)."""
        choices = self.choices(state)
        values = [choice.value(value_of, self.discount) for choice in choices]
        most = max(values)
        first = next(at for at, value in enumerate(values) if value >= most - TIE)
        return choices[first], most

    def _ways(self, prediction: Prediction) -> tuple[Way, ...]:
        """What a prediction says may happen; that which cannot be is left out, unless there is nothing else."""
        branches = [branch for branch in (prediction, *prediction.otherwise) if branch.probability > 0]
        if not branches:
            return (Way(1.0, -self.best_value, None),)  # never worth trying
        total = sum(branch.probability for branch in branches)
        return tuple(self._way(branch, branch.probability / total) for branch in branches)

    def _way(self, branch: Prediction, probability: float) -> Way:
        if branch.state is None or branch.reward is None or branch.terminated is None:
            return Way(probability, self.best_value, None)
        return Way(probability, branch.reward, None if branch.terminated else branch.state)
