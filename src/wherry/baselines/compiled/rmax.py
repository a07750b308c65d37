"""R-max's and Factored R-max's experiment on numbered states, compiled.

They are `wherry.baselines.rmax` and `wherry.baselines.factored_rmax`, planned for by value iteration, and take the same
steps. What makes them fast is that values are kept, and after a step only those are worked out again that rested on
what was unknown before it: a state is worth R_max for ever until its last unknown action was tried, so after most
steps no value changes at all.
"""

from __future__ import annotations

import math
import time
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wherry.baselines.compiled.tables import Block, Booleans, Floats, Integers, Tables, TabularLearner
from wherry.baselines.factored_rmax import WORTH, Parent, Parents, Variable, parent_value
from wherry.kernels import kernel
from wherry.oomdp.domain import Domain
from wherry.oomdp.objects import State
from wherry.planning.lookahead import Q_TOLERANCE

NONE = -1  # in the table of entries: the step needs no more of them


class World(NamedTuple):
    """What the kernels look up. A step is numbered by its state and action together, s·A + a.

    Attributes:
        successor: [S, A].
        reward: [S, A].
        ends: [S, A].
        first_way: [S + 1] where the steps into each state begin in the list of ways.
        ways: [W] the steps that lead into a state from another.
        needed: [S, A, V] the entries of every step.
        first_user: [P + 1] where each entry's steps begin in the list of users.
        users: [U] the steps that need an entry.
        discount: γ.
        best: V(s_max).
        lowest: Less than any V.
        tolerance: ε.
    """

    successor: Integers
    reward: Floats
    ends: Booleans
    first_way: Integers
    ways: Integers
    needed: Integers
    first_user: Integers
    users: Integers
    discount: float
    best: float
    lowest: float
    tolerance: float


class Knowledge(NamedTuple):
    """What the kernels change.

    Attributes:
        filled: [P] which entries are filled.
        gaps: [S, A] how many entries a step lacks.
        values: [S] V, right by what is known.
        revised: [S] states whose values are to be worked out again, at the beginning.
        is_revised: [S] which of them are there already; all False between calls.
    """

    filled: Booleans
    gaps: Integers
    values: Floats
    revised: Integers
    is_revised: Booleans


@dataclass(frozen=True, slots=True)
class Entries:
    """The entries of a learner's tables that a step fills, and that all have to be filled before it is known.

    Attributes:
        needed: [S, A, V] the numbers of the entries for every state and action, NONE behind the last of them.
    """

    needed: Integers

    @classmethod
    def of_steps(cls, tables: Tables) -> Entries:
        """R-max: an entry for every state and action."""
        states, actions = tables.successor.shape
        return cls(np.arange(states * actions, dtype=np.int32).reshape(states, actions, 1))

    @classmethod
    def of_network(cls, tables: Tables, domain: Domain, parents: Parents) -> Entries:
        """Factored R-max: for every action and variable an entry for all values of the variable's parents.

        Variables with the same parents are learnt together, and so share their entries.

        Raises:
            ValueError: A variable depends on more than the network says.
        """
        states = list(tables.numbers)
        variables = [
            (item.name, attribute.name) for item in states[0].objects for attribute in item.object_class.attributes
        ]
        columns = {variable: _column(states, variable) for variable in variables}
        needed, count = np.full((*tables.successor.shape, 1 + len(variables)), NONE, np.int32), 0
        for at, action in enumerate(domain.actions):
            families: dict[tuple[Parent, ...], Integers] = {}
            for variable, after in _next_values(tables, columns, at):
                given = parents(action, variable)
                if given not in families:
                    families[given] = _numbers_of([_column(states, parent) for parent in given], len(states))
                if _several(families[given], after):
                    name = ".".join(filter(None, variable))
                    raise ValueError(f"{action}, {name}: depends on more than the network says")
            for place, family in enumerate(families.values()):
                needed[:, at, place] = family + count
                count += int(family.max()) + 1
        return cls(needed)


def _column(states: list[State], parent: Parent) -> Integers:
    """What a variable, or what is worked out from some, is in all states, [S]: equal numbers for equal values."""
    codes: dict[Hashable, int] = {}
    return np.array([codes.setdefault(parent_value(state, parent), len(codes)) for state in states], np.int32)


def _next_values(
    tables: Tables, columns: Mapping[Variable, Integers], action: int
) -> Iterator[tuple[Variable, Integers]]:
    """What an action makes of every variable in all states, [S] each."""
    yield WORTH, _numbers_of([tables.reward[:, action], tables.ends[:, action]], len(tables.reward))
    for variable, values in columns.items():
        yield variable, values[tables.successor[:, action]]


