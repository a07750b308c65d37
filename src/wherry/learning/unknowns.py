"""The number of condition–action pairs that a learner cannot predict yet, a measure of its progress."""

from __future__ import annotations

from collections.abc import Hashable

from wherry.oomdp.conditional_models import ConditionalModel
from wherry.oomdp.domain import Action
from wherry.oomdp.objects import State


class UnknownPairs:
    """Counts the pairs of a condition met so far and an action whose outcome the model does not predict under it.

    Args:
        model: A model that learns in the meantime.
    """

    def __init__(self, model: ConditionalModel) -> None:
        self.model = model
        self._states: dict[Hashable, State] = {}  # one state for each key of the model
        self._unknown: dict[str, set[tuple[Hashable, Action]]] = {}  # by action name
        self._counted_revisions: dict[str, int] = {}

    def add(self, state: State) -> None:
        """Add a state's conditions to those met."""
        key = self.model.state_key(state)
        if key not in self._states:
            self._states[key] = state
            self._counted_revisions.clear()

    def count(self) -> int:
        """Return the number of pairs; only actions about which the model has learnt more are counted again."""
        counted = self._counted_revisions
        stale = {name for name, revision in self.model.revisions.items() if counted.get(name) != revision}
        if stale:
            for name in stale:
                self._unknown[name] = set()
            for key, state in self._states.items():
                for action in self.model.domain.ground_actions(state):
                    if action.name in stale and self.model.predict(state, action).most_likely.next_state is None:
                        self._unknown[action.name].add((key, action))
            self._counted_revisions = dict(self.model.revisions)
        return sum(len(pairs) for pairs in self._unknown.values())
