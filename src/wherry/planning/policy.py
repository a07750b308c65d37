"""What every planner that makes a policy has to offer, whatever it does to find one."""

from __future__ import annotations

from typing import Protocol

from wherry.oomdp.domain import Action
from wherry.oomdp.objects import State


class Planner(Protocol):
    """Knows what to do in every state, on a model that may learn meanwhile: π(s) and V(s)."""

    def policy(self, state: State) -> Action:
        """The best action."""
        ...

    def value(self, state: State) -> float:
        """V(s), the discounted sum of rewards that can be expected."""
        ...
