"""Models that predict the same for all states with the same key, such as all states in which the same terms hold.

A planner queries the model once for each key and caches the result; `ConditionalPrediction.ground` then gives the
prediction for a single state.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Protocol

from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.mdp import IMPOSSIBLE, Model, Outcome, Prediction
from wherry.oomdp.objects import State


class ConditionalOutcome(Protocol):
    """A possible outcome of an action in all states with the same key.

    Equal conditional outcomes must have equal outcomes in every state, since planners compute them only once.
    """

    def ground(self, state: State, action: Action) -> Outcome:
        """The outcome in one state; a probability of 0 means that it is impossible there, any other one is ignored."""
        ...


@dataclass(frozen=True)
class ConditionalPrediction:
    """The possible outcomes of an action in all states with the same key.

    Attributes:
        outcomes: The outcomes with their probabilities, the most likely first.
        disagreement: How evenly the model's hypotheses are split about the outcome, 0 to 1 (see `Prediction`).
    """

    outcomes: tuple[tuple[ConditionalOutcome, float], ...]
    disagreement: float = 0.0

    def ground(self, state: State, action: Action) -> Prediction:
        """The prediction for one state; outcomes that are impossible in it are dropped."""
        possible = []
        for outcome, probability in self.outcomes:
            grounded = outcome.ground(state, action)
            if probability > 0 and grounded.probability > 0:
                possible.append(Outcome(grounded.next_state, grounded.reward, grounded.terminated, probability))
        return Prediction(tuple(possible), self.disagreement) if possible else IMPOSSIBLE


class ConditionalModel(Model, Protocol):
    """A model that predicts the same for all states with the same key."""

    @property
    def domain(self) -> Domain:
        """The domain of the states."""
        ...

    @property
    def revisions(self) -> Mapping[str, int]:
        """Revision number by action name, 0 if absent; it grows when predictions for the action may have changed."""
        ...

    @property
    def has_disagreement(self) -> bool:
        """Whether hypotheses disagree about some outcome, so that an experiment could decide between them."""
        ...

    def state_key(self, state: State) -> Hashable:
        """The key of a state: predictions for states with equal keys are equal."""
        ...

    def conditional_prediction(self, state: State, action: Action) -> ConditionalPrediction:
        """The prediction for all states that have this state's key."""
        ...


def conditions_key(domain: Domain, state: State) -> Hashable:
    """The key for models that depend on conditions alone: the objects' classes and the conditions of every action."""
    conditions = domain.conditions(state)
    if not domain.has_parameters:
        return state.classes, conditions
    actions = domain.ground_actions(state)
    return state.classes, actions, tuple(domain.conditions(state, action) for action in actions)


class PerStateModel:
    """Adapter from a fixed model to a `ConditionalModel` in which every state is its own key.

    Args:
        domain: The domain of the states.
        model: A model whose predictions never change.
    """

    revisions: Mapping[str, int] = MappingProxyType({})
    has_disagreement = False

    def __init__(self, domain: Domain, model: Model) -> None:
        self.domain = domain
        self.model = model

    def predict(self, state: State, action: Action) -> Prediction:
        """The model's prediction."""
        return self.model.predict(state, action)

    def state_key(self, state: State) -> Hashable:
        """The state itself."""
        return state

    def conditional_prediction(self, state: State, action: Action) -> ConditionalPrediction:
        """The model's prediction for this one state."""
        prediction = self.model.predict(state, action)
        outcomes = tuple(
            (ModelOutcome(self.model, rank), outcome.probability) for rank, outcome in enumerate(prediction.outcomes)
        )
        return ConditionalPrediction(outcomes, prediction.disagreement)


@dataclass(frozen=True, slots=True)
class ModelOutcome:
    """A conditional outcome that queries a model in each state.

    It does not contain the state, so that planners need only one table row for each action and rank.

    Attributes:
        model: A model whose predictions never change once they are known.
        rank: Index into the predicted outcomes; 0 is the most likely one.
    """

    model: Model
    rank: int = 0

    def ground(self, state: State, action: Action) -> Outcome:
        """The outcome of this rank in the model's prediction."""
        return self.model.predict(state, action).outcomes[self.rank]


@dataclass(frozen=True, slots=True)
class ConstantOutcome:
    """A conditional outcome that is the same in every state."""

    outcome: Outcome

    def ground(self, state: State, action: Action) -> Outcome:
        """The outcome, whatever the state."""
        return self.outcome
