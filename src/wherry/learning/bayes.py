"""A Bayesian learner that infers from few examples which effects an action has, and under which conjunction of terms.

It always predicts, with a probability, where DOORMAX says "I don't know" until it is certain. For every action and
attribute it chooses the effect type that explains all changes with the fewest different effects. For each effect it
computes the posterior over conjunctions of terms (`wherry.learning.concepts`): the prior prefers short conjunctions,
and every example rules out those that it contradicts. An effect that no single conjunction explains gets several.

A prediction may be wrong, so the learner is not KWIK; it is corrected by the examples that follow.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from wherry.learning.concepts import condition_of
from wherry.learning.condition_learner import ConditionLearner
from wherry.learning.effect_rules import Subject
from wherry.learning.evidence import Evidence
from wherry.learning.laws import Examples, Law
from wherry.learning.rules import Rule
from wherry.learning.unseen_effects import UnseenEffects
from wherry.oomdp.attributes import Attribute, Value
from wherry.oomdp.conditional_models import ConditionalPrediction
from wherry.oomdp.conditions import Condition
from wherry.oomdp.domain import Domain
from wherry.oomdp.effects import PAPER_TYPES, Effect, EffectType, effects_between, observed_values
from wherry.oomdp.effects_outcome import ObjectEffects
from wherry.oomdp.mdp import RewardFunction, TerminationFunction, Transition
from wherry.oomdp.objects import ObjectClass, State

EXPECTED_TERMS = 0.5  # prior mean of the number of terms that a conjunction fixes
NOVELTY = 1e-4  # probability that an action whose effects are known has another effect, never observed


class ExpectedEffect(NamedTuple):
    """The most likely effect on one attribute.

    Attributes:
        attribute: Name of the attribute.
        effect: The effect.
        probability: Probability that the effect happens.
        disagreement: How evenly the simplest explanations disagree whether it happens: 1 is half against half.
    """

    attribute: str
    effect: Effect
    probability: float
    disagreement: float


class BayesianLearner(ConditionLearner):
    """Learns the most likely law for every effect.

    Args:
        domain: Domain whose states and actions are learnt about.
        expected_terms: Prior mean of the number of terms that a conjunction fixes: q = expected_terms / n for n terms.
        novelty: Probability that an action whose effects are known has another effect, never observed.
        effect_types: Effect types to consider, by name.
        reward: R(s, a, s') where it is given; None to learn it.
        terminated: Whether a state ends the episode where that is given; None to learn it.
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
        super().__init__(domain, effect_types, reward, terminated, generalize_rewards=True)
        self.factor = expected_terms / domain.size
        self.evidence: dict[Subject, Evidence] = {}
        self.laws: dict[Subject, tuple[Law, ...]] = {}
        self.unseen = UnseenEffects(domain.actions, domain.size, self.factor, novelty)
        self._expected: dict[Subject, dict[int, ExpectedEffect]] = {}
        self._lawful: dict[tuple[str, str], list[Subject]] = {}  # subjects with laws, by action and class

    @property
    def has_disagreement(self) -> bool:
        """Whether some law has more than one simplest explanation."""
        return any(len(concept.simplest) > 1 for laws in self.laws.values() for law in laws for concept in law.concepts)

    @property
    def violations(self) -> tuple[str, ...]:
        """The conditions under which an action had different results at different times, in words."""
        return (*self._violations, *self.rewards.violations(self.domain.term_names))

    def _predict(self, state: State, action: str, conditions: tuple[int, ...]) -> ConditionalPrediction:
        """Three outcomes: the likely effects; those with the least certain one reversed; effects never observed."""
        whole, *own = conditions
        expected = [
            self._expected_effects(action, item.object_class, terms)
            for item, terms in zip(state.objects, own, strict=True)
        ]
        probabilities = {effect.probability for effects in expected for effect in effects}
        certain = math.prod(max(probability, 1 - probability) for probability in probabilities)
        least_certain = min(probabilities, key=lambda probability: abs(probability - 0.5), default=0.0)
        is_end_unseen = self.task.terminated is None and not self.rewards.end_seen
        unseen = self.unseen.probability(action, whole, is_end_unseen=is_end_unseen)
        likely = tuple(_choose(effects, reversed_probability=None) for effects in expected)
        unlikely = tuple(_choose(effects, reversed_probability=least_certain) for effects in expected)
        step_rewards = self.rewards.step_rewards(action, whole)
        outcomes = (
            (self._outcome(likely, step_rewards), certain * (1 - unseen)),
            (self._outcome(unlikely, step_rewards), (1 - certain) * (1 - unseen)),
            (self._outcome(None, ()), unseen),
        )
        possible = [(outcome, probability) for outcome, probability in outcomes if probability > 0]
        disagreement = max((effect.disagreement for effects in expected for effect in effects), default=0.0)
        return ConditionalPrediction(tuple(sorted(possible, key=lambda entry: -entry[1])), disagreement)

    def _expected_effects(self, action: str, object_class: ObjectClass, terms: int) -> list[ExpectedEffect]:
        """Return the most likely effect on every attribute that the action is known to change."""
        return [self._expected_effect(subject, terms) for subject in self._lawful.get((action, object_class.name), ())]

    def _expected_effect(self, subject: Subject, terms: int) -> ExpectedEffect:
        """Return the most likely effect on one attribute, cached until more is learnt of it."""
        cached = self._expected.setdefault(subject, {})
        expected = cached.get(terms)
        if expected is None:
            likelihoods = ((law.probability(terms), law) for law in self.laws[subject])
            probability, law = max(likelihoods, key=lambda entry: entry[0])
            disagreement = 0.0 if self.evidence[subject].has_example(terms) else law.disagreement(terms)
            expected = cached[terms] = ExpectedEffect(subject.attribute, law.effect, probability, disagreement)
        return expected

    def settle(self) -> None:
        """Do nothing: the laws of every attribute are of the simplest effect type already."""

    def rules(self) -> tuple[Rule, ...]:
        """Return for every effect the simplest conjunctions that agree with the examples."""
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
        """Return, for each action, the conditions under which it was tried and never had an effect."""
        return {
            action: tuple(Condition.of(self.domain.size, terms) for terms, succeeded in tried.items() if not succeeded)
            for action, tried in self.unseen.tried.items()
        }

    def sentences(self) -> tuple[str, ...]:
        """Return the rules in words."""
        return tuple(rule.describe(self.domain.term_names) for rule in self.rules())

    def add_experience(self, transition: Transition) -> None:
        """Learn from one transition."""
        state, action = transition.state, transition.action.name
        whole, *own = self.domain.conditions(state, transition.action)
        was_end_seen = self.rewards.end_seen
        has_changed = self._learn_reward(transition, whole)
        if self.rewards.end_seen != was_end_seen:
            self._invalidate_predictions()
        has_changed |= self.unseen.add(action, whole, succeeded=not transition.failed)
        for item, terms in zip(state.objects, own, strict=True):
            for attribute, before, after in observed_values(item, transition.next_state.get(item.name)):
                subject = Subject(action, item.object_class.name, attribute.name)
                has_changed |= self._learn_effect(subject, attribute, terms, before, after)
        if has_changed:
            self.revisions[action] += 1
            self._predictions.pop(action, None)

    def _learn_effect(self, subject: Subject, attribute: Attribute, terms: int, before: Value, after: Value) -> bool:
        """Learn from what happened to one attribute of one object; return whether the laws have changed."""
        evidence = self.evidence.setdefault(subject, Evidence())
        evidence.add(terms, before, after, effects_between(attribute, before, after, self.effect_types))
        self._expected.get(subject, {}).pop(terms, None)
        return self._fit_laws(subject)

    def reconsider(self) -> None:
        """Fit all laws to the evidence, after that was read from a file."""
        for subject in self.evidence:
            self._fit_laws(subject)
        self.unseen.invalidate()
        self._invalidate_predictions()

    def _fit_laws(self, subject: Subject) -> bool:
        """Fit the laws of an attribute to the evidence; return whether they have changed."""
        evidence = self.evidence[subject]
        effect_type = evidence.simplest_type()
        effects = evidence.effects[effect_type] if effect_type is not None else ()
        laws = tuple(law for effect in effects if (law := self._fit_law(subject, effect)) is not None)
        if laws == self.laws.get(subject, ()):
            return False
        self.laws[subject] = laws
        self._expected.pop(subject, None)
        self._lawful[subject.action, subject.class_name] = [
            Subject(subject.action, subject.class_name, attribute.name)
            for attribute in self.domain.classes_by_name[subject.class_name].changeable
            if self.laws.get(Subject(subject.action, subject.class_name, attribute.name))
        ]
        return True

    def _fit_law(self, subject: Subject, effect: Effect) -> Law | None:
        """Return the law of an effect; None where it failed more often than it happened under every condition."""
        happened, failed = self.evidence[subject].examples(effect)
        examples = Examples.of(happened, failed, self.domain.size, self.factor)
        if not examples.positives:
            return None
        for terms in examples.contradictory:
            self._report(f"{subject}: changed at one time and not at another", terms)
        for terms in examples.slips:
            self._report(f"{subject}: did not change where it should; this counts only if it happens again", terms)
        return Law.of(effect, self.domain.size, self.factor, examples.positives, examples.negatives)

    def _report(self, violation: str, terms: int) -> None:
        """Add a contradiction to the violations."""
        self._violations[f"{violation} (where {self._condition_in_words(terms)})"] = None


def _choose(effects: list[ExpectedEffect], reversed_probability: float | None) -> ObjectEffects:
    """Return the effects that are more likely than not, but those of one probability the other way round."""
    return tuple(
        (entry.attribute, (entry.effect,))
        for entry in effects
        if (entry.probability > 0.5) != (entry.probability == reversed_probability)
    )
