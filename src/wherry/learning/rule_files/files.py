"""Learnt rules as readable JSON files, written atomically and checked completely when they are read.

A file begins with the rules in words, which are for people and not read back. They are followed by the domain's schema,
which is compared when the file is read so that rules are never used in another domain, and by the learner's knowledge.
Conditions are written ``1**0*0*``, one character for each of the domain's terms in their order.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache, reduce
from operator import or_
from pathlib import Path
from pkgutil import resolve_name
from typing import Annotated, Any

from pydantic import Field, create_model

from wherry.documents import load_json
from wherry.files import write_atomically
from wherry.learning.registry import RULE_LEARNERS
from wherry.learning.rule_files.codec import KnowledgeReader, RuleCodec
from wherry.learning.rule_files.entries import DomainSchema, RulesDocument
from wherry.learning.rules import RuleLearner
from wherry.oomdp.domain import Domain
from wherry.oomdp.effects import EFFECT_TYPES, EffectType
from wherry.oomdp.effects_outcome import GivenTask
from wherry.oomdp.mdp import RewardFunction, TerminationFunction

MAX_FILE_SIZE = 20_000_000  # bytes


def save_rules(learner: RuleLearner, path: str | Path) -> None:
    """Write a learner's knowledge to a file atomically: a crash leaves the old file or the complete new one.

    Raises:
        InputError: The file cannot be written.
        TypeError: No codec is registered for this type of learner.
    """
    codec = next((codec for codec in _codecs() if isinstance(learner, codec.learner)), None)
    if codec is None:
        raise TypeError(f"no codec is registered for the rules of a {type(learner).__name__}")
    document = RulesDocument(
        sentences=list(learner.sentences()),
        domain=DomainSchema.of(learner.domain),
        knowledge=codec.encode(learner),
    )
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
        domain: Domain that the learner is used in; it must have the schema with which the rules were learnt.
        effect_types: Effect types that the file may name.
        reward: R(s, a, s') where it is given; None to learn it.
        terminated: Whether a state ends the episode where that is given; None to learn it.

    Raises:
        InputError: The file cannot be read, is not a rules file, or belongs to another domain.
    """
    document = load_json(path, _document_type(), max_bytes=MAX_FILE_SIZE)
    reader = KnowledgeReader(str(path), domain, effect_types, GivenTask(reward, terminated))
    reader.check_schema(document.domain)
    codec = next(codec for codec in _codecs() if isinstance(document.knowledge, codec.knowledge))
    learner: RuleLearner = codec.decode(document.knowledge, reader)
    return learner


@cache
def _codecs() -> tuple[RuleCodec[Any, Any], ...]:
    """Return the codecs of all registered learners, each once."""
    locations = dict.fromkeys(entry.codec for entry in RULE_LEARNERS.values() if entry.codec is not None)
    return tuple(resolve_name(location) for location in locations)


@cache
def _document_type() -> type[RulesDocument]:
    """Return the type of a rules file with the knowledge of any registered learner, which its ``learner`` names."""
    any_knowledge: Any = reduce(or_, (codec.knowledge for codec in _codecs()))
    knowledge: Any = Annotated[any_knowledge, Field(discriminator="learner")]
    return create_model("RulesFile", __base__=RulesDocument, knowledge=(knowledge, ...))
