"""How much a learner cannot tell yet: the number that people watch falling."""

from __future__ import annotations

from collections.abc import Hashable

from wherry.oomdp.conditional_models import ConditionalModel
from wherry.oomdp.domain import Action
from wherry.oomdp.objects import State


class UnknownPairs:
    """Pairs of a condition that was met and an action that a model cannot predict there.

    Args:
        model: What tells what actions do.
    """

    def __init__(self, model: ConditionalModel) -> None:
        self.model = model
        self._met: dict[Hashable, State] = {}
        self._unknown: dict[str, set[tuple[Hashable, Action]]] = {}
        self._counted_at: dict[str, int] = {}

    def meet(self, state: State) -> None:
        """Take note of a state's conditions."""
        key = self.model.state_key(state)
        if key not in self._met:
            self._met[key] = state
            self._counted_at.clear()

    def count(self) -> int:
        """How many pairs there are; counted again only for actions that the model has learnt about since."""
        stale = {name for name, revision in self.model.revisions.items() if self._counted_at.get(name) != revision}
        if stale:
            for name in stale:
                self._unknown[name] = set()
            for key, state in self._met.items():
                for action in self.model.domain.ground_actions(state):
                    if action.name in stale and self.model.predict(state, action).most_likely.next_state is None:
                        self._unknown[action.name].add((key, action))
            self._counted_at = dict(self.model.revisions)
        return sum(len(pairs) for pairs in self._unknown.values())
