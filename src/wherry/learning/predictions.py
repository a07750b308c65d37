"""What DOORMAX knows: predictions p, sets pred(a, att, type) of them, and failure conditions F (paper, section 4)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from wherry.oomdp.conditions import Condition
from wherry.oomdp.domain import Domain
from wherry.oomdp.effects import Effect, EffectType
from wherry.oomdp.objects import EXISTS


class Subject(NamedTuple):
    """What a prediction is about: (a, att).

    Attributes:
        action: The action's name.
        class_name: The class whose objects have the attribute.
        attribute: The attribute's name.
    """

    action: str
    class_name: str
    attribute: str

    def __str__(self) -> str:
        return f"{self.action}, {self.class_name.lower()}.{self.attribute}"


class Rule(NamedTuple):
    """A prediction p of the paper.

    Attributes:
        model: p.model, the terms that need to hold.
        effect: p.effect, what happens then.
    """

    model: Condition
    effect: Effect


@dataclass
class Predictions:
    """P: all predictions, and which effect types were found wrong.

    Attributes:
        domain: What is predicted.
        effect_types: The effect types by name.
        rules: pred(a, att, type) for every type that is alive.
        removed: Why the other types were removed; a removed type stays removed.
    """

    domain: Domain
    effect_types: Mapping[str, EffectType]
    rules: dict[Subject, dict[str, tuple[Rule, ...]]] = field(init=False)
    removed: dict[Subject, dict[str, str]] = field(init=False)

    def __post_init__(self) -> None:
        self.rules = {
            Subject(action, item.name, attribute.name): {
                name: () for name, effect_type in self.effect_types.items() if attribute.kind in effect_type.kinds
            }
            for action in self.domain.actions
            for item in self.domain.classes
            if not item.static
            for attribute in item.changeable
        }
        self.removed = {subject: {} for subject in self.rules}

    def alive(self, subject: Subject) -> bool:
        """Whether some effect type may still explain the attribute."""
        return bool(self.rules[subject])

    def find(self, subject: Subject, effect: Effect) -> Rule | None:
        """The prediction p ∈ pred(a, att, e.type) with p.effect = e."""
        return next((rule for rule in self.rules[subject][effect.type] if rule.effect == effect), None)

    def put(self, subject: Subject, rule: Rule) -> None:
        """Add a prediction, or put it in the place of the one with the same effect."""
        others = self.others(subject, rule.effect)
        self.rules[subject][rule.effect.type] = (*others, rule)

    def others(self, subject: Subject, effect: Effect) -> tuple[Rule, ...]:
        """The predictions of an effect's type that predict other effects."""
        return tuple(rule for rule in self.rules[subject][effect.type] if rule.effect != effect)

    def remove(self, subject: Subject, effect_type: str, reason: str) -> None:
        """Remove pred(a, att, type) from P for good."""
        del self.rules[subject][effect_type]
        self.removed[subject][effect_type] = reason

    def covering(self, subject: Subject, terms: int) -> Iterator[Rule]:
        """The predictions whose model covers cond(s), given as bits."""
        for rules in self.rules[subject].values():
            for rule in rules:
                if rule.model.covers_terms(terms):
                    yield rule

    def words(self, subject: Subject, effect: Effect) -> str:
        """An effect in words: ``taxi.y += 1``."""
        name = f"{subject.class_name.lower()}.{subject.attribute}"
        return self.effect_types[effect.type].words(name, effect.argument)

    def keeps(self, subject: Subject, rule: Rule) -> bool:
        """Whether a rule says no more than that the attribute stays as it is: += 0, *= 1, or := what it is anyway."""
        match rule.effect.type:
            case "increment":
                return rule.effect.argument == 0
            case "multiplication":
                return rule.effect.argument == 1
        if subject.attribute == EXISTS:
            return rule.effect.argument is True
        own = f"{subject.class_name.lower()}.{subject.attribute}"
        names = self.domain.term_names
        bit = 1 << names.index(own) if own in names else 0
        return bool(rule.model.mask & bit) and bool(rule.model.value & bit) == rule.effect.argument
