"""The protocol of planners."""

from __future__ import annotations

from typing import Protocol

from wherry.oomdp.domain import Action
from wherry.oomdp.objects import State


class Planner(Protocol):
    """Computes π(s) and V(s) on a model, and again when the model has been revised."""

    def policy(self, state: State) -> Action:
        """The best action in a state."""
        ...

    def value(self, state: State) -> float:
        """V(s), the expected discounted return."""
        ...
