"""What a model says of all actions in a state, remembered until it has learnt more of them."""

from __future__ import annotations

from typing import NamedTuple

from wherry.oomdp.domain import Action
from wherry.oomdp.mdp import Prediction
from wherry.oomdp.objects import State
from wherry.oomdp.outcomes import Answer, ConditionalModel

Predicted = tuple[tuple[Action, Prediction], ...]


class Successors:
    """The lazily grounded model that searches expand: a state is looked at when a search comes to it.

    Planning again after every step is cheap with it: what was worked out for one search serves the next one, except
    for actions that the model has learnt about since.

    Args:
        model: What tells what actions do.
    """

    def __init__(self, model: ConditionalModel) -> None:
        self.model = model
        self._known: dict[State, _Known] = {}
        self._revisions: dict[str, int] = {}
        self._barred: set[tuple[State, Action]] = set()

    def bar(self, state: State, action: Action) -> None:
        """Never again consider an action in a state, whatever the model says of it."""
        self._barred.add((state, action))
        self._known.pop(state, None)

    def refresh(self) -> None:
        """Notice what the model has learnt; every search begins with it."""
        if self._revisions != self.model.revisions:
            self._revisions = dict(self.model.revisions)

    def of(self, state: State) -> Predicted:
        """All actions in a state with their predictions."""
        known = self._known.get(state)
        if known is not None and known.revisions is self._revisions:
            return known.predicted
        found: dict[Action, tuple[Answer, Prediction]] = {}
        for action in self.model.domain.ground_actions(state):
            if (state, action) not in self._barred:
                found[action] = self._predict(state, action, known)
        predicted = tuple((action, prediction) for action, (_, prediction) in found.items())
        self._known[state] = _Known(self._revisions, found, predicted)
        return predicted

    def _predict(self, state: State, action: Action, known: _Known | None) -> tuple[Answer, Prediction]:
        """What the model says of an action, or said of it before it learnt of others."""
        before = None if known is None else known.found.get(action)
        if known is None or before is None:
            answer = self.model.answer(state, action)
            return answer, answer.predict(state, action)
        if known.revisions.get(action.name) == self._revisions.get(action.name):
            return before
        answer = self.model.answer(state, action)
        return before if answer is before[0] else (answer, answer.predict(state, action))


class _Known(NamedTuple):
    """What was worked out about a state.

    Attributes:
        revisions: The model's revisions then.
        found: The model's answers, and what they make of this state.
        predicted: The same for those who search.
    """

    revisions: dict[str, int]
    found: dict[Action, tuple[Answer, Prediction]]
    predicted: Predicted
