"""The Bayesian learner in rules files: its evidence, which its rules are worked out from again."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field

from wherry.learning.bayes import BayesianLearner
from wherry.learning.evidence import Evidence
from wherry.learning.rule_files.codec import KnowledgeReader, RuleCodec
from wherry.learning.rule_files.entries import (
    Count,
    EffectArgument,
    FullConditionText,
    Part,
    RewardEntry,
    argument_of,
    attribute_name,
    effect_of,
    reward_entries,
)
from wherry.oomdp.conditions import Condition
from wherry.oomdp.effects import EffectType


class EffectEntry(Part):
    """How often an effect was observed, by condition."""

    type: str
    argument: EffectArgument
    times: dict[FullConditionText, Count]


class UnchangedEntry(Part):
    """How often an attribute kept a value under a condition."""

    condition: FullConditionText
    value: bool | int | float | str
    times: Count


class EvidenceEntry(Part):
    """The examples of what an action does to an attribute."""

    action: str
    attribute: str
    effects: list[EffectEntry]
    unchanged: list[UnchangedEntry]


class BayesianKnowledge(Part):
    """The examples that the Bayesian learner was shown; its rules follow from them."""

    learner: Literal["bayes"] = "bayes"
    expected_terms: Annotated[float, Field(gt=0)]
    novelty: Annotated[float, Field(ge=0, le=1)]
    effect_types: list[str]
    tried: dict[str, dict[FullConditionText, bool]]
    evidence: list[EvidenceEntry]
    rewards: list[RewardEntry]


def _encode(learner: BayesianLearner) -> BayesianKnowledge:
    def text(terms: int) -> str:
        return str(Condition.of(learner.domain.size, terms))

    evidence = [
        EvidenceEntry(
            action=subject.action,
            attribute=attribute_name(subject),
            effects=[
                EffectEntry(
                    type=effect.type,
                    argument=argument_of(effect),
                    times={text(terms): times for terms, times in seen.items()},
                )
                for effects in found.effects.values()
                for effect, seen in effects.items()
            ],
            unchanged=[
                UnchangedEntry(condition=text(terms), value=value, times=times)
                for terms, values in found.unchanged.items()
                for value, times in values.items()
            ],
        )
        for subject, found in learner.evidence.items()
    ]
    return BayesianKnowledge(
        expected_terms=learner.literal_odds * learner.domain.size,
        novelty=learner.unseen.novelty,
        effect_types=list(learner.effect_types),
        tried={
            action: {text(terms): succeeded for terms, succeeded in tried.items()}
            for action, tried in learner.unseen.tried.items()
        },
        evidence=evidence,
        rewards=reward_entries(learner.rewards),
    )


def _decode(knowledge: BayesianKnowledge, reader: KnowledgeReader) -> BayesianLearner:
    learner = BayesianLearner(
        reader.domain,
        expected_terms=knowledge.expected_terms,
        novelty=knowledge.novelty,
        effect_types=reader.effect_types(knowledge.effect_types),
        reward=reader.task.reward,
        terminated=reader.task.terminated,
    )
    for action, tried in knowledge.tried.items():
        field = f"knowledge.tried.{action}"
        reader.action(action, field)
        learner.unseen.tried[action] = {reader.terms(text, field): succeeded for text, succeeded in tried.items()}
    for at, entry in enumerate(knowledge.evidence):
        field = f"knowledge.evidence.{at}"
        subject = reader.subject(entry.action, entry.attribute, field)
        learner.evidence[subject] = _evidence(entry, learner.effect_types, reader, field)
    learner.refit()
    reader.add_rewards(learner.rewards, knowledge.rewards)
    return learner


def _evidence(
    entry: EvidenceEntry, effect_types: Mapping[str, EffectType], reader: KnowledgeReader, field: str
) -> Evidence:
    evidence = Evidence()
    for at, seen in enumerate(entry.effects):
        if seen.type not in effect_types:
            raise reader.refusal(f"{field}.effects.{at}.type", f"{seen.type!r} is no effect type here")
        times = {reader.terms(text, f"{field}.effects.{at}.times"): count for text, count in seen.times.items()}
        evidence.effects.setdefault(seen.type, {})[effect_of(seen.type, seen.argument)] = times
    for at, stayed in enumerate(entry.unchanged):
        terms = reader.terms(stayed.condition, f"{field}.unchanged.{at}.condition")
        evidence.unchanged.setdefault(terms, {})[stayed.value] = stayed.times
    return evidence


BAYES_CODEC = RuleCodec(BayesianLearner, BayesianKnowledge, _encode, _decode)
"""The codec of the Bayesian learner."""
