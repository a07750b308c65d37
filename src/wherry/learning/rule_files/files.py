"""What was learnt, as readable JSON: saved atomically, checked completely when it is loaded.

A file begins with the rules in words, which are there for people and not read back. Then come the domain's schema, so
that rules never get into a world they do not fit, and what the learner knows: conditions are written ``1**0*0*``, with
one sign for each of the domain's terms in their order.
"""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError

from wherry.errors import InputError
from wherry.files import read_text, write_atomically
from wherry.learning.bayes import BayesianLearner, Evidence
from wherry.learning.doormax import Doormax
from wherry.learning.learners import RuleLearner
from wherry.learning.near_miss import NearMisses
from wherry.learning.predictions import Subject
from wherry.learning.rewards import Rewards
from wherry.oomdp.conditions import Condition
from wherry.oomdp.domain import Domain
from wherry.oomdp.effects import EFFECT_TYPES, Effect, EffectType
from wherry.oomdp.effects_outcome import StepReward
from wherry.oomdp.mdp import RewardFunction, TerminationFunction

LARGEST_FILE = 20_000_000  # bytes

ConditionText = Annotated[str, StringConstraints(pattern=r"^[01*]+$", max_length=1000)]
FullCondition = Annotated[str, StringConstraints(pattern=r"^[01]+$", max_length=1000)]
Times = Annotated[int, Field(ge=1)]


class Part(BaseModel):
    """A part of a rules file: no unknown fields, no conversions, no infinities."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, populate_by_name=True)


class Schema(Part):
    """What a domain's rules are about; bounds of attributes and static objects are not part of it."""

    name: str
    classes: dict[str, dict[str, str]]
    terms: list[str]
    actions: dict[str, list[str]]

    @classmethod
    def of(cls, domain: Domain) -> Self:
        """A domain's schema."""
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
    """A fraction, which JSON has no sign for."""

    numerator: int
    denominator: Annotated[int, Field(ge=1)]


Argument = bool | int | float | str | Ratio


class RewardCase(Part):
    """What one action's one change was worth, by condition: the reward, and whether the episode ended."""

    action: str
    changed: list[str]
    worth: dict[FullCondition, tuple[float, bool]]


class RuleEntry(Part):
    """A prediction p."""

    model: ConditionText = Field(alias="if")
    argument: Argument = Field(alias="then")


class TypeEntry(Part):
    """pred(a, att, type), or why it was removed."""

    action: str
    attribute: str
    type: str
    rules: list[RuleEntry] = []
    removed: str | None = None


class FailureEntry(Part):
    """F_a, or F of an action and an attribute."""

    action: str
    attribute: str | None = None
    conditions: list[FullCondition]


class NearMissEntry(Part):
    """What failures are inferred from for one action: its merged successes, its failures, and why no more is."""

    successes: ConditionText | None = None
    failures: list[FullCondition] = []
    revoked: str | None = None


class DoormaxKnowledge(Part):
    """What DOORMAX knows."""

    learner: Literal["doormax"] = "doormax"
    max_effects: Annotated[int, Field(ge=1)]
    effect_types: list[str]
    refutation: bool
    failure_scope: Literal["action", "attribute"]
    predictions: list[TypeEntry]
    failures: list[FailureEntry]
    near_misses: dict[str, NearMissEntry] | None = None  # None: failures are memorised
    rewards: list[RewardCase]


class EffectEntry(Part):
    """How often an effect was seen, by condition."""

    type: str
    argument: Argument
    times: dict[FullCondition, Times]


class UnchangedEntry(Part):
    """How often an attribute stayed as it was under a condition, with a value."""

    condition: FullCondition
    value: bool | int | float | str
    times: Times


class EvidenceEntry(Part):
    """What was seen of an action and an attribute."""

    action: str
    attribute: str
    effects: list[EffectEntry]
    unchanged: list[UnchangedEntry]


