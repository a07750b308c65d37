"""Near misses: failures that follow from other failures, beyond what the paper memorises.

Assumption: every action has one conjunctive condition for changing anything at all. (The paper's A2 allows several,
one for each effect.) Let M be the merged condition of all of the action's successes; the true condition covers M. If
the true condition covered a new condition c as well, it would cover M ⊕ c; so where M ⊕ c covers a condition that the
action failed under, c fails, too. In particular, a failure that differs from M in a single fixed term, a near miss,
proves that term necessary.

A success that contradicts the assumption revokes all that was inferred of the action, for good.
"""

from __future__ import annotations

from wherry.oomdp.conditions import Condition


class NearMisses:
    """What follows for every action from its successes and failures.

    Args:
        size: n, the number of terms.
    """

    def __init__(self, size: int) -> None:
        self.size = size
        self.successes: dict[str, Condition] = {}
        self.failures: dict[str, set[int]] = {}
        self.revoked: dict[str, str] = {}

    @property
    def violations(self) -> tuple[str, ...]:
        """Where the assumption did not hold, in words."""
        return tuple(f"{action}: {reason}" for action, reason in self.revoked.items())

    def fails(self, action: str, terms: int) -> bool:
        """Whether it follows that an action fails under a condition, given as bits."""
        merged = self.successes.get(action)
        if merged is None or action in self.revoked:
            return False
        return self._covers_failure(action, merged.merge(Condition.of(self.size, terms)))

    def add(self, action: str, terms: int, *, succeeded: bool) -> bool:
        """Learn from what an action did under a condition; return whether inferences may have changed."""
        condition = Condition.of(self.size, terms)
        if succeeded:
            before = self.successes.get(action)
            merged = self.successes[action] = condition if before is None else before.merge(condition)
            news = merged != before
        else:
            failures = self.failures.setdefault(action, set())
            news = terms not in failures
            failures.add(terms)
        if action in self.revoked or not news:
            return False
        if action in self.successes and self._covers_failure(action, self.successes[action]):
            self.revoked[action] = "no single conjunction tells its successes from its failures"
        return True

    def _covers_failure(self, action: str, condition: Condition) -> bool:
        return any(condition.covers_terms(failure) for failure in self.failures.get(action, ()))
