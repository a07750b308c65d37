"""A Bayesian learner of concepts: what an action does, and under which conjunction of terms, from few examples.

DOORMAX says "I don't know" until it can be sure, and memorises where an action fails. This learner always has an
opinion, with its probability, notices when it was wrong, and corrects itself. For every action and attribute it looks
for the type of effect that explains all changes with the fewest different effects, and for each effect believes in
conjunctions of terms (`wherry.learning.concepts`): simple ones rather than complicated ones, none that an example
refutes. An effect that no single conjunction explains gets several.

It is not KWIK: a prediction may be wrong.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Hashable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from wherry.learning.concepts import Concept
from wherry.learning.predictions import Subject
from wherry.learning.rewards import Rewards
from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.effects import PAPER_TYPES, Effect, EffectType, eff_att, observed
from wherry.oomdp.mdp import Prediction, RewardFunction, TerminationFunction, Transition
from wherry.oomdp.objects import Attribute, ObjectClass, State, Value
from wherry.oomdp.outcomes import Answer, ObjectEffects, Outcome, Task, Worth, changes, conditions_key

OCCAM = 0.1
"""q, how much less likely a hypothesis is for every term that it fixes."""

ASSIGNMENT = "assignment"

NOVELTY = 0.01
"""How likely an action that is understood has yet another effect, which was never seen."""


@dataclass
class Evidence:
    """What was seen of one action and attribute, by the terms that held (bits).

    Attributes:
        effects: How often each effect explained a change, by type, effect and terms.
        unchanged: Under which terms, with which values, the attribute stayed as it was, and how often.
    """

    effects: dict[str, dict[Effect, dict[int, int]]] = field(default_factory=dict)
    unchanged: dict[int, dict[Value, int]] = field(default_factory=dict)

    def add(self, terms: int, before: Value, after: Value, effects: Iterable[Effect]) -> None:
        """Take in one example, with the effects that would explain it."""
        if before == after:
            _count(self.unchanged.setdefault(terms, {}), before)
        else:
            for effect in effects:
                _count(self.effects.setdefault(effect.type, {}).setdefault(effect, {}), terms)

    def simplest_type(self) -> str | None:
        """The type that explains all changes with the fewest effects; the first of equally good ones."""
        return min(self.effects, key=lambda name: len(self.effects[name]), default=None)

    def examples(self, effect: Effect) -> tuple[list[int], list[int]]:
        """The terms under which an effect happened, and those under which it did not; where both, what was seen more.

        That := v left a v as it was is no evidence.
        """
        happened = self.effects[effect.type][effect]
        failed = {
            terms: sum(
                times for value, times in values.items() if value != effect.argument or effect.type != ASSIGNMENT
            )
            for terms, values in self.unchanged.items()
        }
        for other, seen in self.effects[effect.type].items():
            if other != effect:
                for terms, times in seen.items():
                    failed[terms] = failed.get(terms, 0) + times
        positives = [terms for terms, times in happened.items() if times >= failed.get(terms, 0)]
        negatives = [terms for terms, times in failed.items() if times > happened.get(terms, 0)]
        return positives, negatives


def _count(counts: dict[Any, int], key: Hashable) -> None:
    counts[key] = counts.get(key, 0) + 1


@dataclass(frozen=True)
class Law:
    """An effect, and the conjunctions under one of which it is believed to happen.

    Attributes:
        effect: What happens.
        concepts: When; one, unless no single conjunction agrees with the examples.
    """

    effect: Effect
    concepts: tuple[Concept, ...]

    def probability(self, terms: int) -> float:
        """How likely the effect happens where exactly these terms hold."""
        spared = 1.0
        for concept in self.concepts:
            spared *= 1 - concept.probability(terms)
        return 1 - spared


def find_concepts(
    size: int, factor: float, positives: Iterable[int], negatives: Collection[int]
) -> tuple[Concept, ...]:
    """As few conjunctions as come up when every positive example joins the first that can take it in.

    Args:
        size: n, the number of terms.
        factor: q, by how much a fixed term makes a hypothesis less likely.
        positives: Terms under which the effect happened.
        negatives: Terms under which it did not.
    """
    clusters: list[list[int]] = []
    for terms in positives:
        for cluster in clusters:
            if Concept.of(size, factor, (*cluster, terms), negatives).consistent:
                cluster.append(terms)
                break
        else:
            clusters.append([terms])
    return tuple(Concept.of(size, factor, cluster, negatives) for cluster in clusters)


class BayesianLearner:
    """Believes in simple laws.

    Args:
        domain: What states are described with.
        factor: q, how much less likely a hypothesis is for every term that it fixes.
        novelty: How likely an action that is understood has yet another effect.
        effect_types: The effect types to consider.
        reward: R(s, a, s') where it is given; else it is learnt.
        terminated: Whether a state ends the episode, where that is given; else it is learnt.
    """

    def __init__(
        self,
        domain: Domain,
        *,
        factor: float = OCCAM,
        novelty: float = NOVELTY,
        effect_types: Mapping[str, EffectType] = PAPER_TYPES,
        reward: RewardFunction | None = None,
        terminated: TerminationFunction | None = None,
    ) -> None:
        self.domain = domain
        self.factor = factor
        self.novelty = novelty
        self.effect_types = effect_types
        self.task = Task(reward, terminated)
        self.revisions = dict.fromkeys(domain.actions, 0)
        self.rewards = Rewards(domain.size, generalize=True)
        self.evidence: dict[Subject, Evidence] = {}
        self.laws: dict[Subject, tuple[Law, ...]] = {}
        self.tried: dict[str, dict[int, bool]] = {action: {} for action in domain.actions}
        self._violations: dict[str, None] = {}
        self._answers: dict[str, dict[tuple[object, ...], Answer]] = {}

    @property
    def violations(self) -> tuple[str, ...]:
        """Where the same action under the same condition once did this and once that, in words."""
        return tuple(self._violations)

    def predict(self, state: State, action: Action) -> Prediction:
        """Tell what an action most likely does in a state, and what else it may do."""
        return self.answer(state, action).predict(state, action)

    def key(self, state: State) -> Hashable:
        """What the answers for a state depend on: its conditions."""
        return conditions_key(self.domain, state)

    def answer(self, state: State, action: Action) -> Answer:
        """What an action may do in all states of the same conditions; worked out once until more is learnt of it."""
        conditions = self.domain.conditions(state, action)
        kept = self._answers.setdefault(action.name, {})
        answer = kept.get((state.classes, conditions))
        if answer is None:
            answer = kept[state.classes, conditions] = self._believe(state, action.name, conditions)
        return answer

    def _believe(self, state: State, action: str, conditions: tuple[int, ...]) -> Answer:
        """The most likely effects; the effects if the most doubtful of them is otherwise; and something never seen."""
        whole, *own = conditions
        expected = [
            self._expected(action, item.object_class, terms) for item, terms in zip(state.objects, own, strict=True)
        ]
        chances = {chance for effects in expected for _, _, chance in effects}
        sure = math.prod(max(chance, 1 - chance) for chance in chances)
        doubtful = min(chances, key=lambda chance: abs(chance - 0.5), default=0.0)
        surprise = self._surprise(action, whole)
        likely = tuple(_chosen(effects, flipped=None) for effects in expected)
        unlikely = tuple(_chosen(effects, flipped=doubtful) for effects in expected)
        worths = self.rewards.worths(action, whole)
        branches = (
            (self._outcome(likely, worths), sure * (1 - surprise)),
            (self._outcome(unlikely, worths), (1 - sure) * (1 - surprise)),
            (self._outcome(None, ()), surprise),
        )
        possible = [(branch, chance) for branch, chance in branches if chance > 0]
        return Answer(tuple(sorted(possible, key=lambda entry: -entry[1])))

    def _outcome(self, effects: tuple[ObjectEffects, ...] | None, worths: tuple[Worth, ...]) -> Outcome:
        return Outcome(effects, worths, self.effect_types, self.task)

    def _expected(self, action: str, object_class: ObjectClass, terms: int) -> list[tuple[str, Effect, float]]:
        """For every attribute that the action is known to change, the most likely effect and its probability."""
        expected = []
        for attribute in object_class.changeable:
            laws = self.laws.get(Subject(action, object_class.name, attribute.name), ())
            chance, law = max(
                ((law.probability(terms), law) for law in laws), key=lambda pair: pair[0], default=(0.0, None)
            )
            if law is not None and chance > 0:
                expected.append((attribute.name, law.effect, chance))
        return expected

    def _surprise(self, action: str, whole: int) -> float:
        """How likely an action does something that it was never seen to do, by the conditions that it was tried in."""
        tried = self.tried[action]
        chance = Concept.of(self.domain.size, self.factor, (), tried).probability(whole)
        return self.novelty * chance if any(tried.values()) else chance

    def add_experience(self, transition: Transition) -> None:
        """Learn from one experience."""
        state, action = transition.state, transition.action.name
        whole, *own = self.domain.conditions(state, transition.action)
        changed = self._learn_worth(transition, whole)
        changed |= self.tried[action].get(whole) is None or (
            not transition.failed and not any(self.tried[action].values())
        )
        self.tried[action][whole] = self.tried[action].get(whole, False) or not transition.failed
        for item, terms in zip(state.objects, own, strict=True):
            for attribute, before, after in observed(item, transition.next_state.get(item.name)):
                subject = Subject(action, item.object_class.name, attribute.name)
                changed |= self._learn(subject, attribute, terms, before, after)
        if changed:
            self.revisions[action] += 1
            self._answers.pop(action, None)

    def _learn(self, subject: Subject, attribute: Attribute, terms: int, before: Value, after: Value) -> bool:
        """Learn from what happened to one attribute of one object; return whether beliefs have changed."""
        evidence = self.evidence.setdefault(subject, Evidence())
        evidence.add(terms, before, after, eff_att(attribute, before, after, self.effect_types))
        chosen = evidence.simplest_type()
        if chosen is None:
            return False
        laws = []
        for effect in evidence.effects[chosen]:
            positives, negatives = evidence.examples(effect)
            if positives:
                laws.append(Law(effect, find_concepts(self.domain.size, self.factor, positives, negatives)))
        if tuple(laws) == self.laws.get(subject):
            return False
        self.laws[subject] = tuple(laws)
        return True

    def _learn_worth(self, transition: Transition, whole: int) -> bool:
        """Learn the reward and whether the episode ended, unless both are given."""
        if self.task.reward is not None and self.task.terminated is not None:
            return False
        worth = Worth(changes(transition.state, transition.next_state), transition.reward, transition.terminated)
        return self.rewards.add(transition.action.name, whole, worth)


def _chosen(effects: list[tuple[str, Effect, float]], flipped: float | None) -> ObjectEffects:
    """The effects that are more likely than not; those of one probability the other way round."""
    return tuple(
        (attribute, (effect,)) for attribute, effect, chance in effects if (chance > 0.5) != (chance == flipped)
    )
