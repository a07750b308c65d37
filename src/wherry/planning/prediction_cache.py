"""A cache of a model's predictions for all actions in a state, kept until the model revises them."""

from __future__ import annotations

from typing import NamedTuple

from wherry.oomdp.conditional_models import ConditionalModel, ConditionalPrediction
from wherry.oomdp.domain import Action
from wherry.oomdp.mdp import Prediction
from wherry.oomdp.objects import State

ActionPredictions = tuple[tuple[Action, Prediction], ...]
"""The ground actions in a state, each with its prediction."""


class PredictionCache:
    """Grounds a model lazily: predictions for a state are computed when a search first expands it.

    Repeating a search after every step is cheap, because predictions are recomputed only for actions that the model has
    revised in between.

    Args:
        model: The model to search on.
    """

    def __init__(self, model: ConditionalModel) -> None:
        self.model = model
        self._entries: dict[State, _Entry] = {}
        self._revisions: dict[str, int] = {}
        self._excluded: set[tuple[State, Action]] = set()

    def exclude(self, state: State, action: Action) -> None:
        """Exclude an action from a state's actions from now on, whatever the model predicts."""
        self._excluded.add((state, action))
        self._entries.pop(state, None)

    def refresh(self) -> None:
        """Adopt the model's current revisions; every search begins with this."""
        if self._revisions != self.model.revisions:
            self._revisions = dict(self.model.revisions)

    def predictions(self, state: State) -> ActionPredictions:
        """The actions in a state that are not excluded, with their predictions."""
        cached = self._entries.get(state)
        if cached is not None and cached.revisions is self._revisions:
            return cached.predictions
        by_action: dict[Action, tuple[ConditionalPrediction, Prediction]] = {}
        for action in self.model.domain.ground_actions(state):
            if (state, action) not in self._excluded:
                by_action[action] = self._predict(state, action, cached)
        predictions = tuple((action, prediction) for action, (_, prediction) in by_action.items())
        self._entries[state] = _Entry(self._revisions, by_action, predictions)
        return predictions

    def _predict(self, state: State, action: Action, cached: _Entry | None) -> tuple[ConditionalPrediction, Prediction]:
        """The model's prediction; the cached one if the model has not revised the action."""
        previous = None if cached is None else cached.by_action.get(action)
        if cached is None or previous is None:
            conditional = self.model.conditional_prediction(state, action)
            return conditional, conditional.ground(state, action)
        if cached.revisions.get(action.name) == self._revisions.get(action.name):
            return previous
        conditional = self.model.conditional_prediction(state, action)
        return previous if conditional is previous[0] else (conditional, conditional.ground(state, action))


class _Entry(NamedTuple):
    """The predictions for one state.

    Attributes:
        revisions: The model's revisions when the entry was made.
        by_action: For each action the model's conditional prediction and its grounding in the state.
        predictions: The actions with their grounded predictions, as `PredictionCache.predictions` returns them.
    """

    revisions: dict[str, int]
    by_action: dict[Action, tuple[ConditionalPrediction, Prediction]]
    predictions: ActionPredictions
