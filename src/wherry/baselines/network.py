"""The dynamic Bayesian network given to Factored R-max: the parents on which each variable's next value depends."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import cast

from wherry.oomdp.attributes import Value
from wherry.oomdp.objects import State

Variable = tuple[str, str]
"""An attribute of an object: names of the object and of the attribute."""

REWARD_AND_END: Variable = ("", "reward and end")
"""The variable for a step's reward and whether the step ends the episode."""

GONE = ("gone",)
"""Value of every attribute of an object that has left the state; no attribute of a present object has it."""

Parent = Variable | Callable[[State], Hashable]
"""A variable, or a function of several variables, such as a passenger's location (a mark, or in the taxi)."""

Parents = Callable[[str, Variable], tuple[Parent, ...]]
"""The network: the parents of a variable's next value, given the action's name."""


def parent_value(state: State, parent: Parent) -> Hashable:
    """Return the value of a parent in a state; `GONE` for an attribute of an object that has left."""
    if callable(parent):
        return parent(state)
    name, attribute = parent
    item = state.get(name)
    return GONE if item is None else cast("Value", getattr(item, attribute))


def attributes_of(state: State) -> list[Variable]:
    """Return the variables of a state: all attributes of all objects."""
    return [(item.name, attribute.name) for item in state.objects for attribute in item.object_class.attributes]


def name_of(variable: Variable) -> str:
    """Return a variable as text: ``taxi.x``."""
    return ".".join(filter(None, variable))
