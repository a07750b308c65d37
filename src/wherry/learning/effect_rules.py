"""DOORMAX's sets pred(a, att, type) of rules, which pair an effect with a condition (paper, section 4).

The paper calls these pairs predictions p, with p.effect and p.model. They are called rules here, because
`wherry.oomdp.mdp.Prediction` stands for the predicted outcomes of an action in a state.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from wherry.oomdp.attributes import EXISTS
from wherry.oomdp.conditions import Condition
from wherry.oomdp.domain import Domain
from wherry.oomdp.effects import Effect, EffectType

OVERLAP = "the conditions of two effects overlap"


class Subject(NamedTuple):
    """The subject of a rule: an action and an attribute, (a, att).

    Attributes:
        action: Name of the action.
        class_name: Name of the class whose objects have the attribute.
        attribute: Name of the attribute.
    """

    action: str
    class_name: str
    attribute: str

    def __str__(self) -> str:
        return f"{self.action}, {self.class_name.lower()}.{self.attribute}"


@dataclass
class EffectRules:
    """P: all rules, and the effect types that were removed.

    No two rules of a set pred(a, att, type) have the same effect (assumption A2), so a set is kept as conditions by
    effects.

    Attributes:
        domain: Domain that the rules are about.
        effect_types: Effect types by name.
        max_effects: k, largest number of different effects of one type.
        models: Conditions p.model of the rules by subject, effect type and p.effect; only of types not removed.
        removed: Reason of each removal, by subject and effect type; a removed type stays removed.
        subjects: All subjects of an action and a class, existence before all others.
    """

    domain: Domain
    effect_types: Mapping[str, EffectType]
    max_effects: int
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
                    self.reset(Subject(action, item.name, attribute.name))

    def reset(self, subject: Subject) -> None:
        """Forget all rules of a subject and restore all effect types that apply to the attribute."""
        attribute = self.domain.classes_by_name[subject.class_name].attribute(subject.attribute)
        self.models[subject] = {
            name: {} for name, effect_type in self.effect_types.items() if attribute.kind in effect_type.kinds
        }
        self.removed[subject] = {}

    def has_effect_type(self, subject: Subject) -> bool:
        """Return whether some effect type of the subject is not removed."""
        return bool(self.models[subject])

    def remove(self, subject: Subject, effect_type: str, reason: str) -> None:
        """Remove pred(a, att, type) from P permanently."""
        del self.models[subject][effect_type]
        self.removed[subject][effect_type] = reason

    def effects(self, subject: Subject, terms: int) -> tuple[Effect, ...]:
        """Return the effects of all rules whose condition covers cond(s), given as bits."""
        return tuple(
            [
                effect
                for models in self.models[subject].values()
                for effect, model in models.items()
                if not (model.value ^ terms) & model.mask
            ]
        )

    def add(self, subject: Subject, condition: Condition, effect: Effect) -> bool:
        """Algorithm 2, lines 8 to 27: add the effect observed under a condition; return whether any rule changed."""
        models = self.models[subject][effect.type]
        before = models.get(effect)  # line 8
        if before is not None and before.covers(condition):
            return False
        others = [model for other, model in models.items() if other != effect]
        if before is not None:  # line 9
            merged = models[effect] = before.merge(condition)  # line 11
            if any(merged.covers(other) for other in others):  # line 12
                self.remove(subject, effect.type, OVERLAP)  # line 14
        elif any(condition.covers(other) or other.covers(condition) for other in others):  # line 18
            self.remove(subject, effect.type, OVERLAP)  # line 19
        else:
            models[effect] = condition  # line 21
            if len(models) > self.max_effects:  # line 23
                self.remove(subject, effect.type, f"more than {self.max_effects} different effects")  # line 24
        return True

    def refute(self, subject: Subject, terms: int, effects: tuple[Effect, ...], *, has_changed: bool) -> bool:
        """Remove the types whose prediction was wrong, and those that cannot explain the change.

        The paper lacks this step. Without it a wrong type whose conditions never overlap contradicts the true one
        permanently.

        Args:
            subject: The action and the attribute.
            terms: Terms that held, as bits.
            effects: Effects that explain the observation.
            has_changed: Whether the attribute changed.

        Returns:
            Whether a type was removed.
        """
        wrong = [effect.type for effect in self.effects(subject, terms) if effect not in effects]
        for effect_type in dict.fromkeys(wrong):
            self.remove(subject, effect_type, "predicted what was not observed")
        if not has_changed:
            return bool(wrong)
        possible = {effect.type for effect in effects}
        impossible = [name for name in self.models[subject] if name not in possible]
        for effect_type in impossible:
            self.remove(subject, effect_type, "cannot explain a change")
        return bool(wrong or impossible)

    def keep_simplest_types(self) -> None:
        """Keep for every subject only the type with the fewest effects (at least one), of equals the first."""
        for subject, types in self.models.items():
            ranked = sorted((name for name in types if types[name]), key=lambda name: len(types[name]))
            for name in ranked[1:]:
                self.remove(subject, name, f"needs more effects than {ranked[0]}, or as many")

    def describe(self, subject: Subject, effect: Effect) -> str:
        """Return an effect in words: ``taxi.y += 1``."""
        name = f"{subject.class_name.lower()}.{subject.attribute}"
        return self.effect_types[effect.type].describe(name, effect.argument)

    def is_identity(self, subject: Subject, effect: Effect, model: Condition) -> bool:
        """Return whether a rule only says that the attribute keeps its value: += 0, *= 1, or := its own value.

        Args:
            subject: The action and the attribute.
            effect: Effect of the rule.
            model: Condition of the rule; it may contain a term that states the attribute's value.
        """
        match effect.type:
            case "increment":
                return effect.argument == 0
            case "multiplication":
                return effect.argument == 1
        if subject.attribute == EXISTS:
            return effect.argument is True
        value_term = f"{subject.class_name.lower()}.{subject.attribute}"
        names = self.domain.term_names
        bit = 1 << names.index(value_term) if value_term in names else 0
        return bool(model.mask & bit) and bool(model.value & bit) == effect.argument