class BayesianKnowledge(Part):
    """What the Bayesian learner has seen; its beliefs follow from that."""

    learner: Literal["bayes"] = "bayes"
    expected_terms: Annotated[float, Field(gt=0)]
    novelty: Annotated[float, Field(ge=0, le=1)]
    effect_types: list[str]
    tried: dict[str, dict[FullCondition, bool]]
    evidence: list[EvidenceEntry]
    rewards: list[RewardCase]


class Document(Part):
    """A whole file."""

    format: Literal["wherry-rules"] = "wherry-rules"
    version: Literal[1] = 1
    sentences: list[str]
    domain: Schema
    knowledge: Annotated[DoormaxKnowledge | BayesianKnowledge, Field(discriminator="learner")]


def save_rules(learner: RuleLearner, path: str | Path) -> None:
    """Write what a learner knows to a file, which a crash never leaves half written.

    Raises:
        InputError: The file cannot be written.
        TypeError: There is no format for this kind of learner.
    """
    if isinstance(learner, Doormax):
        knowledge: DoormaxKnowledge | BayesianKnowledge = _doormax_knowledge(learner)
    elif isinstance(learner, BayesianLearner):
        knowledge = _bayesian_knowledge(learner)
    else:
        raise TypeError(f"there is no file format for what a {type(learner).__name__} knows")
    document = Document(sentences=list(learner.sentences()), domain=Schema.of(learner.domain), knowledge=knowledge)
    write_atomically(path, document.model_dump_json(indent=1, by_alias=True, exclude_defaults=False) + "\n")


def load_rules(
    path: str | Path,
    domain: Domain,
    *,
    effect_types: Mapping[str, EffectType] = EFFECT_TYPES,
    reward: RewardFunction | None = None,
    terminated: TerminationFunction | None = None,
) -> RuleLearner:
    """Read a learner from a file.

    Args:
        path: The file.
        domain: What the learner is to be used for; its schema must be the one the rules were learnt with.
        effect_types: The effect types that the file may speak of.
        reward: R(s, a, s') where it is given.
        terminated: Whether a state ends the episode, where that is given.

    Raises:
        InputError: The file cannot be read, is not a rules file, or belongs to another domain.
    """
    try:
        document = Document.model_validate_json(read_text(path, limit=LARGEST_FILE))
    except ValidationError as error:
        first = error.errors()[0]
        raise InputError(path, ".".join(map(str, first["loc"])), first["msg"]) from error
    reader = _Reader(str(path), domain, effect_types)
    reader.check_schema(document.domain)
    if isinstance(document.knowledge, DoormaxKnowledge):
        return reader.doormax(document.knowledge, reward, terminated)
    return reader.bayesian(document.knowledge, reward, terminated)


def _doormax_knowledge(learner: Doormax) -> DoormaxKnowledge:
    predictions = learner.predictions
    entries = [
        TypeEntry(
            action=subject.action,
            attribute=_attribute_name(subject),
            type=name,
            rules=[
                RuleEntry.model_validate({"if": str(model), "then": _to_json(effect)})
                for effect, model in models.items()
            ],
        )
        for subject, types in predictions.models.items()
        for name, models in types.items()
        if models
    ]
    removed = [
        TypeEntry(action=subject.action, attribute=_attribute_name(subject), type=name, removed=reason)
        for subject, types in predictions.removed.items()
        for name, reason in types.items()
    ]
    failures = [
        FailureEntry(
            action=scope.action if isinstance(scope, Subject) else scope,
            attribute=_attribute_name(scope) if isinstance(scope, Subject) else None,
            conditions=sorted(str(Condition.of(learner.domain.size, terms)) for terms in conditions),
        )
        for scope, conditions in learner.failures.items()
    ]
    return DoormaxKnowledge(
        max_effects=learner.max_effects,
        effect_types=list(learner.effect_types),
        refutation=learner.refutation,
        failure_scope=learner.failure_scope,
        predictions=entries + removed,
        failures=failures,
        near_misses=None if learner.near_misses is None else _near_miss_entries(learner.near_misses),
        rewards=_reward_cases(learner.rewards),
    )


