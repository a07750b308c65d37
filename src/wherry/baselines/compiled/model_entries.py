"""Which entries of a learner's model tables must be filled before a step is known, for R-max and Factored R-max."""

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

NONE = -1  # fills up the rows of steps that need fewer entries than others


@dataclass(frozen=True, slots=True)
class ModelEntries:
    """The table entries that a step fills, all of which must be filled before the step is known.

    Attributes:
        required: [S, A, V] numbers of the entries of every state and action, followed by `NONE`.
    """

    required: Integers

    @classmethod
    def of_steps(cls, mdp: TabularMdp) -> ModelEntries:
        """Return those of R-max: one entry for every state and action."""
        states, actions = mdp.successor.shape
        return cls(np.arange(states * actions, dtype=np.int32).reshape(states, actions, 1))

    @classmethod
    def of_network(cls, mdp: TabularMdp, domain: Domain, parents: Parents) -> ModelEntries:
        """Return those of Factored R-max: for every action and variable, one for all values of the variable's parents.

        Variables with the same parents are learnt together and share their entries.

        Raises:
            ValueError: A variable depends on more than the network says.
        """
        states = list(mdp.state_numbers)
        variables = attributes_of(states[0])
        columns = {variable: _column(states, variable) for variable in variables}
        required, count = np.full((*mdp.successor.shape, 1 + len(variables)), NONE, np.int32), 0
        for at, action in enumerate(domain.actions):
            families: dict[tuple[Parent, ...], Integers] = {}
            for variable, after in _next_values(mdp, columns, at):
                given = parents(action, variable)
                if given not in families:
                    families[given] = _numbers_of([_column(states, parent) for parent in given], len(states))
                if not _is_function(families[given], after):
                    raise ValueError(f"{action}, {name_of(variable)}: depends on more than the network says")
            for place, family in enumerate(families.values()):
                required[:, at, place] = family + count
                count += int(family.max()) + 1
        return cls(required)


def _column(states: list[State], parent: Parent) -> Integers:
    """Return a parent's value in all states as numbers, [S]: equal numbers for equal values."""
    codes: dict[Hashable, int] = {}
    return np.array([codes.setdefault(parent_value(state, parent), len(codes)) for state in states], np.int32)


def _next_values(
    mdp: TabularMdp, columns: Mapping[Variable, Integers], action: int
) -> Iterator[tuple[Variable, Integers]]:
    """Yield every variable with its value after an action in all states, [S]."""
    yield REWARD_AND_END, _numbers_of([mdp.reward[:, action], mdp.terminates[:, action]], len(mdp.reward))
    for variable, values in columns.items():
        yield variable, values[mdp.successor[:, action]]


def _numbers_of(columns: Sequence[NDArray[Any]], count: int) -> Integers:
    """Return numbers [S], from 0, that are equal where all of some columns [S] are; there may be no columns."""
    if not columns:
        return np.zeros(count, np.int32)
    return np.unique(np.column_stack(columns), axis=0, return_inverse=True)[1].astype(np.int32)


def _is_function(entries: Integers, values: Integers) -> bool:
    """Return whether every entry [S] belongs to a single value [S]."""
    return len(np.unique(np.column_stack([entries, values]), axis=0)) == len(np.unique(entries))
