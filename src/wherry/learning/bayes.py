"""A Bayesian learner that infers from few examples which effects an action has, and under which conjunction of terms.

It always predicts, with a probability, where DOORMAX says "I don't know" until it is certain. For every action and
attribute it chooses the effect type that explains the most changes, and among those the one with the fewest different
effects. For each effect it computes the posterior over conjunctions of terms (`wherry.learning.conjunctions`): the
prior prefers short conjunctions, and every example rules out those that it contradicts. An effect that no single
conjunction explains gets several.

A prediction may be wrong, so the learner is not KWIK; it is corrected by the examples that follow.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from wherry.learning.condition_learner import ConditionLearner
from wherry.learning.conjunctions import condition_of
from wherry.learning.effect_rules import Subject
from wherry.learning.evidence import Evidence
from wherry.learning.probabilistic_rules import LabelledExamples, ProbabilisticRule
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
NOVELTY = 1e-4  # probability that an action whose effects are known has a further effect, not observed so far


class ExpectedEffect(NamedTuple):
    """The most likely effect on one attribute.

    Attributes:
        attribute: Name of the attribute.
        effect: The effect.
        probability: Probability that the effect happens.
        disagreement: How evenly the simplest conjunctions disagree whether the effect happens, from 0 to 1; 1 is half
            against half.
    """

    attribute: str
    effect: Effect
    probability: float
    disagreement: float


class BayesianLearner(ConditionLearner):
    """Learns a rule with a probability for every effect.

    Args:
        domain: Domain whose states and actions are learnt about.
        expected_terms: Prior mean of the number of terms that a conjunction fixes: q = expected_terms / n for n terms.
        novelty: Probability that an action whose effects are known has a further effect, not observed so far.
        effect_types: Effect types to consider, by name.
        reward: R(s, a, s') where it is given; None to learn it.
        terminated: Whether a state ends the episode where that is given; None to learn it.

    Attributes:
        literal_odds: q, prior odds that a conjunction contains a literal.
        evidence: All examples, by action and attribute.
        effect_rules: Rules fitted to the examples, by action and attribute; one rule for each effect.
        unseen: Estimates how likely an action has an effect that was not observed so far.
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
        self.literal_odds = expected_terms / domain.size
        self.evidence: dict[Subject, Evidence] = {}
        self.effect_rules: dict[Subject, tuple[ProbabilisticRule, ...]] = {}
        self.unseen = UnseenEffects(domain.actions, domain.size, self.literal_odds, novelty)
        self._expected: dict[Subject, dict[int, ExpectedEffect]] = {}
        self._subjects_with_rules: dict[tuple[str, str], list[Subject]] = {}  # by action and class

    @property
    def has_disagreement(self) -> bool:
        """Whether some rule has more than one simplest conjunction."""
        return any(
            len(conjunction.simplest) > 1
            for rules in self.effect_rules.values()
            for rule in rules
            for conjunction in rule.conjunctions
        )

    @property
    def violations(self) -> tuple[str, ...]:
        """The conditions under which an action had different results at different times, in words."""
        return (*self._violations, *self.rewards.violations(self.domain.term_names))

    def _predict(self, state: State, action: str, conditions: tuple[int, ...]) -> ConditionalPrediction:
        """Return up to three outcomes.

        These are the likely effects; the same with the least certain effects reversed; and effects not observed so far.
        """
        state_terms, *object_terms = conditions
        expected = [
            self._expected_effects(action, item.object_class, terms)
            for item, terms in zip(state.objects, object_terms, strict=True)
        ]
        probabilities = {effect.probability for effects in expected for effect in effects}
        certain = math.prod(max(probability, 1 - probability) for probability in probabilities)
        least_certain = min(probabilities, key=lambda probability: abs(probability - 0.5), default=0.0)
        is_end_unseen = self.task.terminated is None and not self.rewards.has_seen_end
        unseen = self.unseen.probability(action, state_terms, is_end_unseen=is_end_unseen)
        likely = tuple(_choose(effects, reversed_probability=None) for effects in expected)
        unlikely = tuple(_choose(effects, reversed_probability=least_certain) for effects in expected)
        step_rewards = self.rewards.step_rewards(action, state_terms)
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
        subjects = self._subjects_with_rules.get((action, object_class.name), ())
        return [self._expected_effect(subject, terms) for subject in subjects]

    def _expected_effect(self, subject: Subject, terms: int) -> ExpectedEffect:
        """Return the most likely effect on one attribute, cached until more is learnt about it."""
        cached = self._expected.setdefault(subject, {})
        expected = cached.get(terms)
        if expected is None:
            candidates = ((rule.probability(terms), rule) for rule in self.effect_rules[subject])
            probability, rule = max(candidates, key=lambda candidate: candidate[0])
            disagreement = 0.0 if self.evidence[subject].has_example(terms) else rule.disagreement(terms)
            expected = cached[terms] = ExpectedEffect(subject.attribute, rule.effect, probability, disagreement)
        return expected

    def keep_simplest(self) -> None:
        """Do nothing: the rules of every attribute are of the simplest effect type already."""

    def rules(self) -> tuple[Rule, ...]:
        """Return for every effect the simplest conjunctions that agree with the examples."""
        simplest = []
        for subject, rules in self.effect_rules.items():
            name = f"{subject.class_name.lower()}.{subject.attribute}"
            for rule in rules:
                effect = self.effect_types[rule.effect.type].describe(name, rule.effect.argument)
                for conjunction in rule.conjunctions:
                    literals = conjunction.simplest[0] if conjunction.refuted else 0
                    simplest.append(Rule(subject.action, condition_of(literals, conjunction.size), effect))
        return tuple(simplest)

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
        state_terms, *object_terms = self.domain.conditions(state, transition.action)
        had_seen_end = self.rewards.has_seen_end
        has_changed = self._learn_reward(transition, state_terms)
        if self.rewards.has_seen_end != had_seen_end:
            self._invalidate_predictions()
        has_changed |= self.unseen.add(action, state_terms, succeeded=not transition.failed)
        for item, terms in zip(state.objects, object_terms, strict=True):
            for attribute, before, after in observed_values(item, transition.next_state.get(item.name)):
                subject = Subject(action, item.object_class.name, attribute.name)
                has_changed |= self._learn_effect(subject, attribute, terms, before, after)
        if has_changed:
            self.revisions[action] += 1
            self._predictions.pop(action, None)

    def _learn_effect(self, subject: Subject, attribute: Attribute, terms: int, before: Value, after: Value) -> bool:
        """Learn from a step's result for one attribute of one object; return whether the rules have changed."""
        evidence = self.evidence.setdefault(subject, Evidence())
        evidence.add(terms, before, after, effects_between(attribute, before, after, self.effect_types))
        self._expected.get(subject, {}).pop(terms, None)
        return self._fit_rules(subject)

    def refit(self) -> None:
        """Fit all rules to `evidence`, after a rules file was read into it."""
        for subject in self.evidence:
            self._fit_rules(subject)
        self.unseen.invalidate()
        self._invalidate_predictions()

    def _fit_rules(self, subject: Subject) -> bool:
        """Fit the rules of an attribute to the evidence; return whether they have changed."""
        evidence = self.evidence[subject]
        effect_type = evidence.simplest_type()
        effects = evidence.effects[effect_type] if effect_type is not None else ()
        rules = tuple(rule for effect in effects if (rule := self._fit_rule(subject, effect)) is not None)
        if rules == self.effect_rules.get(subject, ()):
            return False
        self.effect_rules[subject] = rules
        self._expected.pop(subject, None)
        self._subjects_with_rules[subject.action, subject.class_name] = [
            Subject(subject.action, subject.class_name, attribute.name)
            for attribute in self.domain.classes_by_name[subject.class_name].changeable
            if self.effect_rules.get(Subject(subject.action, subject.class_name, attribute.name))
        ]
        return True

    def _fit_rule(self, subject: Subject, effect: Effect) -> ProbabilisticRule | None:
        """Return the rule of an effect; None where the effect failed more often than not under every condition."""
        happened, failed = self.evidence[subject].examples(effect)
        examples = LabelledExamples.of(happened, failed, self.domain.size, self.literal_odds)
        if not examples.positives:
            return None
        for terms in examples.contradictory:
            self._report(f"{subject}: changed at one time and not at another", terms)
        for terms in examples.outliers:
            self._report(f"{subject}: did not change where it should; this counts only if it happens again", terms)
        return ProbabilisticRule.of(effect, self.domain.size, self.literal_odds, examples.positives, examples.negatives)

    def _report(self, violation: str, terms: int) -> None:
        """Add a contradiction under a condition, given as bits, to the violations."""
        self._violations[f"{violation} (where {self._condition_in_words(terms)})"] = None


def _choose(effects: list[ExpectedEffect], reversed_probability: float | None) -> ObjectEffects:
    """Return the effects with a probability above 0.5.

    Args:
        effects: Expected effects on one object.
        reversed_probability: Effects of this probability are chosen the other way round; None to reverse none.
    """
    return tuple(
        (entry.attribute, (entry.effect,))
        for entry in effects
        if (entry.probability > 0.5) != (entry.probability == reversed_probability)
    )
