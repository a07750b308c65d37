"""The Bayesian learner in rules files: its evidence, to which its rules are fitted again when a file is read."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field

from wherry.documents import Document
from wherry.learning.bayes import BayesianLearner
from wherry.learning.evidence import Evidence
from wherry.learning.rule_files.codec import KnowledgeReader, RuleCodec
from wherry.learning.rule_files.entries import (
    Count,
    EffectArgument,
    FullConditionText,
    RewardEntry,
    argument_of,
    attribute_name,
    reward_entries,
)
from wherry.oomdp.conditions import Condition
from wherry.oomdp.effects import EffectType


class EffectEntry(Document):
    """An effect, with how often it was observed under each condition."""

    type: str
    argument: EffectArgument
    times: dict[FullConditionText, Count]


class UnchangedEntry(Document):
    """A condition and a value, with how often an attribute kept that value under the condition."""

    condition: FullConditionText
    value: bool | int | float | str
    times: Count


class EvidenceEntry(Document):
    """The examples of an action's effects on an attribute."""

    action: str
    attribute: str
    effects: list[EffectEntry]
    unchanged: list[UnchangedEntry]


class BayesianKnowledge(Document):
    """The parameters of the Bayesian learner and its examples, which determine its rules."""

    learner: Literal["bayes"] = "bayes"
    expected_terms: Annotated[float, Field(gt=0)]
    novelty: Annotated[float, Field(ge=0, le=1)]
    effect_types: list[str]
    tried: dict[str, dict[FullConditionText, bool]]
    evidence: list[EvidenceEntry]
    rewards: list[RewardEntry]


def _encode(learner: BayesianLearner) -> BayesianKnowledge:
    def text(terms: int) -> FullConditionText:
        return str(Condition.of(learner.domain.size, terms))

    evidence = [
        EvidenceEntry(
            action=subject.action,
            attribute=attribute_name(subject),
            effects=[
                EffectEntry(
                    type=effect.type,
                    argument=argument_of(effect),
                    times={text(terms): count for terms, count in counts.items()},
                )
                for effects in examples.effects.values()
                for effect, counts in effects.items()
            ],
            unchanged=[
                UnchangedEntry(condition=text(terms), value=value, times=count)
                for terms, values in examples.unchanged.items()
                for value, count in values.items()
            ],
        )
        for subject, examples in learner.evidence.items()
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
    for index, entry in enumerate(knowledge.evidence):
        field = f"knowledge.evidence.{index}"
        subject = reader.subject(entry.action, entry.attribute, field)
        learner.evidence[subject] = _evidence(entry, learner.effect_types, reader, field)
    learner.refit()
    reader.add_rewards(learner.rewards, knowledge.rewards)
    return learner


def _evidence(
    entry: EvidenceEntry, effect_types: Mapping[str, EffectType], reader: KnowledgeReader, field: str
) -> Evidence:
    evidence = Evidence()
    for index, observed in enumerate(entry.effects):
        place = f"{field}.effects.{index}"
        if observed.type not in effect_types:
            raise reader.refusal(f"{place}.type", f"{observed.type!r} is no effect type of this learner")
        counts = {reader.terms(text, f"{place}.times"): count for text, count in observed.times.items()}
        effect = reader.effect(observed.type, observed.argument, f"{place}.argument")
        evidence.effects.setdefault(observed.type, {})[effect] = counts
    for index, unchanged in enumerate(entry.unchanged):
        terms = reader.terms(unchanged.condition, f"{field}.unchanged.{index}.condition")
        evidence.unchanged.setdefault(terms, {})[unchanged.value] = unchanged.times
    return evidence


BAYES_CODEC = RuleCodec(BayesianLearner, BayesianKnowledge, _encode, _decode)
"""The codec of the Bayesian learner."""
