"""The examples of an action's effects on an attribute, counted by the terms that held."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from wherry.oomdp.attributes import Value
from wherry.oomdp.effects import Effect

ASSIGNMENT = "assignment"
MAX_VALUES = 2  # different unchanged values stored for one condition: two already contradict every assignment


@dataclass
class Evidence:
    """All examples of one action and attribute.

    Attributes:
        effects: Number of changes that an effect explains, by effect type, effect, and terms that held (bits).
        unchanged: Number of examples in which the attribute kept its value, by terms that held (bits) and value.
    """

    effects: dict[str, dict[Effect, dict[int, int]]] = field(default_factory=dict)
    unchanged: dict[int, dict[Value, int]] = field(default_factory=dict)

    def add(self, terms: int, before: Value, after: Value, effects: Iterable[Effect]) -> None:
        """Add one example.

        Args:
            terms: Terms that held, as bits.
            before: Value before the action.
            after: Value after the action.
            effects: Effects that turn the first value into the second, at most one of each type.
        """
        if before == after:
            values = self.unchanged.setdefault(terms, {})
            value = before if before in values or len(values) < MAX_VALUES else next(iter(values))
            values[value] = values.get(value, 0) + 1
        else:
            for effect in effects:
                counts = self.effects.setdefault(effect.type, {}).setdefault(effect, {})
                counts[terms] = counts.get(terms, 0) + 1

    def has_example(self, terms: int) -> bool:
        """Return whether there is an example in which exactly these terms held."""
        return terms in self.unchanged or any(
            terms in counts for effects in self.effects.values() for counts in effects.values()
        )

    def simplest_type(self) -> str | None:
        """Return the effect type that explains the most changes, and of these the one with the fewest effects.

        Among equals it is the first one observed; None where nothing has changed yet.
        """

        def rank(name: str) -> tuple[int, int]:
            explained = sum(sum(counts.values()) for counts in self.effects[name].values())
            return -explained, len(self.effects[name])

        return min(self.effects, key=rank, default=None)

    def examples(self, effect: Effect) -> tuple[dict[int, int], dict[int, int]]:
        """Return how often an effect happened and how often it did not, each by the terms that held.

        An example in which the attribute kept the value that an assignment assigns counts as neither.
        """
        happened = self.effects[effect.type][effect]
        failed: dict[int, int] = {}
        for terms, values in self.unchanged.items():
            count = sum(count for value, count in values.items() if effect != Effect(ASSIGNMENT, value))
            if count:
                failed[terms] = count
        for other, counts in self.effects[effect.type].items():
            if other != effect:
                for terms, count in counts.items():
                    failed[terms] = failed.get(terms, 0) + count
        return happened, failed
