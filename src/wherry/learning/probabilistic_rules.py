"""Rules with a probability: an effect, and the posterior over the condition under which it happens."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from wherry.learning.conjunctions import ConjunctionPosterior
from wherry.oomdp.effects import Effect


@dataclass(frozen=True)
class ProbabilisticRule:
    """An effect that happens where at least one of some conjunctions holds (a condition in disjunctive normal form).

    Attributes:
        effect: The effect.
        conjunctions: Posteriors over the conjunctions; one, unless no single conjunction agrees with the examples.
    """

    effect: Effect
    conjunctions: tuple[ConjunctionPosterior, ...]

    @classmethod
    def of(
        cls, effect: Effect, size: int, literal_odds: float, positives: Iterable[int], negatives: Collection[int]
    ) -> ProbabilisticRule:
        """Fit a rule to examples: every positive one joins the first conjunction that stays consistent with it.

        Args:
            effect: The effect.
            size: n, the number of terms.
            literal_odds: q, prior odds that a conjunction contains a literal.
            positives: Terms that held where the effect happened, as bits.
            negatives: Terms that held where it did not, as bits.
        """
        groups: list[list[int]] = []
        for terms in positives:
            for group in groups:
                if ConjunctionPosterior.of(size, literal_odds, (*group, terms), negatives).is_consistent:
                    group.append(terms)
                    break
            else:
                groups.append([terms])
        return cls(effect, tuple(ConjunctionPosterior.of(size, literal_odds, group, negatives) for group in groups))

    def probability(self, terms: int) -> float:
        """Return the probability that the effect happens where exactly these terms hold."""
        return 1 - math.prod(1 - conjunction.probability(terms) for conjunction in self.conjunctions)

    def disagreement(self, terms: int) -> float:
        """Return how evenly the simplest conjunctions disagree whether it happens: 1 is half against half."""
        return max(conjunction.disagreement(terms) for conjunction in self.conjunctions)


class LabelledExamples(NamedTuple):
    """The examples of an effect as positive and negative ones, without outliers. Terms are bits.

    Attributes:
        positives: Terms under which the effect happened at least as often as not.
        negatives: Terms under which it failed more often than it happened.
        contradictory: Terms under which it happened at one time and not at another.
        outliers: Terms under which it failed a single time although every conjunction consistent with the positive
            examples covers them; not among the negatives.
    """

    positives: list[int]
    negatives: list[int]
    contradictory: list[int]
    outliers: list[int]

    @classmethod
    def of(
        cls, happened: Mapping[int, int], failed: Mapping[int, int], size: int, literal_odds: float
    ) -> LabelledExamples:
        """Label the examples of an effect.

        Actuators fail at times. Under one condition the more frequent result is the label, and a single failure that no
        conjunction explains is an outlier until it happens again.

        Args:
            happened: Number of times that the effect happened, by terms.
            failed: Number of times that it did not, by terms.
            size: n, the number of terms.
            literal_odds: q, prior odds that a conjunction contains a literal.
        """
        positives = [terms for terms, count in happened.items() if count >= failed.get(terms, 0)]
        negatives = [terms for terms, count in failed.items() if count > happened.get(terms, 0)]
        if not positives:
            return cls([], negatives, [], [])
        merged = ConjunctionPosterior.of(size, literal_odds, positives, ())
        outliers = {terms for terms in negatives if failed[terms] == 1 and merged.covers(terms)}
        inliers = [terms for terms in negatives if terms not in outliers]
        return cls(positives, inliers, list(happened.keys() & failed.keys()), list(outliers))
