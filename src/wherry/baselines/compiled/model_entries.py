"""The entries of the model tables of R-max and Factored R-max that must be filled before a step is known.

A step is a state and an action. Arrays have the dimensions S (states), A (actions) and V (entries of a step).
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wherry.baselines.compiled.tabular import Integers, TabularMdp
from wherry.baselines.network import (
    REWARD_AND_END,
    Parent,
    Parents,
    Variable,
    attributes_of,
    name_of,
    parent_value,
)
from wherry.oomdp.domain import Domain
from wherry.oomdp.objects import State

PADDING = -1  # follows the entries of steps that require fewer entries than V


@dataclass(frozen=True, slots=True)
class ModelEntries:
    """The table entries that each step fills; the step is known once all of them are filled.

    Attributes:
        required: [S, A, V] numbers of the entries of every step, from 0, followed by `PADDING`.
    """

    required: Integers

    @classmethod
    def of_steps(cls, mdp: TabularMdp) -> ModelEntries:
        """Return the entries of R-max: one for every step."""
        states, actions = mdp.successor.shape
        return cls(np.arange(states * actions, dtype=np.int32).reshape(states, actions, 1))

    @classmethod
    def of_network(cls, mdp: TabularMdp, domain: Domain, parents: Parents) -> ModelEntries:
        """Return the entries of Factored R-max: one for each action, variable, and values of the variable's parents.

        Variables with the same parents are learnt together and share their entries.

        Args:
            mdp: The MDP on numbered states.
            domain: Domain of the states; it gives the order of the actions.
            parents: The dynamic Bayesian network.

        Raises:
            ValueError: A variable depends on more than its parents in the network.
        """
        states = list(mdp.state_numbers)
        variables = attributes_of(states[0])
        columns = {variable: _column(states, variable) for variable in variables}
        required, count = np.full((*mdp.successor.shape, 1 + len(variables)), PADDING, np.int32), 0
        for number, action in enumerate(domain.actions):
            families: dict[tuple[Parent, ...], Integers] = {}  # [S] numbers of the parents' values, by parents
            for variable, next_values in _next_values(mdp, columns, number):
                given = parents(action, variable)
                if given not in families:
                    families[given] = _numbers_of([_column(states, parent) for parent in given], len(states))
                if not _is_function(families[given], next_values):
                    raise ValueError(f"{action}, {name_of(variable)}: depends on more than its parents in the network")
            for index, family in enumerate(families.values()):
                required[:, number, index] = family + count
                count += int(family.max()) + 1
        return cls(required)


def _column(states: list[State], parent: Parent) -> Integers:
    """Return a parent's value in every state as a number, [S]: equal numbers for equal values."""
    codes: dict[Hashable, int] = {}
    return np.array([codes.setdefault(parent_value(state, parent), len(codes)) for state in states], np.int32)


def _next_values(
    mdp: TabularMdp, columns: Mapping[Variable, Integers], action: int
) -> Iterator[tuple[Variable, Integers]]:
    """Yield every variable with its value after an action in every state, [S]."""
    yield REWARD_AND_END, _numbers_of([mdp.reward[:, action], mdp.terminates[:, action]], len(mdp.reward))
    for variable, values in columns.items():
        yield variable, values[mdp.successor[:, action]]


def _numbers_of(columns: Sequence[NDArray[Any]], count: int) -> Integers:
    """Return numbers [S], from 0, that are equal where all columns [S] are; all 0 if there are no columns."""
    if not columns:
        return np.zeros(count, np.int32)
    return np.unique(np.column_stack(columns), axis=0, return_inverse=True)[1].astype(np.int32)


def _is_function(entries: Integers, values: Integers) -> bool:
    """Return whether the values [S] are a function of the entries [S]."""
    return len(np.unique(np.column_stack([entries, values]), axis=0)) == len(np.unique(entries))
