"""Rewards and the ends of episodes, learnt as conditions.

A reward belongs to an action and to what the action changed: to move, to bump into a wall, to pick up, and to close the
fork on nothing are worth different things. Where one change brought different rewards, conditions tell them apart:
conditions of equal rewards are merged as DOORMAX's are, and where merged conditions overlap they are memorised instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from wherry.oomdp.conditions import Condition
from wherry.oomdp.effects_outcome import ChangedAttributes, StepReward

Value = tuple[float, bool]
"""A reward, and whether the episode ended."""


@dataclass
class _Cases:
    """What one action's one change was worth.

    Attributes:
        merged: The merged condition of every value; None once they overlap.
        seen: The value under every condition that was met, as bits.
    """

    merged: dict[Value, Condition] | None = field(default_factory=dict)
    seen: dict[int, Value] = field(default_factory=dict)

    def contradicts(self, terms: int, value: Value) -> bool:
        """Whether another value was seen under the same condition."""
        return self.seen.get(terms, value) != value

    def add(self, condition: Condition, value: Value) -> bool:
        """Take in what was seen; return whether that may change `value`. Where values contradict, the last counts."""
        if self.seen.get(condition.value) == value:
            return False
        contradicted = self.contradicts(condition.value, value)
        self.seen[condition.value] = value
        if self.merged is not None:
            before = self.merged.get(value)
            if before is not None and before.covers(condition) and not contradicted:
                return False
            merged = condition if before is None else before.merge(condition)
            self.merged[value] = merged
            others = [other for key, other in self.merged.items() if key != value]
            if contradicted or any(_overlap(merged, other) for other in others):
                self.merged = None
        return True

    def value(self, terms: int, *, generalize: bool) -> Value | None:
        """The value under a condition, or None where it is not known."""
        if self.merged is None:
            return self.seen.get(terms)
        if generalize and len(self.merged) == 1:
            return next(iter(self.merged))
        return next((value for value, model in self.merged.items() if model.covers_terms(terms)), None)


def _overlap(first: Condition, second: Condition) -> bool:
    """Whether some full condition is covered by both."""
    return not (first.value ^ second.value) & first.mask & second.mask


class Rewards:
    """What steps were worth, by action and change.

    Args:
        size: n, the number of terms.
        generalize: Whether a change that has always been worth the same is taken to be worth that under conditions
            never met, too. Without it, such a step's worth is unknown (as KWIK learning demands).
    """

    def __init__(self, size: int, *, generalize: bool = False) -> None:
        self.size = size
        self.generalize = generalize
        self.cases: dict[str, dict[ChangedAttributes, _Cases]] = {}
        self.end_seen = False  # whether some step ended an episode
        self._contradictions: dict[tuple[str, int], None] = {}

    def add(self, action: str, terms: int, case: StepReward) -> bool:
        """Learn what a step was worth; return whether predictions may have changed."""
        cases = self.cases.setdefault(action, {}).setdefault(case.changed, _Cases())
        self.end_seen |= case.terminated
        value = case.reward, case.terminated
        if cases.contradicts(terms, value):
            self._contradictions[action, terms] = None
        return cases.add(Condition.of(self.size, terms), value)

    def violations(self, term_names: Sequence[str]) -> tuple[str, ...]:
        """Where the same step under the same condition was worth different things, in words: terms are missing."""
        return tuple(
            f"{action}: the reward, or whether the episode ended, was not the same each time "
            f"(where {Condition.of(self.size, terms).describe(term_names)})"
            for action, terms in self._contradictions
        )

    def step_rewards(self, action: str, terms: int) -> tuple[StepReward, ...]:
        """What is known of an action's worth under a condition, given as bits."""
        known = []
        for changed, cases in self.cases.get(action, {}).items():
            value = cases.value(terms, generalize=self.generalize)
            if value is not None:
                known.append(StepReward(changed, *value))
        return tuple(known)