def _numbers_of(columns: Sequence[NDArray[Any]], count: int) -> Integers:
    """Numbers [S], from 0, that are equal where all of some columns [S] are; there may be no columns."""
    if not columns:
        return np.zeros(count, np.int32)
    return np.unique(np.column_stack(columns), axis=0, return_inverse=True)[1].astype(np.int32)


def _several(entries: Integers, values: Integers) -> bool:
    """Whether some entry would have to hold several values."""
    return len(np.unique(np.column_stack([entries, values]), axis=0)) > len(np.unique(entries))


@dataclass(frozen=True, slots=True)
class TabularRmax(TabularLearner):
    """R-max (Brafman and Tennenholtz 2002) with m = 1, factored or not, as its entries say.

    Attributes:
        entries: What there is to learn.
        discount: γ.
        r_max: R_max, the most that any step can be worth.
        tolerance: ε, how exact the values have to be.
    """

    entries: Entries
    discount: float = 0.95
    r_max: float = 20.0
    tolerance: float = 1e-6

    def blocks(self, tables: Tables, tests: Integers, rng: np.random.Generator, *, longest: int) -> Iterator[Block]:
        """As `TabularLearner.blocks`, of an episode each.

        Raises:
            ValueError: A step is worth more than R_max: then it would not be optimism to expect that.
        """
        if tables.reward.max() > self.r_max:
            raise ValueError(f"R_max is {self.r_max:g}, and a step is worth {tables.reward.max():g}")
        world = self._world(tables)
        knowledge = _nothing_known(world)
        while True:
            start = int(rng.integers(tables.starts))
            began = time.thread_time()
            episode = _episode(start, longest, world, knowledge), _solved(tests, world, knowledge)
            yield [episode], time.thread_time() - began

    def _world(self, tables: Tables) -> World:
        needed = self.entries.needed
        moves = ~tables.ends & (tables.successor != np.arange(len(tables.successor))[:, None])
        ways, places = np.flatnonzero(moves), np.flatnonzero(needed != NONE)
        first_way, order = _listed(tables.successor.ravel()[ways], len(tables.successor))
        first_user, places_order = _listed(needed.ravel()[places], int(needed.max()) + 1)
        return World(
            tables.successor,
            tables.reward,
            tables.ends,
            first_way,
            ways[order].astype(np.int32),
            needed,
            first_user,
            (places[places_order] // needed.shape[2]).astype(np.int32),
            self.discount,
            self.r_max / (1 - self.discount),  # just as value iteration works it out, to the last bit
            min(0.0, float(tables.reward.min())) / (1 - self.discount),
            self.tolerance,
        )


def _listed(keys: Integers, count: int) -> tuple[Integers, NDArray[np.intp]]:
    """Where in a list that is sorted by keys each of some keys begins, [K + 1], and the order that sorts it."""
    order = np.argsort(keys, kind="stable")
    return np.searchsorted(keys[order], np.arange(count + 1)).astype(np.int32), order


def _nothing_known(world: World) -> Knowledge:
    states = len(world.successor)
    return Knowledge(
        filled=np.zeros(len(world.first_user) - 1, np.bool_),
        gaps=np.count_nonzero(world.needed != NONE, axis=2).astype(np.int32),
        values=np.full(states, world.best),
        revised=np.empty(states, np.int32),
        is_revised=np.zeros(states, np.bool_),
    )


@kernel
def _episode(start: int, longest: int, world: World, knowledge: Knowledge) -> int:
    """One episode: act by the values, learn, and make the values right again; return how many steps it took."""
    state = start
    for step in range(1, longest + 1):
        action = _best(state, world, knowledge)
        learnt = _learn(state, action, world, knowledge)
        if learnt:
            _work_out(_overestimated(learnt, world, knowledge), world, knowledge)
        if world.ends[state, action]:
            return step
        state = world.successor[state, action]
    return longest


@kernel
def _learn(state: int, action: int, world: World, knowledge: Knowledge) -> int:
    """Fill the entries of a step, and revise the states of which some step becomes known by that.

    Returns:
        How many states these are.
    """
    actions, learnt = knowledge.gaps.shape[1], 0
    for entry in world.needed[state, action]:
        if entry == NONE or knowledge.filled[entry]:
            continue
        knowledge.filled[entry] = True
        for step in world.users[world.first_user[entry] : world.first_user[entry + 1]]:
            user, way = step // actions, step % actions
            knowledge.gaps[user, way] -= 1
            if knowledge.gaps[user, way] == 0 and not knowledge.is_revised[user]:
                knowledge.is_revised[user] = True
                knowledge.revised[learnt] = user
                learnt += 1
    for at in range(learnt):
        knowledge.is_revised[knowledge.revised[at]] = False
    return learnt


@kernel
def _overestimated(learnt: int, world: World, knowledge: Knowledge) -> int:
    """Of the states of which more is known, revise those whose values are too high now, and all that rest on them.

    A state rests on another if some step from it to there is worth as much as the state. All that are left out have a
    best step that does not lead to any of those that are revised, so that their values stay right.

    Args:
        learnt: How many states there are to begin with.
        world: What is looked up.
        knowledge: What is changed.

    Returns:
        How many states are revised.
    """
    successor, reward, ends, gaps, values = world.successor, world.reward, world.ends, knowledge.gaps, knowledge.values
    discount, best = world.discount, world.best
    revised, is_revised, ways = knowledge.revised, knowledge.is_revised, world.ways
    actions, found = gaps.shape[1], 0
    for at in range(learnt):
        state = revised[at]
        if values[state] > _highest(state, successor, reward, ends, gaps, values, discount, best):
            is_revised[state] = True
            revised[found] = state
            found += 1
    at = 0
    while at < found:
        target = revised[at]
        at += 1
        for step in ways[world.first_way[target] : world.first_way[target + 1]]:
            state, action = step // actions, step % actions
            if is_revised[state] or gaps[state, action]:
                continue
            if reward[state, action] + discount * values[target] >= values[state]:
                is_revised[state] = True
                revised[found] = state
                found += 1
    for at in range(found):
        is_revised[revised[at]] = False
    return found


@kernel
def _work_out(count: int, world: World, knowledge: Knowledge) -> None:
    """Work out the values of so many revised states, given all others: from below, there and back until none moves."""
    successor, reward, ends, gaps, values = world.successor, world.reward, world.ends, knowledge.gaps, knowledge.values
    discount, best = world.discount, world.best
    revised = knowledge.revised
    for at in range(count):
        values[revised[at]] = world.lowest
    change = math.inf
    while change > world.tolerance:
        change = 0.0
        for turn in range(2 * count):
            state = revised[turn if turn < count else 2 * count - 1 - turn]
            value = max(values[state], _highest(state, successor, reward, ends, gaps, values, discount, best))
            change = max(change, value - values[state])
            values[state] = value


@kernel
def _worth(
    state: int, action: int, successor: Integers, reward: Floats, ends: Booleans, gaps: Integers, values: Floats,
    discount: float, best: float,
) -> float:  # fmt: skip
    """Q(s, a): R_max for ever where the step is not known. (Whole tuples handed over take much longer.)"""
    if gaps[state, action]:
        return best
    worth: float = reward[state, action]
    if not ends[state, action]:
        worth += discount * values[successor[state, action]]
    return worth


@kernel
def _highest(
    state: int, successor: Integers, reward: Floats, ends: Booleans, gaps: Integers, values: Floats, discount: float,
    best: float,
) -> float:  # fmt: skip
    """max_a Q(s, a)."""
    highest = -math.inf
    for action in range(successor.shape[1]):
        highest = max(highest, _worth(state, action, successor, reward, ends, gaps, values, discount, best))
    return highest


@kernel
def _best(state: int, world: World, knowledge: Knowledge) -> int:
    """The first of the best actions."""
    best, most = 0, -math.inf
    successor, reward, ends, gaps, values = world.successor, world.reward, world.ends, knowledge.gaps, knowledge.values
    for action in range(successor.shape[1]):
        worth = _worth(state, action, successor, reward, ends, gaps, values, world.discount, world.best)
        if worth > most + Q_TOLERANCE:
            best, most = action, worth
    return best


@kernel
def _solved(tests: Integers, world: World, knowledge: Knowledge) -> int:
    """How many of the probes [P, 2], states and fewest steps, the policy solves in that many."""
    solved = 0
    for probe in range(len(tests)):
        state = tests[probe, 0]
        for step in range(1, tests[probe, 1] + 1):
            action = _best(state, world, knowledge)
            if world.ends[state, action]:
                solved += step == tests[probe, 1]
                break
            state = world.successor[state, action]
    return solved
