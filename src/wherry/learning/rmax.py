"""R-max (Brafman and Tennenholtz 2002) for deterministic MDPs: every state and action is learnt by itself, once.

The baseline that knows nothing of objects. One visit is enough where nothing is random (m = 1).
"""

from __future__ import annotations

from collections.abc import Hashable

from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.mdp import UNKNOWN, Prediction, Transition
from wherry.oomdp.objects import State
from wherry.oomdp.outcomes import Answer, Fixed

NOT_KNOWN = Answer(((Fixed(UNKNOWN), 1.0),))


class Rmax:
    """Remembers what every action did in every state.

    Args:
        domain: What states are described with.
    """

    doubtful = False
    violations: tuple[str, ...] = ()

    def __init__(self, domain: Domain) -> None:
        self.domain = domain
        self.revisions = dict.fromkeys(domain.actions, 0)
        self._known: dict[tuple[State, Action], Answer] = {}

    def predict(self, state: State, action: Action) -> Prediction:
        """What the action did in this state, or unknown."""
        return self.answer(state, action).predict(state, action)

    def key(self, state: State) -> Hashable:
        """The state itself."""
        return state

    def answer(self, state: State, action: Action) -> Answer:
        """What the action did in this state, or unknown."""
        return self._known.get((state, action), NOT_KNOWN)

    def add_experience(self, transition: Transition) -> None:
        """Remember one experience."""
        seen = Prediction(transition.next_state, transition.reward, transition.terminated)
        answer = Answer(((Fixed(seen), 1.0),))
        if self._known.get((transition.state, transition.action)) != answer:
            self._known[transition.state, transition.action] = answer
            self.revisions[transition.action.name] += 1
