"""Near misses (Winston 1970): failures inferred from other failures, where the paper memorises each failure.

Assumption: every action changes anything at all only under one conjunctive condition. (The paper's A2 allows several
conditions, one for each effect.) Let M be the merged condition of all of the action's successes; the true condition
covers M. If the true condition covered a new condition c as well, it would cover M ⊕ c. So where M ⊕ c covers a
condition under which the action failed, the action fails under c, too. In particular, a failure that differs from M in
a single fixed term, a near miss, proves that the term is necessary.

A success that contradicts the assumption revokes all inferences about the action permanently.
"""

from __future__ import annotations

from wherry.oomdp.conditions import Condition


class NearMisses:
    """Infers failures of every action from its successes and failures.

    Args:
        size: n, the number of terms.

    Attributes:
        successes: M, merged condition of all successes, by action.
        failures: Conditions of all failures as bits, by action.
        revoked: Reason why inferences about an action were revoked, by action.
    """

    def __init__(self, size: int) -> None:
        self.size = size
        self.successes: dict[str, Condition] = {}
        self.failures: dict[str, set[int]] = {}
        self.revoked: dict[str, str] = {}

    @property
    def violations(self) -> tuple[str, ...]:
        """The actions for which the assumption did not hold, in words."""
        return tuple(f"{action}: {reason}" for action, reason in self.revoked.items())

    def fails(self, action: str, terms: int) -> bool:
        """Return whether the experience implies that an action fails under a condition, given as bits."""
        merged = self.successes.get(action)
        if merged is None or action in self.revoked:
            return False
        return self._covers_failure(action, merged.merge(Condition.of(self.size, terms)))

    def add(self, action: str, terms: int, *, succeeded: bool) -> bool:
        """Add the result of an action under a condition; return whether inferences may have changed."""
        condition = Condition.of(self.size, terms)
        if succeeded:
            before = self.successes.get(action)
            merged = self.successes[action] = condition if before is None else before.merge(condition)
            is_new = merged != before
        else:
            failures = self.failures.setdefault(action, set())
            is_new = terms not in failures
            failures.add(terms)
        if action in self.revoked or not is_new:
            return False
        if action in self.successes and self._covers_failure(action, self.successes[action]):
            self.revoked[action] = "no single conjunction tells its successes from its failures"
        return True

    def _covers_failure(self, action: str, condition: Condition) -> bool:
        """Return whether a condition covers one under which the action failed."""
        return any(condition.covers_terms(failure) for failure in self.failures.get(action, ()))
