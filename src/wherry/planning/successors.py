"""What a model says of all actions in a state, remembered until it has learnt more of them."""

from __future__ import annotations

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
        self._known: dict[State, tuple[dict[str, int], dict[Action, Answer], Predicted]] = {}
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
        if known is not None and known[0] is self._revisions:
            return known[2]
        answers: dict[Action, Answer] = {}
        predicted = []
        before = {} if known is None else {action: (known[1][action], found) for action, found in known[2]}
        for action in self.model.domain.ground_actions(state):
            answer = answers[action] = self.model.answer(state, action)
            old_answer, prediction = before.get(action, (None, None))
            if prediction is None or answer is not old_answer:
                prediction = answer.predict(state, action)
            if (state, action) not in self._barred:
                predicted.append((action, prediction))
        result = tuple(predicted)
        self._known[state] = self._revisions, answers, result
        return result
