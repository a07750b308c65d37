"""Rewards and ends of episodes, learnt as conditions.

A reward depends on the action and on the attributes that it changed: moving, bumping into a wall and picking up have
different rewards. Where the same change was observed with different rewards, conditions distinguish them: the
conditions of equal rewards are merged as in DOORMAX, and where merged conditions overlap, all conditions are memorised
instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from wherry.oomdp.conditions import Condition
from wherry.oomdp.effects_outcome import ChangedAttributes, StepReward

RewardAndEnd = tuple[float, bool]
"""A reward, and whether the episode ended."""


@dataclass
class RewardCases:
    """The rewards of the steps in which one action changed certain attributes.

    Attributes:
        merged: Merged condition of each reward; None once two of them overlap.
        latest: Latest reward observed under each condition (bits).
    """

    merged: dict[RewardAndEnd, Condition] | None = field(default_factory=dict)
    latest: dict[int, RewardAndEnd] = field(default_factory=dict)

    def contradicts(self, terms: int, value: RewardAndEnd) -> bool:
        """Return whether another reward was observed under the same condition."""
        return self.latest.get(terms, value) != value

    def add(self, condition: Condition, value: RewardAndEnd) -> bool:
        """Add a reward; of contradictory ones under one condition the latest counts.

        Returns:
            Whether `value` may return something else now.
        """
        if self.latest.get(condition.value) == value:
            return False
        contradicted = self.contradicts(condition.value, value)
        self.latest[condition.value] = value
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

    def value(self, terms: int, *, generalize: bool) -> RewardAndEnd | None:
        """Return the reward under a condition; None where it is not known."""
        if self.merged is None:
            return self.latest.get(terms)
        if generalize and len(self.merged) == 1:
            return next(iter(self.merged))
        return next((value for value, model in self.merged.items() if model.covers_terms(terms)), None)


def _overlap(first: Condition, second: Condition) -> bool:
    """Return whether some condition without * is covered by both."""
    return not (first.value ^ second.value) & first.mask & second.mask


class Rewards:
    """The rewards of all actions, by the attributes that a step changes.

    Args:
        size: n, the number of terms.
        generalize: Whether a reward that was the same under all conditions so far is predicted under conditions not
            met yet, too. Otherwise it is unknown there, as KWIK learning requires.

    Attributes:
        cases: Observed rewards, by action and changed attributes.
        has_seen_end: Whether some step ended an episode.
    """

    def __init__(self, size: int, *, generalize: bool = False) -> None:
        self.size = size
        self.generalize = generalize
        self.cases: dict[str, dict[ChangedAttributes, RewardCases]] = {}
        self.has_seen_end = False
        self._contradictions: dict[tuple[str, int], None] = {}

    def add(self, action: str, terms: int, case: StepReward) -> bool:
        """Learn the reward of a step; return whether predictions may have changed."""
        cases = self.cases.setdefault(action, {}).setdefault(case.changed, RewardCases())
        self.has_seen_end |= case.terminated
        value = case.reward, case.terminated
        if cases.contradicts(terms, value):
            self._contradictions[action, terms] = None
        return cases.add(Condition.of(self.size, terms), value)

    def violations(self, term_names: Sequence[str]) -> tuple[str, ...]:
        """Return, in words, the conditions under which equal steps had different rewards: the domain lacks a term."""
        return tuple(
            f"{action}: the reward, or whether the episode ended, was not the same each time "
            f"(where {Condition.of(self.size, terms).describe(term_names)})"
            for action, terms in self._contradictions
        )

    def step_rewards(self, action: str, terms: int) -> tuple[StepReward, ...]:
        """Return the rewards known for an action under a condition, given as bits."""
        known = []
        for changed, cases in self.cases.get(action, {}).items():
            value = cases.value(terms, generalize=self.generalize)
            if value is not None:
                known.append(StepReward(changed, *value))
        return tuple(known)
