"""The codec of a learner for rules files, and the checks against the domain that all codecs use in decoding."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

from wherry.documents import Document
from wherry.errors import InputError
from wherry.learning.effect_rules import Subject
from wherry.learning.rewards import Rewards
from wherry.learning.rule_files.entries import DomainSchema, EffectArgument, RewardEntry, effect_of
from wherry.learning.rules import RuleLearner
from wherry.oomdp.conditions import Condition
from wherry.oomdp.domain import Domain
from wherry.oomdp.effects import Effect, EffectType
from wherry.oomdp.effects_outcome import GivenTask, StepReward

LearnerT = TypeVar("LearnerT", bound=RuleLearner)
KnowledgeT = TypeVar("KnowledgeT", bound=Document)


@dataclass(frozen=True, slots=True)
class RuleCodec(Generic[LearnerT, KnowledgeT]):
    """Converts the knowledge of one type of learner into a part of a rules file, and back.

    Attributes:
        learner: Type of the learner.
        knowledge: Type of the file's part; its field ``learner`` names the learner.
        encode: Returns a learner's knowledge.
        decode: Makes a learner with the knowledge in a file; raises InputError where the domain does not admit it.
    """

    learner: type[LearnerT]
    knowledge: type[KnowledgeT]
    encode: Callable[[LearnerT], KnowledgeT]
    decode: Callable[[KnowledgeT, KnowledgeReader], LearnerT]


class KnowledgeReader:
    """Decodes names, conditions and rewards of a rules file and checks that they are valid in the domain.

    All methods that decode raise InputError, which names the file and the field, where a value is not valid.

    Args:
        source: Path of the file, for errors.
        domain: Domain of the learner that is made.
        effect_types: Effect types that the file may name.
        task: Reward and termination functions that are given.
    """

    def __init__(self, source: str, domain: Domain, effect_types: Mapping[str, EffectType], task: GivenTask) -> None:
        self.source = source
        self.domain = domain
        self.task = task
        self._effect_types = effect_types

    def refusal(self, field: str, reason: str) -> InputError:
        """Return the error for a field of the file that cannot be used."""
        return InputError(self.source, field, reason)

    def check_schema(self, schema: DomainSchema) -> None:
        """Refuse rules of another domain.

        Raises:
            InputError: The file's schema is not the domain's.
        """
        own_schema = DomainSchema.of(self.domain)
        for field in ("name", "classes", "terms", "actions"):
            if getattr(schema, field) != getattr(own_schema, field):
                raise self.refusal(f"domain.{field}", f"these are rules for another domain than {own_schema.name}")

    def effect_types(self, names: list[str]) -> Mapping[str, EffectType]:
        """Return the effect types with some names."""
        if unknown := [name for name in names if name not in self._effect_types]:
            raise self.refusal("knowledge.effect_types", f"{unknown[0]!r} is no effect type")
        return {name: self._effect_types[name] for name in names}

    def effect(self, effect_type: str, argument: EffectArgument, field: str) -> Effect:
        """Return an effect after checking that its type can have the argument."""
        effect = effect_of(effect_type, argument)
        try:
            self._effect_types[effect_type].describe("", effect.argument)
        except TypeError:
            raise self.refusal(field, f"{argument!r} is no argument of an {effect_type}") from None
        return effect

    def action(self, name: str, field: str) -> str:
        """Return a name after checking that it is an action of the domain."""
        if name not in self.domain.actions:
            raise self.refusal(field, f"{name!r} is no action of {self.domain.name}")
        return name

    def subject(self, action: str, attribute: str, field: str) -> Subject:
        """Return the subject of an action and an attribute, given as ``Class.attribute``."""
        class_name, _, name = attribute.partition(".")
        object_class = self.domain.classes_by_name.get(class_name)
        if object_class is None or object_class.static or name not in (item.name for item in object_class.changeable):
            raise self.refusal(field, f"{attribute!r} is no attribute of {self.domain.name}")
        return Subject(self.action(action, field), class_name, name)

    def condition(self, text: str, field: str) -> Condition:
        """Return a condition, given as text over 0, 1 and *."""
        if len(text) != self.domain.size:
            raise self.refusal(field, f"{text!r} does not have {self.domain.size} characters")
        return Condition.parse(text)

    def terms(self, text: str, field: str) -> int:
        """Return the terms that hold under a condition without *, as bits."""
        return self.condition(text, field).value

    def add_rewards(self, rewards: Rewards, entries: list[RewardEntry]) -> None:
        """Add the rewards of a file to those of a learner."""
        for index, entry in enumerate(entries):
            field = f"knowledge.rewards.{index}"
            subjects = [self.subject(entry.action, name, field) for name in entry.changed]
            changed = frozenset((subject.class_name, subject.attribute) for subject in subjects)
            for text, (reward, terminated) in entry.worth.items():
                rewards.add(entry.action, self.terms(text, field), StepReward(changed, reward, terminated))
