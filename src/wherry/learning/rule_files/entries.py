"""The parts of a rules file that all learners share, checked by pydantic."""

from __future__ import annotations

from fractions import Fraction
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from wherry.learning.effect_rules import Subject
from wherry.learning.rewards import Rewards
from wherry.oomdp.conditions import Condition
from wherry.oomdp.domain import Domain
from wherry.oomdp.effects import Effect

MAX_TERMS = 1000  # length of a condition

ConditionText = Annotated[str, StringConstraints(pattern=r"^[01*]+$", max_length=MAX_TERMS)]
FullConditionText = Annotated[str, StringConstraints(pattern=r"^[01]+$", max_length=MAX_TERMS)]
Count = Annotated[int, Field(ge=1)]


class Part(BaseModel):
    """A part of a rules file: no unknown fields, no conversions, no infinities."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, populate_by_name=True)


class DomainSchema(Part):
    """The schema that rules belong to; bounds of attributes and static objects are not part of it."""

    name: str
    classes: dict[str, dict[str, str]]
    terms: list[str]
    actions: dict[str, list[str]]

    @classmethod
    def of(cls, domain: Domain) -> Self:
        """Return the schema of a domain."""
        return cls(
            name=domain.name,
            classes={
                item.name: {attribute.name: attribute.kind.value for attribute in item.changeable}
                for item in domain.classes
                if not item.static
            },
            terms=list(domain.term_names),
            actions={name: list(parameters) for name, parameters in domain.actions.items()},
        )


class Ratio(Part):
    """A fraction, which JSON has no number for."""

    numerator: int
    denominator: Annotated[int, Field(ge=1)]


EffectArgument = bool | int | float | str | Ratio


class RewardEntry(Part):
    """What an action that changed certain attributes was worth, by condition: reward, and whether the episode ended."""

    action: str
    changed: list[str]
    worth: dict[FullConditionText, tuple[float, bool]]


class RulesDocument(Part):
    """A whole rules file; ``knowledge`` is the part that belongs to the learner."""

    format: Literal["wherry-rules"] = "wherry-rules"
    version: Literal[1] = 1
    sentences: list[str]
    domain: DomainSchema
    knowledge: Any


def attribute_name(subject: Subject) -> str:
    """Return a subject's class and attribute as written in files: ``Taxi.x``."""
    return f"{subject.class_name}.{subject.attribute}"


def argument_of(effect: Effect) -> EffectArgument:
    """Return an effect's argument as written in files."""
    argument = effect.argument
    if isinstance(argument, Fraction):
        return Ratio(numerator=argument.numerator, denominator=argument.denominator)
    return argument


def effect_of(effect_type: str, argument: EffectArgument) -> Effect:
    """Return the effect that a type and an argument from a file stand for."""
    if isinstance(argument, Ratio):
        return Effect(effect_type, Fraction(argument.numerator, argument.denominator))
    return Effect(effect_type, argument)


def reward_entries(rewards: Rewards) -> list[RewardEntry]:
    """Return learnt rewards as written in files."""
    return [
        RewardEntry(
            action=action,
            changed=sorted(f"{class_name}.{attribute}" for class_name, attribute in changed),
            worth={str(Condition.of(rewards.size, terms)): value for terms, value in cases.seen.items()},
        )
        for action, by_change in rewards.cases.items()
        for changed, cases in by_change.items()
    ]