def _bayesian_knowledge(learner: BayesianLearner) -> BayesianKnowledge:
    def text(terms: int) -> str:
        return str(Condition.of(learner.domain.size, terms))

    evidence = [
        EvidenceEntry(
            action=subject.action,
            attribute=_attribute_name(subject),
            effects=[
                EffectEntry(
                    type=effect.type,
                    argument=_to_json(effect),
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
        expected_terms=learner.factor * learner.domain.size,
        novelty=learner.novelty,
        effect_types=list(learner.effect_types),
        tried={
            action: {text(terms): succeeded for terms, succeeded in tried.items()}
            for action, tried in learner.tried.items()
        },
        evidence=evidence,
        rewards=_reward_cases(learner.rewards),
    )


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


def _reward_cases(rewards: Rewards) -> list[RewardCase]:
    return [
        RewardCase(
            action=action,
            changed=sorted(f"{class_name}.{attribute}" for class_name, attribute in changed),
            worth={str(Condition.of(rewards.size, terms)): value for terms, value in cases.seen.items()},
        )
        for action, by_change in rewards.cases.items()
        for changed, cases in by_change.items()
    ]


def _attribute_name(subject: Subject) -> str:
    return f"{subject.class_name}.{subject.attribute}"


def _to_json(effect: Effect) -> Argument:
    argument = effect.argument
    if isinstance(argument, Fraction):
        return Ratio(numerator=argument.numerator, denominator=argument.denominator)
    return argument


class _Reader:
    """Makes learners of what a file says.

    Args:
        source: The file.
        domain: What the learner is for.
        effect_types: The effect types that the file may speak of.
    """

    def __init__(self, source: str, domain: Domain, effect_types: Mapping[str, EffectType]) -> None:
        self.source = source
        self.domain = domain
        self.effect_types = effect_types

    def check_schema(self, schema: Schema) -> None:
        """Refuse rules of another domain."""
        ours = Schema.of(self.domain)
        for field in ("name", "classes", "terms", "actions"):
            if getattr(schema, field) != getattr(ours, field):
                raise InputError(self.source, f"domain.{field}", f"these are rules for another domain than {ours.name}")

    def doormax(
        self, knowledge: DoormaxKnowledge, reward: RewardFunction | None, terminated: TerminationFunction | None
    ) -> Doormax:
        """DOORMAX as it was."""
        if knowledge.near_misses is not None and knowledge.failure_scope != "action":
            raise InputError(self.source, "knowledge.near_misses", "are inferred from failures of whole actions alone")
        learner = Doormax(
            self.domain,
            max_effects=knowledge.max_effects,
            effect_types=self._types(knowledge.effect_types),
            refutation=knowledge.refutation,
            failure_scope=knowledge.failure_scope,
            inference="memorise" if knowledge.near_misses is None else "near-miss",
            reward=reward,
            terminated=terminated,
        )
        for at, entry in enumerate(knowledge.predictions):
            where = f"knowledge.predictions.{at}"
            subject = self._subject(entry.action, entry.attribute, where)
            if entry.type not in learner.predictions.models[subject]:
                raise InputError(self.source, f"{where}.type", f"{entry.type!r} is no effect type of {entry.attribute}")
            if entry.removed is not None:
                learner.predictions.remove(subject, entry.type, entry.removed)
            for rule in entry.rules:
                effect = _effect(entry.type, rule.argument)
                learner.predictions.models[subject][entry.type][effect] = self._condition(rule.model, where)
        for at, failure in enumerate(knowledge.failures):
            where = f"knowledge.failures.{at}"
            scope: str | Subject = self._action(failure.action, where)
            if failure.attribute is not None:
                scope = self._subject(failure.action, failure.attribute, where)
            learner.failures[scope] = {self._terms(text, where) for text in failure.conditions}
        if learner.near_misses is not None:
            self._read_near_misses(learner.near_misses, knowledge.near_misses or {})
        self._read_rewards(learner.rewards, knowledge.rewards)
        return learner

    def _read_near_misses(self, near_misses: NearMisses, entries: Mapping[str, NearMissEntry]) -> None:
        for action, entry in entries.items():
            where = f"knowledge.near_misses.{action}"
            self._action(action, where)
            if entry.successes is not None:
                near_misses.successes[action] = self._condition(entry.successes, where)
            near_misses.failures[action] = {self._terms(text, where) for text in entry.failures}
            if entry.revoked is not None:
                near_misses.revoked[action] = entry.revoked

    def bayesian(
        self, knowledge: BayesianKnowledge, reward: RewardFunction | None, terminated: TerminationFunction | None
    ) -> BayesianLearner:
        """The Bayesian learner with all that it has seen."""
        learner = BayesianLearner(
            self.domain,
            expected_terms=knowledge.expected_terms,
            novelty=knowledge.novelty,
            effect_types=self._types(knowledge.effect_types),
            reward=reward,
            terminated=terminated,
        )
        for action, tried in knowledge.tried.items():
            where = f"knowledge.tried.{action}"
            self._action(action, where)
            learner.tried[action] = {self._terms(text, where): succeeded for text, succeeded in tried.items()}
        for at, entry in enumerate(knowledge.evidence):
            where = f"knowledge.evidence.{at}"
            subject = self._subject(entry.action, entry.attribute, where)
            learner.evidence[subject] = self._evidence(entry, learner.effect_types, where)
        learner.reconsider()
        self._read_rewards(learner.rewards, knowledge.rewards)
        return learner

    def _evidence(self, entry: EvidenceEntry, effect_types: Mapping[str, EffectType], where: str) -> Evidence:
        evidence = Evidence()
        for at, seen in enumerate(entry.effects):
            if seen.type not in effect_types:
                raise InputError(self.source, f"{where}.effects.{at}.type", f"{seen.type!r} is no effect type here")
            times = {self._terms(text, f"{where}.effects.{at}.times"): count for text, count in seen.times.items()}
            evidence.effects.setdefault(seen.type, {})[_effect(seen.type, seen.argument)] = times
        for at, stayed in enumerate(entry.unchanged):
            terms = self._terms(stayed.condition, f"{where}.unchanged.{at}.condition")
            evidence.unchanged.setdefault(terms, {})[stayed.value] = stayed.times
        return evidence

    def _read_rewards(self, rewards: Rewards, cases: list[RewardCase]) -> None:
        for at, case in enumerate(cases):
            where = f"knowledge.rewards.{at}"
            subjects = [self._subject(case.action, name, where) for name in case.changed]
            changed = frozenset((subject.class_name, subject.attribute) for subject in subjects)
            for text, (worth, terminated) in case.worth.items():
                rewards.add(case.action, self._terms(text, where), StepReward(changed, worth, terminated))

    def _types(self, names: list[str]) -> Mapping[str, EffectType]:
        if unknown := [name for name in names if name not in self.effect_types]:
            raise InputError(self.source, "knowledge.effect_types", f"{unknown[0]!r} is not one of them")
        return {name: self.effect_types[name] for name in names}

    def _action(self, name: str, where: str) -> str:
        if name not in self.domain.actions:
            raise InputError(self.source, where, f"{name!r} is no action of {self.domain.name}")
        return name

    def _subject(self, action: str, attribute: str, where: str) -> Subject:
        class_name, _, name = attribute.partition(".")
        object_class = self.domain.classes_by_name.get(class_name)
        if object_class is None or object_class.static or name not in (item.name for item in object_class.changeable):
            raise InputError(self.source, where, f"{attribute!r} is no attribute of {self.domain.name}")
        return Subject(self._action(action, where), class_name, name)

    def _condition(self, text: str, where: str) -> Condition:
        if len(text) != self.domain.size:
            raise InputError(self.source, where, f"{text!r} does not have {self.domain.size} signs")
        return Condition.parse(text)

    def _terms(self, text: str, where: str) -> int:
        return self._condition(text, where).value


def _effect(effect_type: str, argument: Argument) -> Effect:
    if isinstance(argument, Ratio):
        return Effect(effect_type, Fraction(argument.numerator, argument.denominator))
    return Effect(effect_type, argument)
