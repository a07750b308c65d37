"""R-max (Brafman and Tennenholtz 2002) for deterministic MDPs: every state and action is learnt by itself, once.

The baseline that knows nothing of objects. One visit is enough where nothing is random (m = 1).
"""

from __future__ import annotations

from collections.abc import Hashable

from wherry.oomdp.conditional_models import ConditionalPrediction, ConstantOutcome, ModelOutcome
from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.mdp import UNKNOWN, Outcome, Prediction, Transition
from wherry.oomdp.objects import State

NOT_KNOWN = ConditionalPrediction(((ConstantOutcome(UNKNOWN.most_likely), 1.0),))


class Rmax:
    """Remembers what every action did in every state the first time.

    Args:
        domain: What states are described with.
    """

    has_disagreement = False

    def __init__(self, domain: Domain) -> None:
        self.domain = domain
        self.revisions = dict.fromkeys(domain.actions, 0)
        self._known: dict[tuple[State, Action], Prediction] = {}
        self._violations: dict[str, None] = {}

    @property
    def violations(self) -> tuple[str, ...]:
        """Which actions did different things in the same state."""
        return tuple(self._violations)

    def predict(self, state: State, action: Action) -> Prediction:
        """What the action did in this state, or unknown."""
        return self._known.get((state, action), UNKNOWN)

    def state_key(self, state: State) -> Hashable:
        """The state itself."""
        return state

    def conditional_prediction(self, state: State, action: Action) -> ConditionalPrediction:
        """What the action did in this state, or unknown."""
        return ConditionalPrediction(((ModelOutcome(self), 1.0),)) if (state, action) in self._known else NOT_KNOWN

    def add_experience(self, transition: Transition) -> None:
        """Remember one experience."""
        tried = transition.state, transition.action
        seen = Prediction((Outcome(transition.next_state, transition.reward, transition.terminated),))
        if self._known.setdefault(tried, seen) is seen:
            self.revisions[transition.action.name] += 1
        elif self._known[tried] != seen:
            self._violations[f"{transition.action}: did not do the same each time in one state"] = None
