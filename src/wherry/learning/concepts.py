"""Beliefs about one concept: a conjunction of terms that is to be found from examples.

Every conjunction h ∈ {0, 1, *}ⁿ is a hypothesis; each term that it fixes makes it less likely beforehand by a constant
factor (Occam). An example where the concept held refutes all hypotheses that do not cover it, an example where it did
not hold those that do. The probability that it holds elsewhere is the share of the surviving weight that covers it.

The 3ⁿ hypotheses are counted and not listed. A hypothesis is a set of literals (a term, or its negation). Let L be the
literals that all positive examples share. The sets that survive are the subsets of L that are not part of any negative
example: the weight of all subsets of L, less the weight of those that are part of some negative example. The former is
(1 + q)^|L|, and the latter is `union_weight`, in which only the largest of the negative examples' parts in L matter.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import combinations

from wherry.oomdp.conditions import Condition

Literals = int
"""A set of literals as bits: bit i says that term i holds, bit n + i that it does not."""


def literals_of(terms: int, size: int) -> Literals:
    """All literals that are true where exactly these of n terms hold."""
    return terms | (~terms & (1 << size) - 1) << size


def condition_of(literals: Literals, size: int) -> Condition:
    """A set of literals as a condition."""
    value, negated = literals & (1 << size) - 1, literals >> size
    return Condition(size, value | negated, value)


def largest(parts: Iterable[Literals]) -> frozenset[Literals]:
    """The sets that are not part of another one."""
    kept: list[Literals] = []
    for part in sorted(set(parts), key=int.bit_count, reverse=True):
        if all(part & ~other for other in kept):
            kept.append(part)
    return frozenset(kept)


@lru_cache(maxsize=100_000)
def union_weight(parts: frozenset[Literals], factor: float) -> float:
    """The weight of all sets of literals that are part of at least one of some sets.

    A set of k literals weighs ``factor`` to the power of k. By inclusion and exclusion, one set at a time: those within
    the first, and those within any other, less those within the first and another.

    Args:
        parts: Sets of which none is part of another.
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
    """What is believed about one conjunction.

    Attributes:
        size: n, the number of terms.
        factor: q, by how much a fixed term makes a hypothesis less likely.
        shared: The literals that all positive examples share; None before the first one.
        refuted: The largest parts that negative examples have in these.
    """

    size: int
    factor: float
    shared: Literals | None = None
    refuted: frozenset[Literals] = frozenset()
    weight: float = field(init=False, compare=False)

    def __post_init__(self) -> None:
        everything = (
            (1 + 2 * self.factor) ** self.size  # a term is fixed to 1, to 0, or not at all
            if self.shared is None
            else (1 + self.factor) ** self.shared.bit_count()
        )
        object.__setattr__(self, "weight", everything - union_weight(self.refuted, self.factor))

    @classmethod
    def of(cls, size: int, factor: float, positives: Iterable[int], negatives: Iterable[int]) -> Concept:
        """The belief after some examples, given as the terms that held in them."""
        shared: Literals | None = None
        for terms in positives:
            literals = literals_of(terms, size)
            shared = literals if shared is None else shared & literals
        parts = (literals_of(terms, size) & (-1 if shared is None else shared) for terms in negatives)
        return cls(size, factor, shared, largest(parts))

    @property
    def consistent(self) -> bool:
        """Whether some conjunction agrees with all examples."""
        return self.shared is None or self.shared not in self.refuted

    def covers(self, terms: int) -> bool:
        """Whether every surviving hypothesis covers these terms: all that positive examples share is there."""
        return self.shared is not None and not self.shared & ~literals_of(terms, self.size)

    def probability(self, terms: int) -> float:
        """How likely the concept holds where exactly these terms do."""
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
        """The simplest hypotheses that survive: the fewest literals that hit everything that was refuted.

        While there are no negative examples these are all single literals. That nothing at all is needed is believed
        only when nothing else is left, since most actions fail somewhere. Before the first positive example there are
        none.
        """
        if self.shared is None or not self.consistent:
            return ()
        choices = [1 << bit for bit in range(2 * self.size) if self.shared >> bit & 1]
        for count in range(1, len(choices) + 1):
            sets = (sum(chosen) for chosen in combinations(choices, count))
            found = tuple(chosen for chosen in sets if all(chosen & ~part for part in self.refuted))
            if found:
                return found
        return (0,)

    def disagreement(self, terms: int) -> float:
        """How evenly the simplest hypotheses disagree about these terms: 1 is half against half, 0 is agreement."""
        if not self.simplest:
            return 0.0
        literals = literals_of(terms, self.size)
        share = sum(not hypothesis & ~literals for hypothesis in self.simplest) / len(self.simplest)
        return 4 * share * (1 - share)
