"""What DOORMAX knows: predictions p, sets pred(a, att, type) of them, and failure conditions F (paper, section 4)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from wherry.oomdp.attributes import EXISTS
from wherry.oomdp.conditions import Condition
from wherry.oomdp.domain import Domain
from wherry.oomdp.effects import Effect, EffectType


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


@dataclass
class Predictions:
    """P: all predictions, and which effect types were found wrong.

    A prediction p is a pair of p.effect, what happens, and p.model, the terms that need to hold for it. No two
    predictions of a set have the same effect (assumption A2), so a set is kept as the models by their effects.

    Attributes:
        domain: What is predicted.
        effect_types: The effect types by name.
        models: pred(a, att, type), for every type that is alive: p.model by p.effect.
        removed: Why the other types were removed; a removed type stays removed.
        subjects: All subjects of an action and a class, existence before all else.
    """

    domain: Domain
    effect_types: Mapping[str, EffectType]
    models: dict[Subject, dict[str, dict[Effect, Condition]]] = field(init=False)
    removed: dict[Subject, dict[str, str]] = field(init=False)
    subjects: dict[tuple[str, str], tuple[Subject, ...]] = field(init=False)

    def __post_init__(self) -> None:
        classes = [item for item in self.domain.classes if not item.static]
        self.subjects = {
            (action, item.name): tuple(
                Subject(action, item.name, attribute.name) for attribute in reversed(item.changeable)
            )
            for action in self.domain.actions
            for item in classes
        }
        self.models, self.removed = {}, {}
        for action in self.domain.actions:
            for item in classes:
                for attribute in item.changeable:
                    self.begin_anew(Subject(action, item.name, attribute.name))

    def begin_anew(self, subject: Subject) -> None:
        """Know nothing of an attribute: all types that apply to it are alive, without any prediction."""
        attribute = self.domain.classes_by_name[subject.class_name].attribute(subject.attribute)
        self.models[subject] = {
            name: {} for name, effect_type in self.effect_types.items() if attribute.kind in effect_type.kinds
        }
        self.removed[subject] = {}

    def alive(self, subject: Subject) -> bool:
        """Whether some effect type may still explain the attribute."""
        return bool(self.models[subject])

    def remove(self, subject: Subject, effect_type: str, reason: str) -> None:
        """Remove pred(a, att, type) from P for good."""
        del self.models[subject][effect_type]
        self.removed[subject][effect_type] = reason

    def effects(self, subject: Subject, terms: int) -> tuple[Effect, ...]:
        """The effects of all predictions whose model covers cond(s), given as bits."""
        return tuple(
            [
                effect
                for models in self.models[subject].values()
                for effect, model in models.items()
                if not (model.value ^ terms) & model.mask
            ]
        )

    def words(self, subject: Subject, effect: Effect) -> str:
        """An effect in words: ``taxi.y += 1``."""
        name = f"{subject.class_name.lower()}.{subject.attribute}"
        return self.effect_types[effect.type].describe(name, effect.argument)

    def keeps(self, subject: Subject, effect: Effect, model: Condition) -> bool:
        """Whether a prediction says no more than that the attribute stays as it is: += 0, *= 1, or := what it is."""
        match effect.type:
            case "increment":
                return effect.argument == 0
            case "multiplication":
                return effect.argument == 1
        if subject.attribute == EXISTS:
            return effect.argument is True
        own = f"{subject.class_name.lower()}.{subject.attribute}"
        names = self.domain.term_names
        bit = 1 << names.index(own) if own in names else 0
        return bool(model.mask & bit) and bool(model.value & bit) == effect.argument
