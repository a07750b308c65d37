"""R-max (Brafman and Tennenholtz 2002) for deterministic MDPs: every state and action is learnt separately.

It uses no structure of the state. One visit makes a state and action known, as dynamics are deterministic (m = 1).

This is the reference implementation on object states, which works with any planner. Experiments run
`wherry.baselines.compiled.rmax`, which is tested against it step by step.
"""

from __future__ import annotations

from collections.abc import Hashable

from wherry.oomdp.conditional_models import ConditionalPrediction, ConstantOutcome, ModelOutcome
from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.mdp import UNKNOWN, Outcome, Prediction, Transition
from wherry.oomdp.objects import State

UNKNOWN_IN_EVERY_STATE = ConditionalPrediction(((ConstantOutcome(UNKNOWN.most_likely), 1.0),))


class Rmax:
    """Stores the first observed outcome of every state and action.

    Args:
        domain: Domain whose states and actions are learnt about.
    """

    has_disagreement = False

    def __init__(self, domain: Domain) -> None:
        self.domain = domain
        self.revisions = dict.fromkeys(domain.actions, 0)
        self._known: dict[tuple[State, Action], Prediction] = {}
        self._violations: dict[str, None] = {}

    @property
    def violations(self) -> tuple[str, ...]:
        """The actions that had different outcomes in the same state, in words."""
        return tuple(self._violations)

    def predict(self, state: State, action: Action) -> Prediction:
        """Return the stored outcome; unknown where the action was not tried in this state."""
        return self._known.get((state, action), UNKNOWN)

    def state_key(self, state: State) -> Hashable:
        """Return the state itself: states share no predictions."""
        return state

    def conditional_prediction(self, state: State, action: Action) -> ConditionalPrediction:
        """Return the stored outcome; unknown where the action was not tried in this state."""
        if (state, action) not in self._known:
            return UNKNOWN_IN_EVERY_STATE
        return ConditionalPrediction(((ModelOutcome(self), 1.0),))

    def add_experience(self, transition: Transition) -> None:
        """Store the outcome of a transition, if it is the first of its state and action."""
        pair = transition.state, transition.action
        observed = Prediction((Outcome(transition.next_state, transition.reward, transition.terminated),))
        if self._known.setdefault(pair, observed) is observed:
            self.revisions[transition.action.name] += 1
        elif self._known[pair] != observed:
            self._violations[f"{transition.action}: had different outcomes in the same state"] = None
