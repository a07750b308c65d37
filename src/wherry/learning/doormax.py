"""DOORMAX: deterministic OO-MDPs learnt from experience (paper, section 6; Diuk, Cohen and Littman, ICML 2008).

The paper prints the two algorithms with slips, which are corrected here as `docs/paper.md` describes. Two steps are
added, because without them some runs never find the optimal policy. An effect type that predicted what was then not
observed is refuted. Where all types of an action and attribute have been refuted, this is reported, and the attribute
is learnt again from its changes alone; if that fails too, the action is no longer explored for that attribute.
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
            that an action leaves alone needs two: := True where it is true, and := False where it is false.
        effect_types: Effect types to consider, by name.
        refutation: Whether a type whose prediction turned out wrong is removed; False is the paper's algorithm.
        failure_scope: Whether a failure condition says that the action changes nothing at all ("action", the paper),
            or one is kept for every attribute ("attribute"). With several objects of a class an attribute may keep its
            value for different reasons (another lamp was switched off; this one was off already), which no condition
            explains. An attribute that shows this is learnt as with "attribute", which is reported.
        inference: Whether failure conditions are memorised ("memorise", the paper) or others are inferred from them
            ("near-miss", see `wherry.learning.near_miss`).
        reward: R(s, a, s') where it is given; None to learn it.
        terminated: Whether a state ends the episode where that is given; None to learn it.

    Raises:
        ValueError: Near misses are to be inferred from failures of attributes.
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
        whole, *own = conditions
        step_rewards = self.rewards.step_rewards(action, whole)
        if self._is_failure(action, whole):  # line 1
            return self._certain(((),) * len(own), step_rewards)  # line 2: s' = s
        effects = []
        for item, terms in zip(state.objects, own, strict=True):
            found = self._object_effects(action, item.object_class, terms)
            if isinstance(found, Subject):  # line 9
                return self._unknown(found)  # line 10
            effects.append(found)
        return self._certain(tuple(effects), step_rewards)  # lines 13, 14

    def _object_effects(self, action: str, object_class: ObjectClass, terms: int) -> ObjectEffects | Subject:
        """Lines 3 to 8 for one object: the effects on all of its attributes, or the first subject that is not known.

        Of an object that leaves, no other attribute needs to be known.
        """
        attributes = []
        for subject in self.effect_rules.subjects[action, object_class.name]:  # line 3
            if self.failures.has(subject, terms):
                continue
            found = self.effect_rules.effects(subject, terms)  # lines 5, 6
            if not found:
                return subject
            attributes.append((subject.attribute, found))
            if subject.attribute == EXISTS and all(effect.argument is False for effect in found):
                break
        return tuple(attributes)

    def _certain(
        self, effects: tuple[ObjectEffects, ...], step_rewards: tuple[StepReward, ...]
    ) -> ConditionalPrediction:
        return ConditionalPrediction(((self._outcome(effects, step_rewards), 1.0),))

    def _unknown(self, subject: Subject) -> ConditionalPrediction:
        """Return "I don't know"; its probability is 0 where no effect type is left, so that nothing can be learnt."""
        return ConditionalPrediction(((self._outcome(None, ()), float(self.effect_rules.is_alive(subject))),))

    def _is_failure(self, action: str, whole: int) -> bool:
        """Return whether some c ∈ F_a equals cond(s), which c covers only then as it has no *; or it is inferred."""
        if self.failures.has(action, whole):
            return True
        return self.near_misses is not None and self.near_misses.fails(action, whole)

    def settle(self) -> None:
        """Keep only the effect type with the fewest effects, of equals the first, for every action and attribute.

        The paper does not make this guess (Occam's razor). Rules for another world need it: in a small world it may
        always be true that "destination.y := 4 where there is a wall to the north", which contradicts the true rule.
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
        whole, *own = self.domain.conditions(transition.state, transition.action)
        if transition.failed and self._may_have_slipped(transition, whole):
            return
        has_changed = self._learn_reward(transition, whole)
        if self.near_misses is not None:
            has_changed |= self.near_misses.add(action, whole, succeeded=not transition.failed)
        if self.failure_scope == "action" and transition.failed:  # line 1
            has_changed |= self.failures.add(action, whole)  # lines 3, 4
        else:
            if self.failure_scope == "action":
                has_changed |= self._retract_failure(action, whole)
            has_changed |= self._learn_effects(transition, own)
        if has_changed:
            self.revisions[action] += 1
            only_here = transition.failed and self.failure_scope == "action" and self.near_misses is None
            self._predictions[action] = {
                key: kept for key, kept in self._predictions.get(action, {}).items() if only_here and key[1][0] != whole
            }

    def _learn_effects(self, transition: Transition, own: list[int]) -> bool:
        """Learn from what happened to all objects, given their own conditions; return whether anything changed."""
        has_changed = False
        for item, terms in zip(transition.state.objects, own, strict=True):
            condition = Condition.of(self.domain.size, terms)
            for attribute, before, after in observed_values(item, transition.next_state.get(item.name)):  # line 6
                subject = Subject(transition.action.name, item.object_class.name, attribute.name)
                has_changed |= self._learn_effect(subject, attribute, condition, before, after)
        return has_changed

    def _learn_effect(
        self, subject: Subject, attribute: Attribute, condition: Condition, before: Value, after: Value
    ) -> bool:
        """Learn from what happened to one attribute of one object; return whether anything changed."""
        if self.learns_from_changes_alone(subject):
            if before == after:
                return self.failures.add(subject, condition.value)
            self._retract_failure(subject, condition.value)
        rules, effects = self.effect_rules, effects_between(attribute, before, after, self.effect_types)
        has_changed = self.refutation and rules.refute(subject, condition.value, effects, has_changed=before != after)
        for effect in effects:  # line 7
            if effect.type in rules.models[subject]:
                has_changed |= rules.add(subject, condition, effect)
        if not rules.is_alive(subject):
            self._report_no_type_left(subject)
            if self.refutation and not self.learns_from_changes_alone(subject):
                self.failures.conditions[subject] = set()
                rules.reset(subject)
                self._learn_effect(subject, attribute, condition, before, after)
        return has_changed

    def learns_from_changes_alone(self, subject: Subject) -> bool:
        """Return whether an attribute that keeps its value counts as a failure, and not as an effect that keeps it."""
        return self.failure_scope == "attribute" or subject in self.failures.conditions

    def _may_have_slipped(self, transition: Transition, whole: int) -> bool:
        """Return whether an action failed, for the first time, where it was certain to succeed, and report that.

        Under the paper's assumptions this never happens. Robots slip, so the failure counts only when it happens again.
        """
        action = transition.action
        expected = self.predict(transition.state, action).most_likely.next_state
        if not self.refutation or expected is None or expected is transition.state:
            return False
        condition = self._condition_in_words(whole)
        slip = f"{action.name}: did nothing where it should; this counts only if it happens again (where {condition})"
        if slip in self._violations:
            return False
        self._violations[slip] = None
        return True

    def _retract_failure(self, key: FailureKey, terms: int) -> bool:
        """Remove a failure condition that a success contradicts, and report it; return whether there was one."""
        was_failure = self.failures.discard(key, terms)
        if was_failure:
            condition = self._condition_in_words(terms)
            self._violations[f"{key}: changed something where it had changed nothing before ({condition})"] = None
        return was_failure

    def _report_no_type_left(self, subject: Subject) -> None:
        """Report that no effect type explains what was seen of an attribute."""
        reasons = "; ".join(f"{name}: {reason}" for name, reason in self.effect_rules.removed[subject].items())
        seen = "its changes" if self.learns_from_changes_alone(subject) else "where it changes and where it stays"
        self._violations[f"{subject}: no type of effect explains {seen} ({reasons})"] = None
