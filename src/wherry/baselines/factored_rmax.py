"""Factored R-max (Guestrin, Patrascu and Schuurmans 2002) for deterministic MDPs: the structure is given, not learnt.

For every action a dynamic Bayesian network says on which attributes an attribute's next value depends, and on which the
reward and the episode's end do. What is learnt is one table for each of them; a step is known when all its tables are.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from typing import Any, cast

from wherry.baselines.rmax import NOT_KNOWN
from wherry.oomdp.attributes import Value
from wherry.oomdp.conditional_models import ConditionalPrediction, ModelOutcome
from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.mdp import UNKNOWN, Outcome, Prediction, Transition
from wherry.oomdp.objects import Object, State

Variable = tuple[str, str]
"""An attribute of an object, by the object's name and the attribute's."""

WORTH: Variable = ("", "reward and end")
"""The variable for what a step is worth and whether it ends the episode."""

GONE = ("gone",)
"""For all attributes of an object that has left; no attribute has such a value."""

Parent = Variable | Callable[[State], Hashable]
"""A variable, or something that is worked out from several of them: where a passenger is, on the street or inside."""

Parents = Callable[[str, Variable], tuple[Parent, ...]]
"""What a variable's next value depends on, for an action's name: the network, which is given."""


class FactoredRmax:
    """Remembers what every action did to every variable, by the values of the variable's parents.

    Args:
        domain: What states are described with.
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
        """Which variables depend on more than the network says."""
        return tuple(self._violations)

    def predict(self, state: State, action: Action) -> Prediction:
        """What the tables say, or unknown where one of them has a gap."""
        worth = self._look_up(state, action, WORTH)
        if worth is None:
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
        return Prediction((Outcome(state.with_objects(objects), *worth),))

    def state_key(self, state: State) -> Hashable:
        """The state itself."""
        return state

    def conditional_prediction(self, state: State, action: Action) -> ConditionalPrediction:
        """What the tables say, or unknown where one of them has a gap."""
        return ConditionalPrediction(((ModelOutcome(self), 1.0),)) if self._knows(state, action) else NOT_KNOWN

    def _knows(self, state: State, action: Action) -> bool:
        """Whether no table has a gap."""
        variables = [
            (item.name, attribute.name) for item in state.objects for attribute in item.object_class.attributes
        ]
        return all(self._look_up(state, action, variable) is not None for variable in (WORTH, *variables))

    def _look_up(self, state: State, action: Action, variable: Variable) -> Any:
        return self._tables.get((action, variable), {}).get(self._parent_values(state, action, variable))

    def _parent_values(self, state: State, action: Action, variable: Variable) -> tuple[Hashable, ...]:
        return tuple(parent_value(state, parent) for parent in self.parents(action.name, variable))

    def add_experience(self, transition: Transition) -> None:
        """Remember one experience in all tables."""
        for variable, value in _next_values(transition):
            table = self._tables.setdefault((transition.action, variable), {})
            key = self._parent_values(transition.state, transition.action, variable)
            if key not in table:
                table[key] = value
                self.revisions[transition.action.name] += 1
            elif table[key] != value:
                name = ".".join(filter(None, variable))
                self._violations[f"{transition.action}, {name}: depends on more than the network says"] = None


def parent_value(state: State, parent: Parent) -> Hashable:
    """What a parent is in a state; `GONE` for an attribute of an object that has left."""
    if callable(parent):
        return parent(state)
    name, attribute = parent
    item = state.get(name)
    return GONE if item is None else cast("Value", getattr(item, attribute))


def _next_values(transition: Transition) -> Iterator[tuple[Variable, Hashable]]:
    yield WORTH, (transition.reward, transition.terminated)
    for item in transition.state.objects:
        for attribute in item.object_class.attributes:
            variable = item.name, attribute.name
            yield variable, parent_value(transition.next_state, variable)
