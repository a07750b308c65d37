"""DOORMAX in rules files: its predictions, failure conditions, near misses and rewards."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field

from wherry.documents import Document
from wherry.learning.doormax import Doormax
from wherry.learning.effect_rules import Subject
from wherry.learning.failures import FailureKey
from wherry.learning.near_miss import NearMisses
from wherry.learning.rule_files.codec import KnowledgeReader, RuleCodec
from wherry.learning.rule_files.entries import (
    ConditionText,
    EffectArgument,
    FullConditionText,
    RewardEntry,
    argument_of,
    attribute_name,
    reward_entries,
)
from wherry.oomdp.conditions import Condition


class RuleEntry(Document):
    """A prediction p: its condition p.model, and the argument of its effect p.effect."""

    model: ConditionText = Field(alias="if")
    argument: EffectArgument = Field(alias="then")


class TypeEntry(Document):
    """The predictions pred(a, att, type), or the reason why the type was removed."""

    action: str
    attribute: str
    type: str
    rules: list[RuleEntry] = Field(default_factory=list)
    removed: str | None = None


class FailureEntry(Document):
    """The failure conditions F of an action, or of an action and an attribute."""

    action: str
    attribute: str | None = None
    conditions: list[FullConditionText]


class NearMissEntry(Document):
    """The experience from which failures of an action are inferred; ``revoked`` is the reason for inferring none."""

    successes: ConditionText | None = None
    failures: list[FullConditionText] = Field(default_factory=list)
    revoked: str | None = None


class DoormaxKnowledge(Document):
    """The knowledge of DOORMAX; ``near_misses`` is None where failures are only memorised."""

    learner: Literal["doormax"] = "doormax"
    max_effects: Annotated[int, Field(ge=1)]
    effect_types: list[str]
    refutation: bool
    failure_scope: Literal["action", "attribute"]
    predictions: list[TypeEntry]
    failures: list[FailureEntry]
    near_misses: dict[str, NearMissEntry] | None = None
    rewards: list[RewardEntry]


def _encode(learner: Doormax) -> DoormaxKnowledge:
    return DoormaxKnowledge(
        max_effects=learner.max_effects,
        effect_types=list(learner.effect_types),
        refutation=learner.refutation,
        failure_scope=learner.failure_scope,
        predictions=_type_entries(learner),
        failures=_failure_entries(learner),
        near_misses=None if learner.near_misses is None else _near_miss_entries(learner.near_misses),
        rewards=reward_entries(learner.rewards),
    )


def _type_entries(learner: Doormax) -> list[TypeEntry]:
    """Return entries for the types that have predictions, followed by those for the removed types."""
    effect_rules = learner.effect_rules
    entries = [
        TypeEntry(
            action=subject.action,
            attribute=attribute_name(subject),
            type=name,
            rules=[
                RuleEntry.model_validate({"if": str(model), "then": argument_of(effect)})
                for effect, model in models.items()
            ],
        )
        for subject, types in effect_rules.models.items()
        for name, models in types.items()
        if models
    ]
    removed = [
        TypeEntry(action=subject.action, attribute=attribute_name(subject), type=name, removed=reason)
        for subject, types in effect_rules.removed.items()
        for name, reason in types.items()
    ]
    return entries + removed


def _failure_entries(learner: Doormax) -> list[FailureEntry]:
    return [
        FailureEntry(
            action=key.action if isinstance(key, Subject) else key,
            attribute=attribute_name(key) if isinstance(key, Subject) else None,
            conditions=sorted(str(Condition.of(learner.domain.size, terms)) for terms in conditions),
        )
        for key, conditions in learner.failures.conditions.items()
    ]


def _near_miss_entries(near_misses: NearMisses) -> dict[str, NearMissEntry]:
    return {
        action: NearMissEntry(
            successes=None if (merged := near_misses.successes.get(action)) is None else str(merged),
            failures=sorted(
                str(Condition.of(near_misses.size, terms)) for terms in near_misses.failures.get(action, ())
            ),
            revoked=near_misses.revoked.get(action),
        )
        for action in sorted(near_misses.successes.keys() | near_misses.failures.keys())
    }


def _decode(knowledge: DoormaxKnowledge, reader: KnowledgeReader) -> Doormax:
    if knowledge.near_misses is not None and knowledge.failure_scope != "action":
        raise reader.refusal("knowledge.near_misses", "are inferred from failures of whole actions alone")
    learner = Doormax(
        reader.domain,
        max_effects=knowledge.max_effects,
        effect_types=reader.effect_types(knowledge.effect_types),
        refutation=knowledge.refutation,
        failure_scope=knowledge.failure_scope,
        inference="memorise" if knowledge.near_misses is None else "near-miss",
        reward=reader.task.reward,
        terminated=reader.task.terminated,
    )
    for index, entry in enumerate(knowledge.predictions):
        _add_type(learner, entry, reader, f"knowledge.predictions.{index}")
    for index, failure in enumerate(knowledge.failures):
        field = f"knowledge.failures.{index}"
        key: FailureKey = reader.action(failure.action, field)
        if failure.attribute is not None:
            key = reader.subject(failure.action, failure.attribute, field)
        learner.failures.conditions[key] = {reader.terms(text, field) for text in failure.conditions}
    if learner.near_misses is not None:
        _add_near_misses(learner.near_misses, knowledge.near_misses or {}, reader)
    reader.add_rewards(learner.rewards, knowledge.rewards)
    return learner


def _add_type(learner: Doormax, entry: TypeEntry, reader: KnowledgeReader, field: str) -> None:
    """Add the predictions of one effect type, or remove the type."""
    subject = reader.subject(entry.action, entry.attribute, field)
    if entry.type not in learner.effect_rules.models[subject]:
        raise reader.refusal(f"{field}.type", f"{entry.type!r} is no effect type of {entry.attribute}")
    if entry.removed is not None:
        if entry.rules:
            raise reader.refusal(f"{field}.rules", "must be empty, as the effect type was removed")
        learner.effect_rules.remove(subject, entry.type, entry.removed)
    for index, rule in enumerate(entry.rules):
        effect = reader.effect(entry.type, rule.argument, f"{field}.rules.{index}.then")
        learner.effect_rules.models[subject][entry.type][effect] = reader.condition(rule.model, field)


def _add_near_misses(near_misses: NearMisses, entries: Mapping[str, NearMissEntry], reader: KnowledgeReader) -> None:
    for action, entry in entries.items():
        field = f"knowledge.near_misses.{action}"
        reader.action(action, field)
        if entry.successes is not None:
            near_misses.successes[action] = reader.condition(entry.successes, field)
        near_misses.failures[action] = {reader.terms(text, field) for text in entry.failures}
        if entry.revoked is not None:
            near_misses.revoked[action] = entry.revoked


DOORMAX_CODEC = RuleCodec(Doormax, DoormaxKnowledge, _encode, _decode)
"""The codec of DOORMAX and its variants."""
