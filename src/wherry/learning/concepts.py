"""The posterior over one concept: a conjunction of terms that is inferred from examples.

Every conjunction h ∈ {0, 1, *}ⁿ is a hypothesis. Its prior is proportional to q to the power of the number of its fixed
terms, so that short conjunctions are preferred (Occam's razor). A positive example rules out all hypotheses that do
not cover it, a negative example those that do. The probability that the concept holds elsewhere is the weight of the
remaining hypotheses that cover the place, divided by the weight of all remaining ones.

The 3ⁿ hypotheses are counted without listing them. A hypothesis is a set of literals (a term, or its negation). Let L
be the literals that all positive examples share. The remaining hypotheses are the subsets of L that are not contained
in any negative example. Their weight is (1 + q)^|L|, the weight of all subsets of L, minus `union_weight`, the weight
of those contained in some negative example, for which only the maximal intersections of L with negative examples count.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import combinations

from wherry.oomdp.conditions import Condition

Literals = int
"""A set of literals as bits: bit i stands for term i, bit n + i for its negation."""


def literals_of(terms: int, size: int) -> Literals:
    """Return all literals that are true where exactly these of n terms hold."""
    return terms | (~terms & (1 << size) - 1) << size


def condition_of(literals: Literals, size: int) -> Condition:
    """Return a set of literals as a condition."""
    value, negated = literals & (1 << size) - 1, literals >> size
    return Condition(size, value | negated, value)


def largest(parts: Iterable[Literals]) -> frozenset[Literals]:
    """Return the maximal sets: those that are not contained in another one."""
    kept: list[Literals] = []
    for part in sorted(set(parts), key=int.bit_count, reverse=True):
        if all(part & ~other for other in kept):
            kept.append(part)
    return frozenset(kept)


@lru_cache(maxsize=100_000)
def union_weight(parts: frozenset[Literals], factor: float) -> float:
    """Return the weight of all sets of literals that are contained in at least one of some sets.

    A set of k literals weighs ``factor`` to the power of k. Inclusion and exclusion adds one set at a time: the subsets
    of the first, plus those of all others, minus those of the first and another.

    Args:
        parts: Sets of which none is contained in another.
        factor: q, the weight of one literal.
    """
    if not parts:
        return 0.0
    shared = ~0
    for part in parts:
        shared &= part
    weight = (1 + factor) ** shared.bit_count()
    if len(parts) == 1:
        return weight
    first, *others = sorted(part & ~shared for part in parts)
    return weight * (
        (1 + factor) ** first.bit_count()
        + union_weight(frozenset(others), factor)
        - union_weight(largest(first & other for other in others), factor)
    )


@dataclass(frozen=True)
class Concept:
    """The posterior over one conjunction.

    Attributes:
        size: n, the number of terms.
        factor: q, prior odds of each literal of a conjunction.
        shared: Literals that all positive examples share; None before the first one.
        refuted: Maximal intersections of the shared literals with negative examples.
        weight: Weight of all hypotheses that no example rules out.
    """

    size: int
    factor: float
    shared: Literals | None = None
    refuted: frozenset[Literals] = frozenset()
    weight: float = field(init=False, compare=False)

    def __post_init__(self) -> None:
        prior_weight = (
            (1 + 2 * self.factor) ** self.size  # each term is fixed to 1, to 0, or not at all
            if self.shared is None
            else (1 + self.factor) ** self.shared.bit_count()
        )
        object.__setattr__(self, "weight", prior_weight - union_weight(self.refuted, self.factor))

    @classmethod
    def of(cls, size: int, factor: float, positives: Iterable[int], negatives: Iterable[int]) -> Concept:
        """Return the posterior after some examples, given as the terms that held in them (bits)."""
        shared: Literals | None = None
        for terms in positives:
            literals = literals_of(terms, size)
            shared = literals if shared is None else shared & literals
        parts = (literals_of(terms, size) & (-1 if shared is None else shared) for terms in negatives)
        return cls(size, factor, shared, largest(parts))

    @property
    def is_consistent(self) -> bool:
        """Whether some conjunction agrees with all examples."""
        return self.shared is None or self.shared not in self.refuted

    def covers(self, terms: int) -> bool:
        """Return whether all remaining hypotheses cover these terms: the literals that positives share are all true."""
        return self.shared is not None and not self.shared & ~literals_of(terms, self.size)

    def probability(self, terms: int) -> float:
        """Return the probability that the concept holds where exactly these terms hold."""
        literals = literals_of(terms, self.size)
        if self.shared is not None:
            literals &= self.shared
        within = largest(part & literals for part in self.refuted)
        if literals in within:
            return 0.0
        covering = (1 + self.factor) ** literals.bit_count() - union_weight(within, self.factor)
        return min(1.0, max(0.0, covering / self.weight))

    @cached_property
    def simplest(self) -> tuple[Literals, ...]:
        """The remaining hypotheses with the fewest literals: the smallest sets not contained in any negative example.

        Without negative examples these are all single literals. The empty conjunction counts only when no other
        hypothesis is left, since most actions fail somewhere. Before the first positive example there are none.
        """
        if self.shared is None or not self.is_consistent:
            return ()
        choices = [1 << bit for bit in range(2 * self.size) if self.shared >> bit & 1]
        for count in range(1, len(choices) + 1):
            sets = (sum(chosen) for chosen in combinations(choices, count))
            found = tuple(chosen for chosen in sets if all(chosen & ~part for part in self.refuted))
            if found:
                return found
        return (0,)

    def disagreement(self, terms: int) -> float:
        """Return how evenly the simplest hypotheses disagree about these terms: 1 is half against half, 0 agreement."""
        if not self.simplest:
            return 0.0
        literals = literals_of(terms, self.size)
        share = sum(not hypothesis & ~literals for hypothesis in self.simplest) / len(self.simplest)
        return 4 * share * (1 - share)
