"""The posterior over conjunctions of terms, given examples of where a conjunction held and where it did not.

Every conjunction h ∈ {0, 1, *}ⁿ is a hypothesis. Its prior is proportional to q to the power of the number of its fixed
terms, so that short conjunctions are preferred (Occam's razor). A positive example rules out all hypotheses that do
not cover it, a negative example those that do. The probability that the conjunction holds under another condition is
the weight of the remaining hypotheses that cover the condition, divided by the weight of all remaining ones.

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
    """Return the set of all literals that are true under a condition.

    Args:
        terms: Terms that hold, as bits.
        size: n, the number of terms.
    """
    return terms | (~terms & (1 << size) - 1) << size


def condition_of(literals: Literals, size: int) -> Condition:
    """Return a set of literals as a condition."""
    value, negated = literals & (1 << size) - 1, literals >> size
    return Condition(size, value | negated, value)


def maximal_sets(sets: Iterable[Literals]) -> frozenset[Literals]:
    """Return the sets that are not contained in another one."""
    kept: list[Literals] = []
    for candidate in sorted(set(sets), key=int.bit_count, reverse=True):
        if all(candidate & ~other for other in kept):
            kept.append(candidate)
    return frozenset(kept)


@lru_cache(maxsize=100_000)
def union_weight(maximal: frozenset[Literals], literal_odds: float) -> float:
    """Return the weight of the subsets of some sets of literals, each subset counted once.

    A set of k literals weighs qᵏ, so all subsets of a set of k literals weigh (1 + q)ᵏ together. By inclusion and
    exclusion the union weighs: the subsets of the first set, plus the union of all others, minus the union of the
    intersections of the first with each other one. Literals that all sets share are taken out as a factor beforehand.

    Args:
        maximal: Sets of which none is contained in another.
        literal_odds: q, the weight of one literal.
    """
    if not maximal:
        return 0.0
    shared = ~0
    for literals in maximal:
        shared &= literals
    weight = (1 + literal_odds) ** shared.bit_count()
    if len(maximal) == 1:
        return weight
    first, *others = sorted(literals & ~shared for literals in maximal)
    return weight * (
        (1 + literal_odds) ** first.bit_count()
        + union_weight(frozenset(others), literal_odds)
        - union_weight(maximal_sets(first & other for other in others), literal_odds)
    )


@dataclass(frozen=True)
class ConjunctionPosterior:
    """The posterior over one conjunction.

    Attributes:
        size: n, the number of terms.
        literal_odds: q, prior odds that the conjunction contains a literal.
        shared: Literals that all positive examples share; None before the first one.
        refuted: Maximal intersections of the shared literals with negative examples.
        weight: Weight of all hypotheses that no example rules out.
    """

    size: int
    literal_odds: float
    shared: Literals | None = None
    refuted: frozenset[Literals] = frozenset()
    weight: float = field(init=False, compare=False)

    def __post_init__(self) -> None:
        prior_weight = (
            (1 + 2 * self.literal_odds) ** self.size  # each term is fixed to 1, to 0, or not at all
            if self.shared is None
            else (1 + self.literal_odds) ** self.shared.bit_count()
        )
        object.__setattr__(self, "weight", prior_weight - union_weight(self.refuted, self.literal_odds))

    @classmethod
    def of(
        cls, size: int, literal_odds: float, positives: Iterable[int], negatives: Iterable[int]
    ) -> ConjunctionPosterior:
        """Return the posterior given some examples.

        Args:
            size: n, the number of terms.
            literal_odds: q, prior odds that the conjunction contains a literal.
            positives: Terms that held where the conjunction held, as bits.
            negatives: Terms that held where it did not, as bits.
        """
        shared: Literals | None = None
        for terms in positives:
            literals = literals_of(terms, size)
            shared = literals if shared is None else shared & literals
        refuted = (literals_of(terms, size) & (-1 if shared is None else shared) for terms in negatives)
        return cls(size, literal_odds, shared, maximal_sets(refuted))

    @property
    def is_consistent(self) -> bool:
        """Whether some conjunction agrees with all examples."""
        return self.shared is None or self.shared not in self.refuted

    def covers(self, terms: int) -> bool:
        """Return whether all remaining hypotheses cover a condition, given as bits.

        They do where all literals that the positive examples share are true.
        """
        return self.shared is not None and not self.shared & ~literals_of(terms, self.size)

    def probability(self, terms: int) -> float:
        """Return the probability that the conjunction holds where exactly these terms hold."""
        literals = literals_of(terms, self.size)
        if self.shared is not None:
            literals &= self.shared
        refuted = maximal_sets(negative & literals for negative in self.refuted)
        if literals in refuted:
            return 0.0
        covering = (1 + self.literal_odds) ** literals.bit_count() - union_weight(refuted, self.literal_odds)
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
            remaining = tuple(chosen for chosen in sets if all(chosen & ~negative for negative in self.refuted))
            if remaining:
                return remaining
        return (0,)

    def disagreement(self, terms: int) -> float:
        """Return how evenly the simplest hypotheses disagree about a condition: 4 p (1 − p) where a share p covers it.

        That is 1 where half of them cover the condition, and 0 where they agree.
        """
        if not self.simplest:
            return 0.0
        literals = literals_of(terms, self.size)
        share = sum(not hypothesis & ~literals for hypothesis in self.simplest) / len(self.simplest)
        return 4 * share * (1 - share)
