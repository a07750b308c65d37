"""Outcomes described by effects: the changed attributes, the reward, and whether the episode ends."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from wherry.oomdp.attributes import EXISTS, Value
from wherry.oomdp.domain import Action
from wherry.oomdp.effects import Effect, EffectType, apply_effects, value_of
from wherry.oomdp.mdp import IMPOSSIBLE, UNKNOWN, Outcome, RewardFunction, TerminationFunction
from wherry.oomdp.objects import State

ObjectEffects = tuple[tuple[str, tuple[Effect, ...]], ...]
"""The predicted effects on one object: the attributes that change, each with the effects that predict the change."""

ChangedAttributes = frozenset[tuple[str, str]]
"""Attributes that took a new value, as pairs of class name and attribute name; empty where the action failed."""


class StepReward(NamedTuple):
    """The reward and termination of steps that change the same attributes.

    Attributes:
        changed: The attributes that the step changes.
        reward: r.
        terminated: Whether the step ends the episode.
    """

    changed: ChangedAttributes
    reward: float
    terminated: bool


@dataclass(frozen=True)
class GivenTask:
    """The reward and termination functions that are given; a function that is None has to be learnt.

    Attributes:
        reward: R(s, a, s').
        terminated: Whether a state ends the episode.
    """

    reward: RewardFunction | None = None
    terminated: TerminationFunction | None = None


@dataclass(frozen=True)
class EffectsOutcome:
    """A conditional outcome: the effects of an action under some conditions, and the rewards known for them.

    Attributes:
        effects: The effects on every object, in the order of the state's objects; None where they are not known.
        step_rewards: The rewards that are known under these conditions, by the attributes that change.
        effect_types: The effect types by name.
        task: The reward and termination functions that are given.
    """

    effects: tuple[ObjectEffects, ...] | None
    step_rewards: tuple[StepReward, ...]
    effect_types: Mapping[str, EffectType] = field(compare=False, repr=False)
    task: GivenTask

    def ground(self, state: State, action: Action) -> Outcome:
        """The outcome in one state: unknown if effects contradict each other, impossible if one is out of bounds."""
        effects = None if self.effects is None else self._consistent_effects(state, self.effects)
        if effects is None:
            return UNKNOWN.most_likely
        next_state = apply_effects(state, effects, self.effect_types) if effects else state
        if next_state is None:
            return IMPOSSIBLE.most_likely
        known = self._known_reward(changed_attributes(state, next_state))
        reward = None if known is None else known.reward
        terminated = None if known is None else known.terminated
        if self.task.reward is not None:
            reward = self.task.reward(state, action, next_state)
        if self.task.terminated is not None:
            terminated = self.task.terminated(next_state)
        return Outcome(next_state, reward, terminated)

    def _consistent_effects(
        self, state: State, effects: tuple[ObjectEffects, ...]
    ) -> list[tuple[int, str, Effect]] | None:
        """One effect for every attribute that changes; None where effects on one attribute contradict each other."""
        chosen = []
        for position, attributes in enumerate(effects):
            for attribute, candidates in attributes:
                value = value_of(state.objects[position], attribute)
                if len(candidates) > 1 and not self._are_equivalent(value, candidates):
                    return None
                chosen.append((position, attribute, candidates[0]))
        return chosen

    def _are_equivalent(self, value: Value, effects: tuple[Effect, ...]) -> bool:
        """Whether all effects turn a value into the same new value."""
        return len({self.effect_types[effect.type].apply(value, effect.argument) for effect in effects}) == 1

    def _known_reward(self, changed: ChangedAttributes) -> StepReward | None:
        return next((known for known in self.step_rewards if known.changed == changed), None)


def changed_attributes(state: State, next_state: State) -> ChangedAttributes:
    """The attributes that differ between two states; for a removed object, its existence."""
    if state.objects == next_state.objects:
        return frozenset()
    later = {item.name: item for item in next_state.objects}
    changed = set()
    for item in state.objects:
        after = later.get(item.name)
        name = item.object_class.name
        if after is None:
            changed.add((name, EXISTS))
        elif after is not item:
            pairs = zip(item.object_class.attributes, item.values, after.values, strict=True)
            changed.update((name, attribute.name) for attribute, old, new in pairs if old != new)
    return frozenset(changed)
