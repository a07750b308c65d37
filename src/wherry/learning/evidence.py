"""The examples of what an action did to an attribute, counted by the terms that held."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from wherry.oomdp.attributes import Value
from wherry.oomdp.effects import Effect

ASSIGNMENT = "assignment"
MAX_VALUES = 2  # different unchanged values kept for one condition; more distinguish no further effects


@dataclass
class Evidence:
    """All examples of one action and attribute.

    Attributes:
        effects: Number of changes that each effect explains, by effect type, effect, and the terms that held (bits).
        unchanged: Number of times that the attribute kept its value, by the terms that held (bits) and the value.
    """

    effects: dict[str, dict[Effect, dict[int, int]]] = field(default_factory=dict)
    unchanged: dict[int, dict[Value, int]] = field(default_factory=dict)

    def add(self, terms: int, before: Value, after: Value, effects: Iterable[Effect]) -> None:
        """Add one example.

        Args:
            terms: Terms that held, as bits.
            before: Value before the action.
            after: Value after the action.
            effects: Effects that explain the change.
        """
        if before == after:
            values = self.unchanged.setdefault(terms, {})
            value = before if before in values or len(values) < MAX_VALUES else next(iter(values))
            values[value] = values.get(value, 0) + 1
        else:
            for effect in effects:
                seen = self.effects.setdefault(effect.type, {}).setdefault(effect, {})
                seen[terms] = seen.get(terms, 0) + 1

    def has_example(self, terms: int) -> bool:
        """Return whether there is an example where exactly these terms held: another would teach no more."""
        return terms in self.unchanged or any(
            terms in seen for effects in self.effects.values() for seen in effects.values()
        )

    def simplest_type(self) -> str | None:
        """Return the effect type that explains the most changes with the fewest effects; of equals the first."""

        def rank(name: str) -> tuple[int, int]:
            explained = sum(sum(seen.values()) for seen in self.effects[name].values())
            return -explained, len(self.effects[name])

        return min(self.effects, key=rank, default=None)

    def examples(self, effect: Effect) -> tuple[dict[int, int], dict[int, int]]:
        """Return how often an effect happened, and how often it did not, by the terms that held.

        An assignment of the value that an attribute kept is neither.
        """
        happened = self.effects[effect.type][effect]
        failed: dict[int, int] = {}
        for terms, values in self.unchanged.items():
            times = sum(times for value, times in values.items() if effect != Effect(ASSIGNMENT, value))
            if times:
                failed[terms] = times
        for other, seen in self.effects[effect.type].items():
            if other != effect:
                for terms, times in seen.items():
                    failed[terms] = failed.get(terms, 0) + times
        return happened, failed
