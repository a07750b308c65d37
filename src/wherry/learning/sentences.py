"""What a learner believes, put so that people can read it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from wherry.oomdp.conditions import Condition


@dataclass(frozen=True, slots=True)
class Rule:
    """What an action does, and when.

    Attributes:
        action: The action's name.
        condition: When it does it.
        effect: What it does, in words: ``taxi.y += 1``.
    """

    action: str
    condition: Condition
    effect: str

    def words(self, term_names: Sequence[str]) -> str:
        """The rule as a sentence: ``N: if not touch_N(taxi, wall): taxi.y += 1``."""
        return f"{self.action}: if {self.condition.describe(term_names)}: {self.effect}"
