"""The base of learners whose predictions depend on the conditions alone: cached predictions, and learnt rewards."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Hashable, Mapping

from wherry.learning.rewards import Rewards
from wherry.oomdp.conditional_models import ConditionalPrediction, conditions_key
from wherry.oomdp.conditions import Condition
from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.effects import EffectType
from wherry.oomdp.effects_outcome import EffectsOutcome, GivenTask, ObjectEffects, StepReward, changed_attributes
from wherry.oomdp.mdp import Prediction, RewardFunction, TerminationFunction, Transition
from wherry.oomdp.objects import State

StateConditions = tuple[tuple[str, ...], tuple[int, ...]]
"""The classes of a state's objects; and cond(s) as bits, followed by the condition of each object."""


class ConditionLearner(ABC):
    """Base of learners that predict the same in all states with the same conditions.

    Args:
        domain: Domain whose states and actions are learnt about.
        effect_types: Effect types to consider, by name.
        reward: R(s, a, s') where it is given; None to learn it.
        terminated: Whether a state ends the episode where that is given; None to learn it.
        generalize_rewards: Whether a constant reward is predicted under conditions not met yet, too (see `Rewards`).

    Attributes:
        domain: Domain whose states and actions are learnt about.
        effect_types: Effect types to consider, by name.
        revisions: For each action's name a number that grows when predictions about it may have changed.
        rewards: Learnt rewards and ends of episodes.
        task: Reward and termination functions that are given.
    """

    def __init__(
        self,
        domain: Domain,
        effect_types: Mapping[str, EffectType],
        reward: RewardFunction | None,
        terminated: TerminationFunction | None,
        *,
        generalize_rewards: bool,
    ) -> None:
        self.domain = domain
        self.effect_types = effect_types
        self.task = GivenTask(reward, terminated)
        self.revisions = dict.fromkeys(domain.actions, 0)
        self.rewards = Rewards(domain.size, generalize=generalize_rewards)
        self._violations: dict[str, None] = {}
        self._predictions: dict[str, dict[StateConditions, ConditionalPrediction]] = {}

    def predict(self, state: State, action: Action) -> Prediction:
        """Return the possible outcomes of an action in a state."""
        return self.conditional_prediction(state, action).ground(state, action)

    def state_key(self, state: State) -> Hashable:
        """Return the state's conditions, on which alone predictions depend."""
        return conditions_key(self.domain, state)

    def conditional_prediction(self, state: State, action: Action) -> ConditionalPrediction:
        """Return the prediction for all states with this state's conditions, cached until more is learnt."""
        conditions = self.domain.conditions(state, action)
        cached = self._predictions.setdefault(action.name, {})
        prediction = cached.get((state.classes, conditions))
        if prediction is None:
            prediction = cached[state.classes, conditions] = self._predict(state, action.name, conditions)
        return prediction

    @abstractmethod
    def _predict(self, state: State, action: str, conditions: tuple[int, ...]) -> ConditionalPrediction:
        """Return the prediction for all states with some conditions.

        Args:
            state: One of these states.
            action: Name of the action.
            conditions: cond(s) as bits, followed by the condition of each object.
        """
        ...

    def _outcome(
        self, effects: tuple[ObjectEffects, ...] | None, step_rewards: tuple[StepReward, ...]
    ) -> EffectsOutcome:
        return EffectsOutcome(effects, step_rewards, self.effect_types, self.task)

    def _invalidate_predictions(self) -> None:
        """Drop all cached predictions, and increase the revisions of all actions so that planners drop theirs."""
        self.revisions = {action: revision + 1 for action, revision in self.revisions.items()}
        self._predictions.clear()

    def _learn_reward(self, transition: Transition, terms: int) -> bool:
        """Learn the reward and whether the episode ended, unless both are given.

        Returns:
            Whether predictions may have changed.
        """
        if self.task.reward is not None and self.task.terminated is not None:
            return False
        changed = changed_attributes(transition.state, transition.next_state)
        case = StepReward(changed, transition.reward, transition.terminated)
        return self.rewards.add(transition.action.name, terms, case)

    def _condition_in_words(self, terms: int) -> str:
        return Condition.of(self.domain.size, terms).describe(self.domain.term_names)
