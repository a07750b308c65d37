"""DOORMAX: deterministic OO-MDPs learnt from experience (paper, section 6; Diuk, Cohen and Littman, ICML 2008).

The paper prints the two algorithms with slips; they are corrected here as `docs/paper.md` tells. Two things are added,
since without them some runs never find the optimal policy: a type of effect that predicts what is then not observed is
refuted, and where all types of an action and attribute are gone that is reported, and the attribute is learnt anew from
its changes alone; if that fails too, the action is not explored for ever.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import Literal

from wherry.learning.near_miss import NearMisses
from wherry.learning.predictions import Predictions, Subject
from wherry.learning.rewards import Rewards
from wherry.learning.sentences import Rule
from wherry.oomdp.attributes import EXISTS, Attribute, Value
from wherry.oomdp.conditional_models import ConditionalPrediction, conditions_key
from wherry.oomdp.conditions import Condition
from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.effects import PAPER_TYPES, Effect, EffectType, effects_between, observed_values
from wherry.oomdp.effects_outcome import EffectsOutcome, ObjectEffects, StepReward, Task, changed_attributes
from wherry.oomdp.mdp import Prediction, RewardFunction, TerminationFunction, Transition
from wherry.oomdp.objects import ObjectClass, State

FailureScope = Literal["action", "attribute"]
Inference = Literal["memorise", "near-miss"]
OVERLAP = "the conditions of two effects overlap"


class Doormax:
    """The learner of the paper's section 6.

    Args:
        domain: What states are described with.
        max_effects: k, the most different effects of one type that an action has on an attribute. A Boolean that an
            action leaves alone needs two: := True where it is true, and := False where it is false.
        effect_types: The effect types to consider.
        refutation: Whether a type whose prediction turned out wrong is removed. False: to the letter of the paper.
        failure_scope: Whether a failure condition says that the action changes nothing at all ("action", the paper),
            or one is kept for every attribute ("attribute"). With several objects of a class an attribute may stay
            for different reasons (another lamp was switched off; this one was off already), which no condition
            explains; where that shows, "action" is given up for that attribute and said so.
        inference: Whether failure conditions are memorised ("memorise", the paper) or others are inferred from them
            ("near-miss", see `wherry.learning.near_miss`).
        reward: R(s, a, s') where it is given; else it is learnt.
        terminated: Whether a state ends the episode, where that is given; else it is learnt.
    """

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
        self.domain = domain
        self.max_effects = max_effects
        self.effect_types = effect_types
        self.refutation = refutation
        self.failure_scope = failure_scope
        self.task = Task(reward, terminated)
        self.revisions = dict.fromkeys(domain.actions, 0)
        self.predictions = Predictions(domain, effect_types)
        self.failures: dict[str | Subject, set[int]] = {}
        self.near_misses = NearMisses(domain.size) if inference == "near-miss" else None
        self.rewards = Rewards(domain.size, generalize=inference == "near-miss")
        self._violations: dict[str, None] = {}
        self._predictions: dict[str, dict[tuple[tuple[str, ...], tuple[int, ...]], ConditionalPrediction]] = {}

    @property
    def has_disagreement(self) -> bool:
        """Never: what it predicts, it is sure of."""
        return False

    @property
    def violations(self) -> tuple[str, ...]:
        """The assumptions that experience has contradicted, in words."""
        revoked = () if self.near_misses is None else self.near_misses.violations
        return (*self._violations, *revoked, *self.rewards.violations(self.domain.term_names))

    def predict(self, state: State, action: Action) -> Prediction:
        """Tell what an action does in a state (the paper's predictTransition, with the reward)."""
        return self.conditional_prediction(state, action).ground(state, action)

    def state_key(self, state: State) -> Hashable:
        """What the answers for a state depend on: its conditions."""
        return conditions_key(self.domain, state)

    def conditional_prediction(self, state: State, action: Action) -> ConditionalPrediction:
        """What an action does in all states of the same conditions; worked out once until more is learnt of it."""
        conditions = self.domain.conditions(state, action)
        kept = self._predictions.setdefault(action.name, {})
        prediction = kept.get((state.classes, conditions))
        if prediction is None:
            prediction = kept[state.classes, conditions] = self._predict_transition(state, action.name, conditions)
        return prediction

    def _predict_transition(self, state: State, action: str, conditions: tuple[int, ...]) -> ConditionalPrediction:
        """Algorithm 1, predictTransition(s, a), for all states of the same conditions.

        Incompatible effects (line 9) depend on the attribute's value and are told apart by `EffectsOutcome`.
        """
        whole, *own = conditions
        if self._is_failure(action, whole):  # line 1
            return self._conditional_prediction(
                ((),) * len(own), self.rewards.step_rewards(action, whole)
            )  # line 2: s' = s
        effects = []
        for item, terms in zip(state.objects, own, strict=True):
            found = self._object_effects(action, item.object_class, terms)
            if isinstance(found, Subject):  # line 9
                return self._conditional_prediction(None, (), float(self.predictions.alive(found)))  # line 10
            effects.append(found)
        return self._conditional_prediction(tuple(effects), self.rewards.step_rewards(action, whole))  # lines 13, 14

    def _object_effects(self, action: str, object_class: ObjectClass, terms: int) -> ObjectEffects | Subject:
        """Lines 3 to 8 for one object: what happens to all of its attributes, or the first that is not known.

        Of an object that leaves nothing else needs to be known.
        """
        attributes = []
        for subject in self.predictions.subjects[action, object_class.name]:  # line 3
            if terms in self.failures.get(subject, ()):
                continue  # it stays as it is
            found = self.predictions.effects(subject, terms)  # lines 5, 6
            if not found:
                return subject
            attributes.append((subject.attribute, found))
            if subject.attribute == EXISTS and all(effect.argument is False for effect in found):
                break
        return tuple(attributes)

    def _conditional_prediction(
        self, effects: tuple[ObjectEffects, ...] | None, step_rewards: tuple[StepReward, ...], probability: float = 1.0
    ) -> ConditionalPrediction:
        outcome = EffectsOutcome(effects, step_rewards, self.effect_types, self.task)
        return ConditionalPrediction(((outcome, probability),))

    def _is_failure(self, action: str, whole: int) -> bool:
        """Whether some c ∈ F_a covers cond(s), that is, equals it since c has no ``*``; or failure can be inferred."""
        if whole in self.failures.get(action, ()):
            return True
        return self.near_misses is not None and self.near_misses.fails(action, whole)

    def settle(self) -> None:
        """Keep only the type with the fewest effects, of equals the first, for every action and attribute.

        A guess (Occam's) that the paper does not make, for rules that are to be used in another world: what is always
        true of a small one, "destination.y := 4 where there is a wall to the north", contradicts the true rule there.
        """
        for subject, types in self.predictions.models.items():
            ranked = sorted((name for name in types if types[name]), key=lambda name: len(types[name]))
            for name in ranked[1:]:
                self.predictions.remove(subject, name, f"needs more effects than {ranked[0]}, or as many")
        self.revisions = {action: revision + 1 for action, revision in self.revisions.items()}
        self._predictions.clear()

    def rules(self) -> tuple[Rule, ...]:
        """The effects of every action; those that say that an attribute stays as it is are left out."""
        rules = []
        for subject, types in self.predictions.models.items():
            models = next((models for models in types.values() if models), {})
            for effect, model in models.items():
                if not self.predictions.keeps(subject, effect, model):
                    rules.append(Rule(subject.action, model, self.predictions.words(subject, effect)))
        return tuple(rules)

    def failure_conditions(self) -> dict[str, tuple[Condition, ...]]:
        """F_a: for each action, the conditions in which it changes nothing, or no attribute that it was seen with."""
        found: dict[str, tuple[Condition, ...]] = {}
        for scope, failures in self.failures.items():
            action = scope.action if isinstance(scope, Subject) else scope
            conditions = (Condition.of(self.domain.size, terms) for terms in sorted(failures))
            found[action] = tuple(dict.fromkeys((*found.get(action, ()), *conditions)))
        return found

    def sentences(self) -> tuple[str, ...]:
        """What was learnt, in words: the effects of every action, then where it is known to do nothing."""
        lines = [rule.words(self.domain.term_names) for rule in self.rules()]
        for scope, failures in self.failures.items():
            lines.append(f"{scope}: nothing happens under {len(failures)} other conditions")
        return tuple(lines)

    def add_experience(self, transition: Transition) -> None:
        """Algorithm 2, addExperience(s, a, s', k)."""
        state, action = transition.state, transition.action.name
        whole, *own = self.domain.conditions(state, transition.action)
        if transition.failed and self._may_have_slipped(transition, whole):
            return
        changed = self._learn_worth(transition, whole)
        if self.near_misses is not None:
            changed |= self.near_misses.add(action, whole, succeeded=not transition.failed)
        if self.failure_scope == "action" and transition.failed:  # line 1
            changed |= self._add_failure(action, whole)  # lines 3, 4
        else:
            if self.failure_scope == "action":
                changed |= self._retract_failure(action, whole)
            for item, terms in zip(state.objects, own, strict=True):
                condition = Condition.of(self.domain.size, terms)
                for attribute, before, after in observed_values(item, transition.next_state.get(item.name)):  # line 6
                    subject = Subject(action, item.object_class.name, attribute.name)
                    changed |= self._learn(subject, attribute, condition, before, after)
        if changed:
            self.revisions[action] += 1
            only_here = transition.failed and self.failure_scope == "action" and self.near_misses is None
            self._predictions[action] = {
                key: kept for key, kept in self._predictions.get(action, {}).items() if only_here and key[1][0] != whole
            }

    def _learn(self, subject: Subject, attribute: Attribute, condition: Condition, before: Value, after: Value) -> bool:
        """Learn from what happened to one attribute of one object; return whether that changed anything."""
        if self.from_changes_alone(subject):
            if before == after:
                return self._add_failure(subject, condition.value)
            self._retract_failure(subject, condition.value)
        effects = effects_between(attribute, before, after, self.effect_types)
        changed = self.refutation and self._refute(subject, condition.value, before != after, effects)
        for effect in effects:  # line 7
            if effect.type in self.predictions.models[subject]:
                changed |= self._add_effect(subject, condition, effect)
        if not self.predictions.alive(subject):
            self._report_no_type_left(subject)
            if self.refutation and not self.from_changes_alone(subject):
                self.failures[subject] = set()
                self.predictions.begin_anew(subject)
                self._learn(subject, attribute, condition, before, after)
        return changed

    def from_changes_alone(self, subject: Subject) -> bool:
        """Whether an attribute that stays as it is counts as a failure, and not as an effect that keeps it."""
        return self.failure_scope == "attribute" or subject in self.failures

    def _add_effect(self, subject: Subject, condition: Condition, effect: Effect) -> bool:
        """Lines 8 to 27: learn that an effect happened under a condition; return whether that changed anything."""
        models = self.predictions.models[subject][effect.type]
        before = models.get(effect)  # line 8
        if before is not None and before.covers(condition):
            return False
        others = [model for other, model in models.items() if other != effect]
        if before is not None:  # line 9
            merged = models[effect] = before.merge(condition)  # line 11
            if any(merged.covers(other) for other in others):  # line 12
                self.predictions.remove(subject, effect.type, OVERLAP)  # line 14
        elif any(condition.covers(other) or other.covers(condition) for other in others):  # line 18
            self.predictions.remove(subject, effect.type, OVERLAP)  # line 19
        else:
            models[effect] = condition  # line 21
            if len(models) > self.max_effects:  # line 23
                reason = f"more than {self.max_effects} different effects"
                self.predictions.remove(subject, effect.type, reason)  # line 24
        return True

    def _refute(self, subject: Subject, terms: int, changed: bool, effects: tuple[Effect, ...]) -> bool:
        """Remove the types that predicted another effect than was observed, or that no change such as this one has.

        The paper lacks this step: a wrong type whose conditions never overlap stays for ever, and contradicts the true
        one for ever.
        """
        predictions = self.predictions
        wrong = [effect.type for effect in predictions.effects(subject, terms) if effect not in effects]
        for effect_type in dict.fromkeys(wrong):
            predictions.remove(subject, effect_type, "predicted what was not observed")
        if not changed:
            return bool(wrong)
        possible = {effect.type for effect in effects}
        helpless = [name for name in predictions.models[subject] if name not in possible]
        for effect_type in helpless:
            predictions.remove(subject, effect_type, "cannot explain a change")
        return bool(wrong or helpless)

    def _may_have_slipped(self, transition: Transition, whole: int) -> bool:
        """Whether an action failed, for the first time, where it was certain to succeed; says so (not in the paper).

        Under the assumptions this never happens. Robots slip, so it is believed when it happens again.
        """
        action = transition.action
        expected = self.predict(transition.state, action).most_likely.next_state
        if not self.refutation or expected is None or expected is transition.state:
            return False
        words = Condition.of(self.domain.size, whole).describe(self.domain.term_names)
        slip = f"{action.name}: did nothing where it should; this is believed if it happens again (where {words})"
        if slip in self._violations:
            return False
        self._violations[slip] = None
        return True

    def _add_failure(self, scope: str | Subject, terms: int) -> bool:
        """Lines 3 and 4: F ← F ∪ {cond(s)}; return whether that is new. No condition of F has a * to be removed for."""
        failures = self.failures.setdefault(scope, set())
        if terms in failures:
            return False
        failures.add(terms)
        return True

    def _retract_failure(self, scope: str | Subject, terms: int) -> bool:
        """Forget a failure condition that a success contradicts, and say so; return whether there was one."""
        if terms not in self.failures.get(scope, ()):
            return False
        self.failures[scope].remove(terms)
        words = Condition.of(self.domain.size, terms).describe(self.domain.term_names)
        self._violations[f"{scope}: changed something where it had changed nothing before ({words})"] = None
        return True

    def _report_no_type_left(self, subject: Subject) -> None:
        """Say so in words; what it leads to depends on whether the attribute is learnt from its changes alone."""
        reasons = "; ".join(f"{name}: {reason}" for name, reason in self.predictions.removed[subject].items())
        known = "its changes" if self.from_changes_alone(subject) else "where it changes and where it stays"
        self._violations[f"{subject}: no type of effect explains {known} ({reasons})"] = None

    def _learn_worth(self, transition: Transition, whole: int) -> bool:
        """Learn the reward and whether the episode ended, unless both are given."""
        if self.task.reward is not None and self.task.terminated is not None:
            return False
        changed = changed_attributes(transition.state, transition.next_state)
        case = StepReward(changed, transition.reward, transition.terminated)
        return self.rewards.add(transition.action.name, whole, case)
