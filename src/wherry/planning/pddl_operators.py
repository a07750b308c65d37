"""Minimal sets of literals that determine an effect, and minimal sets of objects whose values determine a fact."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

Changes = tuple[tuple[str, str], ...]
"""The names of the objects that change in a step, each with the name of its change."""

Example = tuple[Mapping[str, str], bool]
"""An observation of a fact: the names of the objects' values, by object name, and whether the fact holds."""


class FactTable(NamedTuple):
    """A fact as a table over the values of the objects that determine it.

    Attributes:
        objects: Names of the objects.
        rows: Combinations of value names, one for each object, with which the fact holds.
    """

    objects: list[str]
    rows: list[tuple[str, ...]]


class StateLiteral(NamedTuple):
    """A literal that can be a precondition: a term holds, or an object is present.

    Attributes:
        term: Index of the term in the domain; None if the literal is the presence of an object.
        this: Name of the object to which the term refers; None for the state as a whole.
    """

    term: int | None
    this: str | None


class StepEffect(NamedTuple):
    """The effect of a step; steps with the same changes have equal effects.

    Attributes:
        changes: The objects that change, with the names of their changes.
        reaches_goal: Whether the step reaches the goal.
    """

    changes: Changes
    reaches_goal: bool


@dataclass
class ActionEffects:
    """The predicted effects of one action.

    Attributes:
        by_literals: Predicted effect by the set of literals that hold, as bits; None for no effect.
    """

    by_literals: dict[int, StepEffect | None] = field(default_factory=dict)

    def add(self, literals: int, effect: StepEffect | None) -> None:
        """Add a prediction; no effect (None, such as for a step out of bounds) does not contradict an effect.

        Raises:
            ValueError: Another effect was predicted where the same literals hold.
        """
        known = self.by_literals.get(literals)
        if known is not None and effect not in {None, known}:
            raise ValueError("predictions depend on more than the domain's terms")
        self.by_literals[literals] = known or effect

    def operators(self, size: int) -> Iterator[tuple[StepEffect, int, int]]:
        """Yield each effect with its preconditions, as mask and value of literals; several times for a disjunction.

        Args:
            size: Number of literals.
        """
        for effect in dict.fromkeys(effect for effect in self.by_literals.values() if effect is not None):
            negatives = [literals for literals, other in self.by_literals.items() if other != effect]
            positives = [literals for literals, other in self.by_literals.items() if other == effect]
            while positives:
                mask = _smallest_mask(positives[0], negatives, size)
                yield effect, mask, positives[0] & mask
                positives = [literals for literals in positives if (literals ^ positives[0]) & mask]


def _smallest_mask(literals: int, negatives: Sequence[int], size: int) -> int:
    """A minimal mask under which an example differs from all negative ones; later literals are dropped first."""
    mask = (1 << size) - 1
    for index in reversed(range(size)):
        smaller = mask & ~(1 << index)
        if all((literals ^ negative) & smaller for negative in negatives):
            mask = smaller
    return mask


def minimal_objects(candidates: Sequence[str], examples: Sequence[Example]) -> FactTable:
    """A minimal set of objects whose values determine a fact, and the values with which it holds.

    Args:
        candidates: Names of all objects; the first ones are dropped first.
        examples: At least one example; the returned objects are in the order of the first.
    """
    needed = list(examples[0][0])
    for name in candidates:
        fewer = [other for other in needed if other != name]
        if values_determine(fewer, examples):
            needed = fewer
    return FactTable(
        needed, list({tuple(values[name] for name in needed): None for values, holds in examples if holds})
    )


def values_determine(names: Sequence[str], examples: Sequence[Example]) -> bool:
    """Whether the values of some objects determine a fact."""
    known: dict[tuple[str, ...], bool] = {}
    return all(known.setdefault(tuple(values[name] for name in names), holds) == holds for values, holds in examples)
