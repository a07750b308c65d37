"""What a model predicts for all states in which the same conditions hold.

A learner's answer depends on cond(s) only; what it makes of a state's values is worked out here. So a planner asks the
learner once for every condition that it meets, and not once for every state.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import NamedTuple, Protocol

from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.effects import Effect, EffectType, apply, value_of
from wherry.oomdp.mdp import IMPOSSIBLE, UNKNOWN, Model, Prediction, RewardFunction, TerminationFunction
from wherry.oomdp.objects import EXISTS, State, Value

ObjectEffects = tuple[tuple[str, tuple[Effect, ...]], ...]
"""For one object: the attributes that are said to change, each with the effects that explain it, one or more."""

Changed = frozenset[tuple[str, str]]
"""Which attributes took a new value: names of class and attribute. Empty: the action failed."""


class Worth(NamedTuple):
    """What a step that changed something, or nothing, is worth.

    Attributes:
        changed: What it changed.
        reward: r.
        terminated: Whether it ended the episode.
    """

    changed: Changed
    reward: float
    terminated: bool


@dataclass(frozen=True)
class Task:
    """What is given and need not be learnt.

    Attributes:
        reward: R(s, a, s'); None where it is to be learnt.
        terminated: Whether a state ends the episode; None where that is to be learnt.
    """

    reward: RewardFunction | None = None
    terminated: TerminationFunction | None = None


class Branch(Protocol):
    """One thing that an action may do in all states with the same key; equal branches predict the same."""

    def predict(self, state: State, action: Action) -> Prediction:
        """The prediction for one state, as if nothing else could happen."""
        ...


@dataclass(frozen=True)
class Answer:
    """What a model says of an action in all states with the same key.

    Attributes:
        branches: What may happen, most likely first, each with its probability.
        doubt: How much trying it would settle: 1 where two explanations disagree, 0 where nothing is in doubt.
    """

    branches: tuple[tuple[Branch, float], ...]
    doubt: float = 0.0

    def predict(self, state: State, action: Action) -> Prediction:
        """The prediction for one state."""
        possible = []
        for branch, probability in self.branches:
            told = branch.predict(state, action)
            if probability > 0 and told.probability > 0:
                possible.append((told, probability))
        if not possible:
            return IMPOSSIBLE
        (first, chance), *others = possible
        otherwise = tuple(Prediction(other.state, other.reward, other.terminated, chance) for other, chance in others)
        return Prediction(first.state, first.reward, first.terminated, chance, otherwise, self.doubt)


@dataclass(frozen=True)
class Outcome:
    """The effects that an action is said to have under some conditions, and what that is worth.

    Attributes:
        effects: For every object, in the state's order, what changes; None where the model cannot tell.
        worths: What is known of the rewards under these conditions.
        effect_types: The effect types by name.
        task: What is given.
    """

    effects: tuple[ObjectEffects, ...] | None
    worths: tuple[Worth, ...]
    effect_types: Mapping[str, EffectType] = field(compare=False, repr=False)
    task: Task

    def predict(self, state: State, action: Action) -> Prediction:
        """The prediction for one state; not known where effects are incompatible, not possible out of bounds."""
        effects = None if self.effects is None else self._compatible_effects(state, self.effects)
        if effects is None:
            return UNKNOWN
        next_state = apply(state, effects, self.effect_types) if effects else state
        if next_state is None:
            return IMPOSSIBLE
        worth = self._worth(changes(state, next_state))
        reward = None if worth is None else worth.reward
        terminated = None if worth is None else worth.terminated
        if self.task.reward is not None:
            reward = self.task.reward(state, action, next_state)
        if self.task.terminated is not None:
            terminated = self.task.terminated(next_state)
        return Prediction(next_state, reward, terminated)

    def _compatible_effects(
        self, state: State, effects: tuple[ObjectEffects, ...]
    ) -> list[tuple[int, str, Effect]] | None:
        """One effect for every attribute that changes; None where two effects on one attribute are incompatible."""
        chosen = []
        for position, attributes in enumerate(effects):
            for attribute, candidates in attributes:
                if len(candidates) > 1 and not self._compatible(
                    value_of(state.objects[position], attribute), candidates
                ):
                    return None
                chosen.append((position, attribute, candidates[0]))
        return chosen

    def _compatible(self, value: Value, effects: tuple[Effect, ...]) -> bool:
        """Whether all effects make the same of a value."""
        return len({self.effect_types[effect.type].apply(value, effect.argument) for effect in effects}) == 1

    def _worth(self, changed: Changed) -> Worth | None:
        return next((worth for worth in self.worths if worth.changed == changed), None)


def changes(state: State, next_state: State) -> Changed:
    """Which attributes of which classes differ between two states; an object that left changed its existence."""
    if state.objects == next_state.objects:
        return frozenset()
    later = {item.name: item for item in next_state.objects}
    found = set()
    for item in state.objects:
        after = later.get(item.name)
        name = item.object_class.name
        if after is None:
            found.add((name, EXISTS))
        elif after is not item:
            pairs = zip(item.object_class.attributes, item.values, after.values, strict=True)
            found.update((name, attribute.name) for attribute, old, new in pairs if old != new)
    return frozenset(found)


class ConditionalModel(Model, Protocol):
    """A model that gives all states with the same key the same answer."""

    @property
    def domain(self) -> Domain:
        """What states are described with."""
        ...

    @property
    def revisions(self) -> Mapping[str, int]:
        """For every action's name a number that grows whenever answers about it may have changed; 0 where missing."""
        ...

    @property
    def doubtful(self) -> bool:
        """Whether explanations disagree about some condition, so that an experiment could settle something."""
        ...

    def key(self, state: State) -> Hashable:
        """What the answers for a state depend on."""
        ...

    def answer(self, state: State, action: Action) -> Answer:
        """What an action does in all states with this state's key."""
        ...


def conditions_key(domain: Domain, state: State) -> Hashable:
    """The key of learners that look at conditions alone: the objects' classes, and all conditions for every action."""
    conditions = domain.conditions(state)
    if not domain.has_parameters:
        return state.classes, conditions
    actions = domain.ground_actions(state)
    return state.classes, actions, tuple(domain.conditions(state, action) for action in actions)


class Grounded:
    """Any model as a conditional one: every state is a key of its own.

    Args:
        domain: What states are described with.
        model: A model whose answers do not change.
    """

    revisions: Mapping[str, int] = MappingProxyType({})
    doubtful = False

    def __init__(self, domain: Domain, model: Model) -> None:
        self.domain = domain
        self.model = model

    def predict(self, state: State, action: Action) -> Prediction:
        """What the model says."""
        return self.model.predict(state, action)

    def key(self, state: State) -> Hashable:
        """The state itself."""
        return state

    def answer(self, state: State, action: Action) -> Answer:
        """What the model says of this one state."""
        prediction = self.model.predict(state, action)
        branches = (prediction, *prediction.otherwise)
        chances = [(Told(self.model, place), branch.probability) for place, branch in enumerate(branches)]
        return Answer(tuple(chances), prediction.doubt)


@dataclass(frozen=True, slots=True)
class Told:
    """What a model says of every state by itself.

    It is one and the same branch for all states: planners keep a row of all states for each branch.

    Attributes:
        model: Is asked again for each state; what it once said has to stay true.
        place: 0 for what is most likely, 1 for what is next, and so on.
    """

    model: Model
    place: int = 0

    def predict(self, state: State, action: Action) -> Prediction:
        """That branch of what the model predicts."""
        prediction = self.model.predict(state, action)
        return (prediction, *prediction.otherwise)[self.place]._replace(otherwise=())


@dataclass(frozen=True, slots=True)
class Fixed:
    """The same prediction, whatever the state."""

    prediction: Prediction

    def predict(self, state: State, action: Action) -> Prediction:
        """That prediction."""
        return self.prediction
