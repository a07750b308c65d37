"""Factored R-max (Guestrin, Patrascu and Schuurmans 2002) for deterministic MDPs whose structure is given.

For every action a dynamic Bayesian network (`wherry.baselines.network`) gives the parents of each variable: the
attributes on which an attribute's next value, or the reward and the end of the episode, depend. One table is learnt for
each action and variable; a step is known when all its tables have an entry.

This is the reference implementation on object states, which works with any planner. Experiments run
`wherry.baselines.compiled.rmax`, which is tested against it step by step.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from typing import Any

from wherry.baselines.network import GONE, REWARD_AND_END, Parents, Variable, attributes_of, name_of, parent_value
from wherry.baselines.rmax import UNKNOWN_IN_EVERY_STATE
from wherry.oomdp.conditional_models import ConditionalPrediction, ModelOutcome
from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.mdp import UNKNOWN, Outcome, Prediction, Transition
from wherry.oomdp.objects import Object, State


class FactoredRmax:
    """Stores, for every action and variable, the variable's next value by the values of its parents.

    Args:
        domain: Domain whose states and actions are learnt about.
        parents: The dynamic Bayesian network.
    """

    has_disagreement = False

    def __init__(self, domain: Domain, parents: Parents) -> None:
        self.domain = domain
        self.parents = parents
        self.revisions = dict.fromkeys(domain.actions, 0)
        self._tables: dict[tuple[Action, Variable], dict[tuple[Hashable, ...], Hashable]] = {}
        self._violations: dict[str, None] = {}

    @property
    def violations(self) -> tuple[str, ...]:
        """The variables whose next value turned out not to be a function of their parents, in words."""
        return tuple(self._violations)

    def predict(self, state: State, action: Action) -> Prediction:
        """Return the outcome given by the tables; unknown where one of them has no entry."""
        reward_and_end = self._look_up(state, action, REWARD_AND_END)
        if reward_and_end is None:
            return UNKNOWN
        objects = []
        for item in state.objects:
            values = [
                self._look_up(state, action, (item.name, attribute.name)) for attribute in item.object_class.attributes
            ]
            if None in values:
                return UNKNOWN
            if GONE in values:
                continue
            objects.append(Object(item.object_class, item.name, tuple(values)))
        return Prediction((Outcome(state.with_objects(objects), *reward_and_end),))

    def state_key(self, state: State) -> Hashable:
        """Return the state itself: states share no predictions."""
        return state

    def conditional_prediction(self, state: State, action: Action) -> ConditionalPrediction:
        """Return the outcome given by the tables; unknown where one of them has no entry."""
        if not self._knows(state, action):
            return UNKNOWN_IN_EVERY_STATE
        return ConditionalPrediction(((ModelOutcome(self), 1.0),))

    def _knows(self, state: State, action: Action) -> bool:
        """Return whether every table has an entry for the step."""
        variables = (REWARD_AND_END, *attributes_of(state))
        return all(self._look_up(state, action, variable) is not None for variable in variables)

    def _look_up(self, state: State, action: Action, variable: Variable) -> Any:
        return self._tables.get((action, variable), {}).get(self._parent_values(state, action, variable))

    def _parent_values(self, state: State, action: Action, variable: Variable) -> tuple[Hashable, ...]:
        return tuple(parent_value(state, parent) for parent in self.parents(action.name, variable))

    def add_experience(self, transition: Transition) -> None:
        """Enter one transition in all tables."""
        for variable, value in _next_values(transition):
            table = self._tables.setdefault((transition.action, variable), {})
            key = self._parent_values(transition.state, transition.action, variable)
            if key not in table:
                table[key] = value
                self.revisions[transition.action.name] += 1
            elif table[key] != value:
                violation = f"{transition.action}, {name_of(variable)}: depends on more than its parents in the network"
                self._violations[violation] = None


def _next_values(transition: Transition) -> Iterator[tuple[Variable, Hashable]]:
    """Yield every variable with its value after a transition."""
    yield REWARD_AND_END, (transition.reward, transition.terminated)
    for variable in attributes_of(transition.state):
        yield variable, parent_value(transition.next_state, variable)
