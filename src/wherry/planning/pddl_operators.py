"""Operators from predictions: minimal sets of literals, and of objects, that determine where an effect happens."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

Changes = tuple[tuple[str, str], ...]
"""The objects that change in a step, each with the name of its change."""

Example = tuple[Mapping[str, str], bool]
"""The values that objects have, by the objects' names, and whether a fact holds with them."""

Valuation = tuple[list[str], list[tuple[str, ...]]]
"""Names of objects, and the combinations of their values with which a fact holds."""


class StateLiteral(NamedTuple):
    """A literal that an operator can ask for: a term holds, or an object is present.

    Attributes:
        term: Index of the term in the domain; None for an object's presence.
        this: Name of the object that the term is about; None for the state as a whole.
    """

    term: int | None
    this: str | None


class StepEffect(NamedTuple):
    """The effect of a step, the same for all steps that make the same changes.

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
        by_literals: The effect that was predicted where exactly some literals (bits) hold; None for no effect.
    """

    by_literals: dict[int, StepEffect | None] = field(default_factory=dict)

    def add(self, literals: int, effect: StepEffect | None) -> None:
        """Add a prediction; None (a step out of bounds, for one) does not contradict an effect.

        Raises:
            ValueError: Another effect was predicted where the same literals hold.
        """
        known = self.by_literals.get(literals)
        if known is not None and effect not in {None, known}:
            raise ValueError("what is predicted depends on more than the domain's terms")
        self.by_literals[literals] = known or effect

    def operators(self, size: int) -> Iterable[tuple[StepEffect, int, int]]:
        """Each effect with its preconditions as a mask and a value of literals; disjunctions give several operators.

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
    """A minimal mask under which one example differs from all negative ones; later literals are dropped first."""
    mask = (1 << size) - 1
    for index in reversed(range(size)):
        smaller = mask & ~(1 << index)
        if all((literals ^ negative) & smaller for negative in negatives):
            mask = smaller
    return mask


def fewest_objects(candidates: Sequence[str], examples: Sequence[Example]) -> Valuation:
    """A minimal set of objects whose values determine a fact, and the values with which it holds.

    Args:
        candidates: All objects; those in front are dropped first.
        examples: At least one. The objects returned are in the order of the first example.
    """
    needed = list(examples[0][0])
    for name in candidates:
        fewer = [other for other in needed if other != name]
        if determine(fewer, examples):
            needed = fewer
    return needed, list({tuple(values[name] for name in needed): None for values, holds in examples if holds})


def determine(names: Sequence[str], examples: Sequence[Example]) -> bool:
    """Whether the values of some objects determine a fact."""
    known: dict[tuple[str, ...], bool] = {}
    return all(known.setdefault(tuple(values[name] for name in names), holds) == holds for values, holds in examples)
