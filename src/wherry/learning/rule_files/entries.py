"""The parts of a rules file that are the same for all learners, checked by pydantic."""

from __future__ import annotations

from fractions import Fraction
from typing import Annotated, Any, Literal, Self

from pydantic import Field, StringConstraints

from wherry.documents import Document
from wherry.learning.effect_rules import Subject
from wherry.learning.rewards import Rewards
from wherry.oomdp.conditions import Condition
from wherry.oomdp.domain import Domain
from wherry.oomdp.effects import Effect

MAX_TERMS = 1000  # characters of a condition, one for each term

ConditionText = Annotated[str, StringConstraints(pattern=r"^[01*]+$", max_length=MAX_TERMS)]
"""A condition over the domain's terms: ``1**0*0*``."""

FullConditionText = Annotated[str, StringConstraints(pattern=r"^[01]+$", max_length=MAX_TERMS)]
"""A condition without *: the value of every term."""

Count = Annotated[int, Field(ge=1)]


class DomainSchema(Document):
    """The schema of the domain that rules are valid in, without bounds of attributes and without static objects."""

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


class Ratio(Document):
    """A fraction of two integers, which JSON cannot represent as a number."""

    numerator: int
    denominator: Annotated[int, Field(ge=1)]


EffectArgument = bool | int | float | str | Ratio


class RewardEntry(Document):
    """The rewards of the steps in which an action changed certain attributes.

    ``worth`` has the reward under each condition, with whether the episode ended.
    """

    action: str
    changed: list[str]
    worth: dict[FullConditionText, tuple[float, bool]]


class RulesDocument(Document):
    """A whole rules file; ``knowledge`` is the part that depends on the type of learner."""

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
    """Return the effect of a type with an argument as written in files."""
    if isinstance(argument, Ratio):
        return Effect(effect_type, Fraction(argument.numerator, argument.denominator))
    return Effect(effect_type, argument)


def reward_entries(rewards: Rewards) -> list[RewardEntry]:
    """Return learnt rewards as written in files."""
    return [
        RewardEntry(
            action=action,
            changed=sorted(f"{class_name}.{attribute}" for class_name, attribute in changed),
            worth={str(Condition.of(rewards.size, terms)): value for terms, value in cases.latest.items()},
        )
        for action, by_change in rewards.cases.items()
        for changed, cases in by_change.items()
    ]
