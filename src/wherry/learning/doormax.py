"""DOORMAX: deterministic OO-MDPs learnt from experience (paper, section 6; Diuk, Cohen and Littman, ICML 2008).

The two printed algorithms contain errors, which are corrected here as `docs/paper.md` describes. Two steps are added,
because without them some runs never find the optimal policy. An effect type whose prediction was wrong is refuted.
Where all types of an action and attribute have been refuted, this is reported, and the attribute is learnt again from
its changes alone; if that fails too, the action is no longer explored for that attribute.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from wherry.learning.condition_learner import ConditionLearner
from wherry.learning.effect_rules import EffectRules, Subject
from wherry.learning.failures import FailureConditions, FailureKey
from wherry.learning.near_miss import NearMisses
from wherry.learning.rules import Rule
from wherry.oomdp.attributes import EXISTS, Attribute, Value
from wherry.oomdp.conditional_models import ConditionalPrediction
from wherry.oomdp.conditions import Condition
from wherry.oomdp.domain import Domain
from wherry.oomdp.effects import PAPER_TYPES, EffectType, effects_between, observed_values
from wherry.oomdp.effects_outcome import ObjectEffects, StepReward
from wherry.oomdp.mdp import RewardFunction, TerminationFunction, Transition
from wherry.oomdp.objects import ObjectClass, State

FailureScope = Literal["action", "attribute"]
Inference = Literal["memorise", "near-miss"]


class Doormax(ConditionLearner):
    """The learner of the paper's section 6.

    Args:
        domain: Domain whose states and actions are learnt about.
        max_effects: k, largest number of different effects of one type that an action has on an attribute. A Boolean
            that an action does not change needs two: := True where it is true, and := False where it is false.
        effect_types: Effect types to consider, by name.
        refutation: Whether a type whose prediction turned out wrong is removed; False is the paper's algorithm.
        failure_scope: With "action", as in the paper, a failure condition says that the action changes nothing at all;
            with "attribute", each attribute has failure conditions of its own. With several objects of a class an
            attribute may keep its value for different reasons (another lamp was switched off; this one was off
            already), which no condition explains. Such an attribute is reported and then learnt as with "attribute".
        inference: With "memorise", as in the paper, failure conditions are only memorised; with "near-miss", further
            ones are inferred from them (see `wherry.learning.near_miss`).
        reward: R(s, a, s') where it is given; None to learn it.
        terminated: Whether a state ends the episode where that is given; None to learn it.

    Raises:
        ValueError: ``inference`` is "near-miss" and ``failure_scope`` is "attribute".

    Attributes:
        effect_rules: P, the rules of all actions and attributes.
        failures: F, the failure conditions.
        near_misses: Infers further failures; None where failures are only memorised.
    """

    has_disagreement = False

    def __init__(
        self,
        domain: Domain,
        *,
        max_effects: int = 2,
        effect_types: Mapping[str, EffectType] = PAPER_TYPES,
        refutation: bool = True,
        failure_scope: FailureScope = "action",
        inference: Inference = "memorise",
        reward: RewardFunction | None = None,
        terminated: TerminationFunction | None = None,
    ) -> None:
        if inference == "near-miss" and failure_scope != "action":
            raise ValueError("near misses are inferred from failures of whole actions, not of attributes")
        super().__init__(domain, effect_types, reward, terminated, generalize_rewards=inference == "near-miss")
        self.max_effects = max_effects
        self.refutation = refutation
        self.failure_scope = failure_scope
        self.effect_rules = EffectRules(domain, effect_types, max_effects)
        self.failures = FailureConditions(domain.size)
        self.near_misses = NearMisses(domain.size) if inference == "near-miss" else None

    @property
    def violations(self) -> tuple[str, ...]:
        """The assumptions that experience has contradicted, in words."""
        revoked = () if self.near_misses is None else self.near_misses.violations
        return (*self._violations, *revoked, *self.rewards.violations(self.domain.term_names))

    def _predict(self, state: State, action: str, conditions: tuple[int, ...]) -> ConditionalPrediction:
        """Algorithm 1, predictTransition(s, a), with the reward.

        Whether effects are incompatible (line 9) depends on the attribute's value and is decided by `EffectsOutcome`.
        """
        state_terms, *object_terms = conditions
        step_rewards = self.rewards.step_rewards(action, state_terms)
        if self._is_failure(action, state_terms):  # line 1
            return self._certain(((),) * len(object_terms), step_rewards)  # line 2: s' = s
        effects = []
        for item, terms in zip(state.objects, object_terms, strict=True):
            prediction = self._object_effects(action, item.object_class, terms)
            if isinstance(prediction, Subject):  # line 9
                return self._unknown(prediction)  # line 10
            effects.append(prediction)
        return self._certain(tuple(effects), step_rewards)  # lines 13, 14

    def _object_effects(self, action: str, object_class: ObjectClass, terms: int) -> ObjectEffects | Subject:
        """Lines 3 to 8 for one object: the effects on all of its attributes, or the first subject without a known one.

        For an object that leaves, no other attribute needs to be known.
        """
        attributes = []
        for subject in self.effect_rules.subjects[action, object_class.name]:  # line 3
            if self.failures.has(subject, terms):
                continue
            effects = self.effect_rules.effects(subject, terms)  # lines 5, 6
            if not effects:
                return subject
            attributes.append((subject.attribute, effects))
            if subject.attribute == EXISTS and all(effect.argument is False for effect in effects):
                break
        return tuple(attributes)

    def _certain(
        self, effects: tuple[ObjectEffects, ...], step_rewards: tuple[StepReward, ...]
    ) -> ConditionalPrediction:
        return ConditionalPrediction(((self._outcome(effects, step_rewards), 1.0),))

    def _unknown(self, subject: Subject) -> ConditionalPrediction:
        """Return "I don't know"; its probability is 0 where no effect type is left, as nothing more can be learnt."""
        return ConditionalPrediction(((self._outcome(None, ()), float(self.effect_rules.has_effect_type(subject))),))

    def _is_failure(self, action: str, state_terms: int) -> bool:
        """Return whether the action fails under cond(s): some c ∈ F_a covers it, or a failure is inferred.

        Conditions in F have no *, so c covers cond(s) only where both are equal.
        """
        if self.failures.has(action, state_terms):
            return True
        return self.near_misses is not None and self.near_misses.fails(action, state_terms)

    def keep_simplest(self) -> None:
        """Keep, for every action and attribute, only the effect type with the fewest effects, of equals the first.

        This step is not in the paper (Occam's razor). Rules for another world need it: in a small world it may always
        be true that "destination.y := 4 where there is a wall to the north", which contradicts the true rule elsewhere.
        """
        self.effect_rules.keep_simplest_types()
        self._invalidate_predictions()

    def rules(self) -> tuple[Rule, ...]:
        """Return the effects of every action, except those that only keep an attribute's value."""
        rules = []
        for subject, types in self.effect_rules.models.items():
            models = next((models for models in types.values() if models), {})
            for effect, model in models.items():
                if not self.effect_rules.is_identity(subject, effect, model):
                    rules.append(Rule(subject.action, model, self.effect_rules.describe(subject, effect)))
        return tuple(rules)

    def failure_conditions(self) -> dict[str, tuple[Condition, ...]]:
        """Return F_a: for each action, the conditions under which it changes nothing, or not all it ever changed."""
        return self.failures.by_action()

    def sentences(self) -> tuple[str, ...]:
        """Return in words the effects of every action, and the number of its failure conditions."""
        lines = [rule.describe(self.domain.term_names) for rule in self.rules()]
        for key, failures in self.failures.conditions.items():
            lines.append(f"{key}: nothing happens under {len(failures)} other conditions")
        return tuple(lines)

    def add_experience(self, transition: Transition) -> None:
        """Algorithm 2, addExperience(s, a, s', k)."""
        action = transition.action.name
        state_terms, *object_terms = self.domain.conditions(transition.state, transition.action)
        if transition.failed and self._is_first_unexpected_failure(transition, state_terms):
            return
        has_changed = self._learn_reward(transition, state_terms)
        if self.near_misses is not None:
            has_changed |= self.near_misses.add(action, state_terms, succeeded=not transition.failed)
        if self.failure_scope == "action" and transition.failed:  # line 1
            has_changed |= self.failures.add(action, state_terms)  # lines 3, 4
        else:
            if self.failure_scope == "action":
                has_changed |= self._retract_failure(action, state_terms)
            has_changed |= self._learn_effects(transition, object_terms)
        if has_changed:
            self.revisions[action] += 1
            is_local = transition.failed and self.failure_scope == "action" and self.near_misses is None
            cached = self._predictions.get(action, {}) if is_local else {}  # else any prediction may have changed
            self._predictions[action] = {key: kept for key, kept in cached.items() if key[1][0] != state_terms}

    def _learn_effects(self, transition: Transition, object_terms: list[int]) -> bool:
        """Learn from a step's effects on all objects; return whether any rule changed.

        Args:
            transition: The step.
            object_terms: Condition of every object, as bits.
        """
        has_changed = False
        for item, terms in zip(transition.state.objects, object_terms, strict=True):
            condition = Condition.of(self.domain.size, terms)
            for attribute, before, after in observed_values(item, transition.next_state.get(item.name)):  # line 6
                subject = Subject(transition.action.name, item.object_class.name, attribute.name)
                has_changed |= self._learn_effect(subject, attribute, condition, before, after)
        return has_changed

    def _learn_effect(
        self, subject: Subject, attribute: Attribute, condition: Condition, before: Value, after: Value
    ) -> bool:
        """Learn from a step's effect on one attribute of one object; return whether any rule changed."""
        if self.learns_from_changes_alone(subject):
            if before == after:
                return self.failures.add(subject, condition.value)
            self._retract_failure(subject, condition.value)
        rules, effects = self.effect_rules, effects_between(attribute, before, after, self.effect_types)
        has_changed = self.refutation and rules.refute(subject, condition.value, effects, has_changed=before != after)
        for effect in effects:  # line 7
            if effect.type in rules.models[subject]:
                has_changed |= rules.add(subject, condition, effect)
        if not rules.has_effect_type(subject):
            self._report_no_type_left(subject)
            if self.refutation and not self.learns_from_changes_alone(subject):
                self.failures.conditions[subject] = set()
                rules.reset(subject)
                self._learn_effect(subject, attribute, condition, before, after)
        return has_changed

    def learns_from_changes_alone(self, subject: Subject) -> bool:
        """Return whether steps in which an attribute keeps its value count as failures, not as the effect += 0."""
        return self.failure_scope == "attribute" or subject in self.failures.conditions

    def _is_first_unexpected_failure(self, transition: Transition, state_terms: int) -> bool:
        """Return whether an action failed for the first time where it was predicted to succeed, and report that.

        Under the paper's assumptions this never happens. A robot's actuators fail at times, so such a failure is
        ignored until it happens again.
        """
        action = transition.action
        expected = self.predict(transition.state, action).most_likely.next_state
        if not self.refutation or expected is None or expected is transition.state:
            return False
        condition = self._condition_in_words(state_terms)
        report = f"{action.name}: did nothing where it should; this counts only if it happens again (where {condition})"
        if report in self._violations:
            return False
        self._violations[report] = None
        return True

    def _retract_failure(self, key: FailureKey, terms: int) -> bool:
        """Remove a failure condition that a success contradicts, and report it; return whether there was one."""
        was_failure = self.failures.discard(key, terms)
        if was_failure:
            condition = self._condition_in_words(terms)
            self._violations[f"{key}: changed something where it had changed nothing before ({condition})"] = None
        return was_failure

    def _report_no_type_left(self, subject: Subject) -> None:
        """Report that no effect type explains the observations of an attribute."""
        reasons = "; ".join(f"{name}: {reason}" for name, reason in self.effect_rules.removed[subject].items())
        observed = "its changes" if self.learns_from_changes_alone(subject) else "where it changes and where it stays"
        self._violations[f"{subject}: no type of effect explains {observed} ({reasons})"] = None
