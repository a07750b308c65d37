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
from typing import NamedTuple

from wherry.learning.concepts import Concept, condition_of
from wherry.learning.predictions import Subject
from wherry.learning.rewards import Rewards
from wherry.learning.sentences import Rule
from wherry.oomdp.attributes import Attribute, Value
from wherry.oomdp.conditional_models import ConditionalPrediction, conditions_key
from wherry.oomdp.conditions import Condition
from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.effects import PAPER_TYPES, Effect, EffectType, effects_between, observed_values
from wherry.oomdp.effects_outcome import EffectsOutcome, ObjectEffects, StepReward, Task, changed_attributes
from wherry.oomdp.mdp import Prediction, RewardFunction, TerminationFunction, Transition
from wherry.oomdp.objects import ObjectClass, State

EXPECTED_TERMS = 0.5
"""How many terms a hypothesis is expected to fix: q = EXPECTED_TERMS / n, for n terms."""

NOVELTY = 1e-4
"""How likely an action that is understood has yet another effect, which was never seen."""

END_SOMEWHERE = 0.01
"""How likely the end that was never seen is reached by doing otherwise than ever before, what was tried left aside."""

REMEMBERED_TRIES = 100
"""How many conditions that an action was tried in are reckoned with where it may do something new: the latest ones."""

ASSIGNMENT = "assignment"


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
            values = self.unchanged.setdefault(terms, {})
            value = before if before in values or len(values) < 2 else next(iter(values))  # two tell as much as all
            values[value] = values.get(value, 0) + 1
        else:
            for effect in effects:
                seen = self.effects.setdefault(effect.type, {}).setdefault(effect, {})
                seen[terms] = seen.get(terms, 0) + 1

    def met(self, terms: int) -> bool:
        """Whether there is an example under exactly these terms; even if it says nothing, another teaches no more."""
        return terms in self.unchanged or any(
            terms in seen for effects in self.effects.values() for seen in effects.values()
        )

    def simplest_type(self) -> str | None:
        """The type that explains the most changes, and these with the fewest effects; the first of equals."""

        def rank(name: str) -> tuple[int, int]:
            explained = sum(sum(seen.values()) for seen in self.effects[name].values())
            return -explained, len(self.effects[name])

        return min(self.effects, key=rank, default=None)

    def examples(self, effect: Effect) -> tuple[dict[int, int], dict[int, int]]:
        """How often an effect happened, and how often it did not, by terms.

        That := v left a v as it was says neither.
        """
        happened = self.effects[effect.type][effect]
        failed: dict[int, int] = {}
        for terms, values in self.unchanged.items():
            times = sum(times for value, times in values.items() if effect != Effect(ASSIGNMENT, value))
            if times:
                failed[terms] = times
        for other, seen in self.effects[effect.type].items():
            if other != effect:
                for terms, times in seen.items():
                    failed[terms] = failed.get(terms, 0) + times
        return happened, failed


@dataclass(frozen=True)
class Law:
    """An effect, and the conjunctions under one of which it is believed to happen.

    Attributes:
        effect: What happens.
        concepts: When; one, unless no single conjunction agrees with the examples.
    """

    effect: Effect
    concepts: tuple[Concept, ...]

    @classmethod
    def of(cls, effect: Effect, size: int, factor: float, positives: Iterable[int], negatives: Collection[int]) -> Law:
        """The law that some examples teach: every positive one joins the first conjunction that can take it in.

        Args:
            effect: What happened.
            size: n, the number of terms.
            factor: q, by how much a fixed term makes a hypothesis less likely.
            positives: Terms under which it happened.
            negatives: Terms under which it did not.
        """
        groups: list[list[int]] = []
        for terms in positives:
            for group in groups:
                if Concept.of(size, factor, (*group, terms), negatives).consistent:
                    group.append(terms)
                    break
            else:
                groups.append([terms])
        return cls(effect, tuple(Concept.of(size, factor, group, negatives) for group in groups))

    def probability(self, terms: int) -> float:
        """How likely the effect happens where exactly these terms hold."""
        return 1 - math.prod(1 - concept.probability(terms) for concept in self.concepts)

    def disagreement(self, terms: int) -> float:
        """How evenly the simplest explanations disagree whether it happens there: 1 is half against half."""
        return max(concept.disagreement(terms) for concept in self.concepts)


