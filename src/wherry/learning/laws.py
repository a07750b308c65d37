"""Laws: an effect with the conjunctions of terms under which it is estimated to happen."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from wherry.learning.concepts import Concept
from wherry.oomdp.effects import Effect


@dataclass(frozen=True)
class Law:
    """An effect, and the conjunctions under one of which it happens.

    Attributes:
        effect: The effect.
        concepts: The conjunctions; one, unless no single conjunction agrees with the examples.
    """

    effect: Effect
    concepts: tuple[Concept, ...]

    @classmethod
    def of(cls, effect: Effect, size: int, factor: float, positives: Iterable[int], negatives: Collection[int]) -> Law:
        """Fit a law to examples: every positive one joins the first conjunction that stays consistent with it.

        Args:
            effect: The effect.
            size: n, the number of terms.
            factor: q, prior odds of each literal of a conjunction.
            positives: Terms that held where the effect happened, as bits.
            negatives: Terms that held where it did not, as bits.
        """
        groups: list[list[int]] = []
        for terms in positives:
            for group in groups:
                if Concept.of(size, factor, (*group, terms), negatives).is_consistent:
                    group.append(terms)
                    break
            else:
                groups.append([terms])
        return cls(effect, tuple(Concept.of(size, factor, group, negatives) for group in groups))

    def probability(self, terms: int) -> float:
        """Return the probability that the effect happens where exactly these terms hold."""
        return 1 - math.prod(1 - concept.probability(terms) for concept in self.concepts)

    def disagreement(self, terms: int) -> float:
        """Return how evenly the simplest explanations disagree whether it happens: 1 is half against half."""
        return max(concept.disagreement(terms) for concept in self.concepts)


class Examples(NamedTuple):
    """The examples of an effect, separated from those that contradict others. Terms are bits.

    Attributes:
        positives: Terms under which the effect happened at least as often as not.
        negatives: Terms under which it did not happen.
        contradictory: Terms under which it happened at one time and not at another.
        slips: Terms under which it once did not happen although all else says that it should; left out of the others.
    """

    positives: list[int]
    negatives: list[int]
    contradictory: list[int]
    slips: list[int]

    @classmethod
    def of(cls, happened: Mapping[int, int], failed: Mapping[int, int], size: int, factor: float) -> Examples:
        """Sort the examples of an effect.

        Robots slip. Under one condition the more frequent result counts, and a single failure that no conjunction
        explains does not count until it happens again.

        Args:
            happened: Number of times that the effect happened, by terms.
            failed: Number of times that it did not, by terms.
            size: n, the number of terms.
            factor: q, prior odds of each literal of a conjunction.
        """
        positives = [terms for terms, times in happened.items() if times >= failed.get(terms, 0)]
        negatives = [terms for terms, times in failed.items() if times > happened.get(terms, 0)]
        if not positives:
            return cls([], negatives, [], [])
        merged = Concept.of(size, factor, positives, ())
        slips = {terms for terms in negatives if failed[terms] == 1 and merged.covers(terms)}
        firm = [terms for terms in negatives if terms not in slips]
        return cls(positives, firm, list(happened.keys() & failed.keys()), list(slips))
