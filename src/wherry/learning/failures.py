"""DOORMAX's failure conditions F: those under which an action, or its effect on one attribute, is known to fail."""

from __future__ import annotations

from dataclasses import dataclass, field

from wherry.learning.effect_rules import Subject
from wherry.oomdp.conditions import Condition

FailureKey = str | Subject
"""An action, whose failures change nothing at all; or an action and an attribute, whose failures keep its value."""


@dataclass
class FailureConditions:
    """F, a set of memorised conditions. They have no *, so none covers another.

    Attributes:
        size: n, the number of terms.
        conditions: Failure conditions as bits, by action, or by action and attribute.
    """

    size: int
    conditions: dict[FailureKey, set[int]] = field(default_factory=dict)

    def has(self, key: FailureKey, terms: int) -> bool:
        """Return whether a condition, given as bits, is a failure condition."""
        return terms in self.conditions.get(key, ())

    def add(self, key: FailureKey, terms: int) -> bool:
        """Algorithm 2, lines 3 and 4: F ← F ∪ {cond(s)}; return whether the condition is new."""
        failures = self.conditions.setdefault(key, set())
        is_new = terms not in failures
        failures.add(terms)
        return is_new

    def discard(self, key: FailureKey, terms: int) -> bool:
        """Remove a condition; return whether it was a failure condition."""
        was_failure = self.has(key, terms)
        if was_failure:
            self.conditions[key].remove(terms)
        return was_failure

    def by_action(self) -> dict[str, tuple[Condition, ...]]:
        """Return F_a: for each action, the conditions under which it changes nothing, or not all it ever changed."""
        by_action: dict[str, tuple[Condition, ...]] = {}
        for key, failures in self.conditions.items():
            action = key.action if isinstance(key, Subject) else key
            conditions = (Condition.of(self.size, terms) for terms in sorted(failures))
            by_action[action] = tuple(dict.fromkeys((*by_action.get(action, ()), *conditions)))
        return by_action