class ExpectedEffect(NamedTuple):
    """What may happen to one attribute.

    Attributes:
        attribute: Its name.
        effect: The most likely effect.
        chance: How likely that is.
        disagreement: How evenly the simplest explanations disagree about it.
    """

    attribute: str
    effect: Effect
    chance: float
    disagreement: float


class BayesianLearner:
    """Believes in simple laws.

    Args:
        domain: What states are described with.
        expected_terms: How many terms a hypothesis is expected to fix.
        novelty: How likely an action that is understood has yet another effect.
        effect_types: The effect types to consider.
        reward: R(s, a, s') where it is given; else it is learnt.
        terminated: Whether a state ends the episode, where that is given; else it is learnt.
    """

    def __init__(
        self,
        domain: Domain,
        *,
        expected_terms: float = EXPECTED_TERMS,
        novelty: float = NOVELTY,
        effect_types: Mapping[str, EffectType] = PAPER_TYPES,
        reward: RewardFunction | None = None,
        terminated: TerminationFunction | None = None,
    ) -> None:
        self.domain = domain
        self.factor = expected_terms / domain.size
        self.novelty = novelty
        self.effect_types = effect_types
        self.task = Task(reward, terminated)
        self.revisions = dict.fromkeys(domain.actions, 0)
        self.rewards = Rewards(domain.size, generalize=True)
        self.evidence: dict[Subject, Evidence] = {}
        self.laws: dict[Subject, tuple[Law, ...]] = {}
        self.tried: dict[str, dict[int, bool]] = {action: {} for action in domain.actions}
        self._never_seen: dict[str, Concept] = {}
        self._violations: dict[str, None] = {}
        self._predictions: dict[str, dict[tuple[tuple[str, ...], tuple[int, ...]], ConditionalPrediction]] = {}
        self._expectations: dict[Subject, dict[int, ExpectedEffect]] = {}
        self._lawful: dict[tuple[str, str], list[Subject]] = {}  # by action and class: the subjects that have laws

    @property
    def has_disagreement(self) -> bool:
        """Whether some law has more than one simplest explanation."""
        return any(len(concept.simplest) > 1 for laws in self.laws.values() for law in laws for concept in law.concepts)

    @property
    def violations(self) -> tuple[str, ...]:
        """Where the same action under the same condition once did this and once that, in words."""
        return (*self._violations, *self.rewards.violations(self.domain.term_names))

    def predict(self, state: State, action: Action) -> Prediction:
        """Tell what an action most likely does in a state, and what else it may do."""
        return self.conditional_prediction(state, action).ground(state, action)

    def state_key(self, state: State) -> Hashable:
        """What the answers for a state depend on: its conditions."""
        return conditions_key(self.domain, state)

    def conditional_prediction(self, state: State, action: Action) -> ConditionalPrediction:
        """What an action may do in all states of the same conditions; worked out once until more is learnt of it."""
        conditions = self.domain.conditions(state, action)
        kept = self._predictions.setdefault(action.name, {})
        prediction = kept.get((state.classes, conditions))
        if prediction is None:
            prediction = kept[state.classes, conditions] = self._believe(state, action.name, conditions)
        return prediction

    def _believe(self, state: State, action: str, conditions: tuple[int, ...]) -> ConditionalPrediction:
        """Three outcomes: the likely effects; those with the least certain one reversed; effects never seen."""
        whole, *own = conditions
        expected = [
            self._expected(action, item.object_class, terms) for item, terms in zip(state.objects, own, strict=True)
        ]
        chances = {effect.chance for effects in expected for effect in effects}
        sure = math.prod(max(chance, 1 - chance) for chance in chances)
        least_certain = min(chances, key=lambda chance: abs(chance - 0.5), default=0.0)
        surprise = self._surprise(action, whole)
        likely = tuple(_chosen(effects, flipped=None) for effects in expected)
        unlikely = tuple(_chosen(effects, flipped=least_certain) for effects in expected)
        step_rewards = self.rewards.step_rewards(action, whole)
        branches = (
            (self._outcome(likely, step_rewards), sure * (1 - surprise)),
            (self._outcome(unlikely, step_rewards), (1 - sure) * (1 - surprise)),
            (self._outcome(None, ()), surprise),
        )
        possible = [(branch, chance) for branch, chance in branches if chance > 0]
        disagreement = max((effect.disagreement for effects in expected for effect in effects), default=0.0)
        return ConditionalPrediction(tuple(sorted(possible, key=lambda entry: -entry[1])), disagreement)

    def _outcome(
        self, effects: tuple[ObjectEffects, ...] | None, step_rewards: tuple[StepReward, ...]
    ) -> EffectsOutcome:
        return EffectsOutcome(effects, step_rewards, self.effect_types, self.task)

    def _expected(self, action: str, object_class: ObjectClass, terms: int) -> list[ExpectedEffect]:
        """For every attribute that the action is known to change, the most likely effect."""
        return [self._expect(subject, terms) for subject in self._lawful.get((action, object_class.name), ())]

    def _expect(self, subject: Subject, terms: int) -> ExpectedEffect:
        """The most likely effect on one attribute; worked out once until more is learnt of it."""
        kept = self._expectations.setdefault(subject, {})
        expected = kept.get(terms)
        if expected is None:
            chance, law = max(((law.probability(terms), law) for law in self.laws[subject]), key=lambda entry: entry[0])
            disagreement = 0.0 if self.evidence[subject].met(terms) else law.disagreement(terms)
            expected = kept[terms] = ExpectedEffect(subject.attribute, law.effect, chance, disagreement)
        return expected

    def _surprise(self, action: str, whole: int) -> float:
        """How likely an action does something that it was never seen to do, by the conditions that it was tried in.

        What an action that never did anything needs is some conjunction, and likeliest to hold where least was tried.
        The same goes for the end of episodes, as long as none was seen: steps that all seem to be worth the same could
        otherwise go on for ever.
        """
        tried = self.tried[action]
        if whole in tried:
            return 0.0
        if not any(tried.values()):
            return self._unexplored(action, whole)
        if self.task.terminated is None and not self.rewards.end_seen:
            return max(self.novelty, END_SOMEWHERE * self._unexplored(action, whole))
        return self.novelty

    def _unexplored(self, action: str, whole: int) -> float:
        """How likely a conjunction that held in none of the conditions that an action was tried in holds here."""
        if action not in self._never_seen:
            self._never_seen[action] = Concept.of(
                self.domain.size, self.factor, (), [*self.tried[action]][-REMEMBERED_TRIES:]
            )
        return self._never_seen[action].probability(whole)

    def rules(self) -> tuple[Rule, ...]:
        """What is believed: for every effect the simplest conjunctions that agree with the examples."""
        rules = []
        for subject, laws in self.laws.items():
            name = f"{subject.class_name.lower()}.{subject.attribute}"
            for law in laws:
                effect = self.effect_types[law.effect.type].describe(name, law.effect.argument)
                for concept in law.concepts:
                    literals = concept.simplest[0] if concept.refuted else 0
                    rules.append(Rule(subject.action, condition_of(literals, concept.size), effect))
        return tuple(rules)

    def failure_conditions(self) -> dict[str, tuple[Condition, ...]]:
        """For each action, the conditions that it was tried in and never did anything."""
        return {
            action: tuple(Condition.of(self.domain.size, terms) for terms, succeeded in tried.items() if not succeeded)
            for action, tried in self.tried.items()
        }

    def sentences(self) -> tuple[str, ...]:
        """What is believed, in words."""
        return tuple(rule.words(self.domain.term_names) for rule in self.rules())

    def add_experience(self, transition: Transition) -> None:
        """Learn from one experience."""
        state, action = transition.state, transition.action.name
        whole, *own = self.domain.conditions(state, transition.action)
        end_was_seen = self.rewards.end_seen
        changed = self._learn_worth(transition, whole)
        if self.rewards.end_seen != end_was_seen:
            self._think_again()
        changed |= self._learn_to_expect(action, whole, succeeded=not transition.failed)
        for item, terms in zip(state.objects, own, strict=True):
            for attribute, before, after in observed_values(item, transition.next_state.get(item.name)):
                subject = Subject(action, item.object_class.name, attribute.name)
                changed |= self._learn(subject, attribute, terms, before, after)
        if changed:
            self.revisions[action] += 1
            self._predictions.pop(action, None)
            self._never_seen.pop(action, None)

    def _learn_to_expect(self, action: str, whole: int, *, succeeded: bool) -> bool:
        """Remember where an action was tried, and whether it did anything; return whether that is news."""
        tried = self.tried[action]
        news = whole not in tried or (succeeded and not any(tried.values()))
        tried[whole] = tried.get(whole, False) or succeeded
        return news

    def _learn(self, subject: Subject, attribute: Attribute, terms: int, before: Value, after: Value) -> bool:
        """Learn from what happened to one attribute of one object; return whether beliefs have changed."""
        evidence = self.evidence.setdefault(subject, Evidence())
        evidence.add(terms, before, after, effects_between(attribute, before, after, self.effect_types))
        self._expectations.get(subject, {}).pop(terms, None)
        return self._find_laws(subject)

    def reconsider(self) -> None:
        """Work out all laws from the evidence, after that was read from a file."""
        for subject in self.evidence:
            self._find_laws(subject)
        self._think_again()

    def _think_again(self) -> None:
        """Forget all answers, and let planners know."""
        self.revisions = {action: revision + 1 for action, revision in self.revisions.items()}
        self._predictions.clear()
        self._never_seen.clear()

    def _find_laws(self, subject: Subject) -> bool:
        """Work out the laws that the evidence supports; return whether they are others than before."""
        evidence = self.evidence[subject]
        chosen = evidence.simplest_type()
        found = [self._law(subject, effect) for effect in (evidence.effects[chosen] if chosen is not None else ())]
        laws = tuple(law for law in found if law is not None)
        if laws == self.laws.get(subject, ()):
            return False
        self.laws[subject] = laws
        self._expectations.pop(subject, None)
        self._lawful[subject.action, subject.class_name] = [
            Subject(subject.action, subject.class_name, attribute.name)
            for attribute in self.domain.classes_by_name[subject.class_name].changeable
            if self.laws.get(Subject(subject.action, subject.class_name, attribute.name))
        ]
        return True

    def _law(self, subject: Subject, effect: Effect) -> Law | None:
        """The law of an effect; None where it was seen less often than not, wherever it was seen.

        Robots slip. Under one and the same condition, what was seen more often is believed. A failure that fits no
        conjunction is believed when it has happened twice.
        """
        happened, failed = self.evidence[subject].examples(effect)
        positives = [terms for terms, times in happened.items() if times >= failed.get(terms, 0)]
        negatives = [terms for terms, times in failed.items() if times > happened.get(terms, 0)]
        if not positives:
            return None
        for terms in happened.keys() & failed.keys():
            self._report(f"{subject}: changed at one time and not at another", terms)
        whole = Concept.of(self.domain.size, self.factor, positives, ())
        slips = {terms for terms in negatives if failed[terms] == 1 and whole.covers(terms)}
        for terms in slips:
            self._report(f"{subject}: did not change where it should; this is believed if it happens again", terms)
        firm = [terms for terms in negatives if terms not in slips]
        return Law.of(effect, self.domain.size, self.factor, positives, firm)

    def _report(self, what: str, terms: int) -> None:
        """Put a contradiction into words."""
        condition = Condition.of(self.domain.size, terms).describe(self.domain.term_names)
        self._violations[f"{what} (where {condition})"] = None

    def _learn_worth(self, transition: Transition, whole: int) -> bool:
        """Learn the reward and whether the episode ended, unless both are given."""
        if self.task.reward is not None and self.task.terminated is not None:
            return False
        changed = changed_attributes(transition.state, transition.next_state)
        case = StepReward(changed, transition.reward, transition.terminated)
        return self.rewards.add(transition.action.name, whole, case)


def _chosen(effects: list[ExpectedEffect], flipped: float | None) -> ObjectEffects:
    """The effects that are more likely than not; those of one probability the other way round."""
    return tuple(
        (entry.attribute, (entry.effect,)) for entry in effects if (entry.chance > 0.5) != (entry.chance == flipped)
    )
