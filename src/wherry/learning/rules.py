"""Learnt rules in a readable form, and the protocol of learners whose knowledge consists of rules."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from wherry.oomdp.conditional_models import ConditionalModel
from wherry.oomdp.conditions import Condition
from wherry.oomdp.mdp import Learner


@dataclass(frozen=True, slots=True)
class Rule:
    """An effect of an action, and the condition under which the action has it.

    Attributes:
        action: Name of the action.
        condition: Condition over the domain's terms.
        effect: Effect in words: ``taxi.y += 1``.
    """

    action: str
    condition: Condition
    effect: str

    def describe(self, term_names: Sequence[str]) -> str:
        """Return the rule as a sentence: ``N: if not touch_N(taxi, wall): taxi.y += 1``."""
        return f"{self.action}: if {self.condition.describe(term_names)}: {self.effect}"


class RuleLearner(ConditionalModel, Learner, Protocol):
    """A learner of rules, which can be read, saved, and used in other worlds of the same domain."""

    def rules(self) -> tuple[Rule, ...]:
        """Return the learnt effects of all actions."""
        ...

    def failure_conditions(self) -> dict[str, tuple[Condition, ...]]:
        """Return, for each action, the conditions under which it is known to change nothing."""
        ...

    def sentences(self) -> tuple[str, ...]:
        """Return the learnt rules in words: ``N: if not touch_N(taxi, wall): taxi.y += 1``."""
        ...

    def keep_simplest(self) -> None:
        """Keep only the simplest effect type of each attribute, before the rules are used in another world."""
        ...
