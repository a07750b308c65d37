"""Value iteration over the states that can be reached, swept by compiled code (paper, section 6; Puterman 1994).

A state and action that the model cannot tell about lead to the fictitious state s_max, which pays R_max for ever: so
the policy goes and finds out, as long as anything can be gained by it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import kernel
from wherry.oomdp.domain import Action
from wherry.oomdp.objects import State
from wherry.oomdp.outcomes import Answer, ConditionalModel
from wherry.planning.lookahead import TIE
from wherry.planning.state_space import END, MISSING, UNKNOWN, Floats, Integers, StateSpace

NONE = -1  # in the table of branches: the group has no such action, or the answer no such branch
NEVER = -1  # in the table of revisions: the model was not asked yet


class ValueIteration:
    """Optimal policies on a model as it is at the moment; it plans again by itself when the model has learnt.

    Args:
        model: What tells what actions do.
        discount: γ.
        r_max: R_max, the most that any step can be worth.
        tolerance: ε, how exact the values have to be.
        optimistic: Whether unknown steps lead to s_max, and unlikely branches count for what they are worth. Else
            unknown steps are never taken, and what is most likely is taken to be sure.
        curiosity: What it is worth to find out which of two equally likely things a step does; less where one of them
            is more likely. Keep it below R_max, or finding out is worth more than the task.
        space: The states and tables to use and add to; learners of one domain may share them.
    """

    def __init__(
        self,
        model: ConditionalModel,
        *,
        discount: float = 0.95,
        r_max: float = 20.0,
        tolerance: float = 1e-6,
        optimistic: bool = True,
        curiosity: float = 0.0,
        space: StateSpace | None = None,
    ) -> None:
        self.model = model
        self.discount = discount
        self.tolerance = tolerance
        self.optimistic = optimistic
        self.curiosity = curiosity
        self.unknown_value = r_max / (1 - discount) if optimistic else -np.inf
        self.space = StateSpace() if space is None else space
        self._model_revisions: Mapping[str, int] = {}  # as they were when the model was asked last
        self._revisions: Integers = np.zeros(0, np.int32)  # [A] of what the model says about an action now
        self._asked: Integers = np.zeros((0, 0), np.int32)  # [G, A] the revision at which it was asked last
        self._answers: dict[tuple[int, int], Answer] = {}  # by group and action
        self._branches: Integers = np.zeros((0, 0, 1), np.int32)  # [G, A, K] numbers of the answers' branches
        self._chances: Floats = np.zeros((0, 0, 1))  # [G, A, K] their probabilities
        self._doubts: Floats = np.zeros((0, 0))  # [G, A] how much trying settles
        self._values: Floats = np.zeros(0)  # [S]
        self._solved: NDArray[np.bool_] = np.zeros(0, np.bool_)  # [S] which values are right
        self._reached: Integers = np.zeros(0, np.int32)  # [R] the states of the last sweep

    def policy(self, state: State) -> Action:
        """The best action; of equally good ones the first."""
        number = self.space.number(state, self.model)
        self._solve([number])
        return self.space.actions[_best(number, *self._tables())]

    def value(self, state: State) -> float:
        """V(s), the discounted sum of rewards that the best policy can expect."""
        return float(self.values([state])[0])

    def values(self, states: Sequence[State]) -> Floats:
        """V [N] of N states, and of all that can be reached from them, worked out together."""
        numbers = [self.space.number(state, self.model) for state in states]
        self._solve(numbers)
        return self._values[numbers]

    def sweep(self) -> int:
        """Sweep all states that were reached last until their values hold still; return how many these are.

        `policy` and `values` do so by themselves when something was learnt.
        """
        _sweep(self._reached, self.tolerance, *self._tables())
        self._solved[self._reached] = True
        return len(self._reached)

    def _tables(self) -> tuple[Integers, Integers, Floats, Floats, Integers, Floats, Floats, float, float, float]:
        """What the kernels look up."""
        space = self.space
        return (
            space.group, self._branches, self._chances, self._doubts, space.successor, space.reward, self._values,
            self.discount, self.unknown_value, self.curiosity,
        )  # fmt: skip

    def _solve(self, numbers: list[int]) -> None:
        """Make the values right for numbered states and all that can be reached from them."""
        learnt = self._model_has_learnt()
        if learnt or not all(number < len(self._solved) and self._solved[number] for number in numbers):
            self._reach(np.array(numbers, np.int32))
            self.sweep()

    def _model_has_learnt(self) -> bool:
        """Whether the model's revisions have moved on; then it is asked again for the states at hand."""
        if self.model.revisions == self._model_revisions and len(self._revisions) == len(self.space.actions):
            return False
        self._make_room()
        self._model_revisions = dict(self.model.revisions)
        self._revisions = np.array(
            [self._model_revisions.get(action.name, 0) for action in self.space.actions], np.int32
        )
        self._solved[:] = False
        self._ask(np.unique(self.space.group[self._reached]))
        return True

    def _reach(self, starts: Integers) -> None:
        """Find all states that can be reached, asking the model and filling in the tables where need be."""
        while True:
            self._make_room()
            space = self.space
            self._reached, gaps = _reach(
                starts, len(space.states), space.group, self._branches, self._asked, self._revisions, space.successor
            )
            if not len(gaps):
                break
            to_ask = gaps[:, 1] == NONE
            self._ask(np.unique(space.group[gaps[to_ask, 0]]))
            for state, branch in gaps[~to_ask].tolist():
                space.work_out(branch, state, self.model)

    def _ask(self, groups: Integers) -> None:
        """Ask the model about some groups of states: about the actions that it has learnt about since the last time."""
        space = self.space
        rows, columns = np.nonzero(self._asked[groups] != self._revisions)
        self._asked[groups] = self._revisions
        for group, column in zip(groups[rows].tolist(), columns.tolist(), strict=True):
            action = space.actions[column]
            if column not in space.group_actions[group]:
                continue
            answer = self.model.answer(space.groups[group], action)
            if answer is self._answers.get((group, column)):
                continue
            self._answers[group, column] = answer
            self._branches[group, column] = NONE
            self._chances[group, column] = 0.0
            self._doubts[group, column] = answer.doubt
            looked_at = answer.branches if self.optimistic else answer.branches[:1]
            self._make_room_for_branches(len(looked_at))
            for place, (branch, probability) in enumerate(looked_at):
                self._branches[group, column, place] = space.branch_number(action, branch)
                self._chances[group, column, place] = probability if self.optimistic else 1.0

    def _make_room_for_branches(self, count: int) -> None:
        """Widen the tables of branches to the answer that has the most of them, K."""
        growth = ((0, 0), (0, 0), (0, max(0, count - self._branches.shape[2])))
        if any(growth[2]):
            self._branches = np.pad(self._branches, growth, constant_values=NONE)
            self._chances = np.pad(self._chances, growth)

    def _make_room(self) -> None:
        """Let the planner's own tables grow with the space."""
        states, groups, actions = len(self.space.group), len(self.space.groups), len(self.space.actions)
        if states > len(self._values):
            self._values = np.pad(self._values, (0, states - len(self._values)))
            self._solved = np.pad(self._solved, (0, states - len(self._solved)))
        rows, columns = self._asked.shape
        if groups > rows or actions > columns:
            growth = ((0, max(0, 2 * groups - rows)), (0, actions - columns))
            self._asked = np.pad(self._asked, growth, constant_values=NEVER)
            self._branches = np.pad(self._branches, (*growth, (0, 0)), constant_values=NONE)
            self._chances = np.pad(self._chances, (*growth, (0, 0)))
            self._doubts = np.pad(self._doubts, growth)
            self._revisions = np.pad(self._revisions, (0, actions - columns))


@kernel
def _reach(
    starts: Integers, count: int, group: Integers, branches: Integers, asked: Integers, revisions: Integers,
    successor: Integers,
) -> tuple[Integers, Integers]:  # fmt: skip
    """Search breadth-first from some states.

    Args:
        starts: [N] the states' numbers.
        count: How many states are numbered.
        group: [S].
        branches: [G, A, K].
        asked: [G, A].
        revisions: [A].
        successor: [B, S].

    Returns:
        [R] the states reached, nearest first; [M, 2] the gaps that were met: a state, and the branch that was never
        worked out for it, or NONE where the model has to be asked first.
    """
    seen = np.zeros(count, np.bool_)
    order = np.empty(count, np.int32)
    gaps = np.empty((count * branches.shape[1] * branches.shape[2], 2), np.int32)
    reached, missing, at = 0, 0, 0
    for start in starts:
        if not seen[start]:
            seen[start] = True
            order[reached] = start
            reached += 1
    while at < reached:
        state = order[at]
        at += 1
        for action in range(branches.shape[1]):
            known = asked[group[state], action] == revisions[action]
            for branch in branches[group[state], action]:
                if known and branch == NONE:
                    continue
                if not known or successor[branch, state] == MISSING:
                    gaps[missing, 0] = state
                    gaps[missing, 1] = branch if known else NONE
                    missing += 1
                    continue
                target = successor[branch, state]
                if target >= 0 and not seen[target]:
                    seen[target] = True
                    order[reached] = target
                    reached += 1
    return order[:reached].copy(), gaps[:missing].copy()


@kernel
def _backup(
    state: int, action: int, group: Integers, branches: Integers, chances: Floats, doubts: Floats, successor: Integers,
    reward: Floats, discount: float, unknown_value: float, curiosity: float, weights: Floats, targets: Integers,
) -> float:  # fmt: skip
    """What Q(s, a) is made of: a constant, which is returned, plus Σ_k weights[k] V(targets[k]).

    The constant is -inf where the action is not possible, or is hopeless.

    Args:
        state: s.
        action: a.
        group: [S].
        branches: [G, A, K].
        chances: [G, A, K].
        doubts: [G, A].
        successor: [B, S].
        reward: [B, S].
        discount: γ.
        unknown_value: V(s_max).
        curiosity: What it is worth to settle a doubt.
        weights: [K] is overwritten: γ P(s'|s, a), or 0 for a branch that leads to no state.
        targets: [K] is overwritten: s', or 0.
    """
    total, constant = 0.0, 0.0
    weights[:] = 0.0
    targets[:] = 0
    for at in range(branches.shape[2]):
        branch, chance = branches[group[state], action, at], chances[group[state], action, at]
        if branch == NONE or chance == 0.0:
            continue
        target = successor[branch, state]
        if target >= 0:
            constant += chance * reward[branch, state]
            weights[at], targets[at] = chance * discount, target
        elif target == END:
            constant += chance * reward[branch, state]
        elif target == UNKNOWN:
            constant += chance * unknown_value
        else:
            continue
        total += chance
    if total == 0:
        return -math.inf
    weights /= total
    settles: float = doubts[group[state], action]
    return constant / total + curiosity * settles


@kernel
def _best(
    state: int, group: Integers, branches: Integers, chances: Floats, doubts: Floats, successor: Integers,
    reward: Floats, values: Floats, discount: float, unknown_value: float, curiosity: float,
) -> int:  # fmt: skip
    """The first of the best actions."""
    weights, targets = np.empty(branches.shape[2]), np.empty(branches.shape[2], np.int32)
    best, best_value = 0, -math.inf
    for action in range(branches.shape[1]):
        value = _backup(
            state, action, group, branches, chances, doubts, successor, reward, discount, unknown_value, curiosity,
            weights, targets,
        )  # fmt: skip
        for at in range(len(weights)):
            value += weights[at] * values[targets[at]]
        if value > best_value + TIE:
            best, best_value = action, value
    return best


@kernel
def _sweep(
    states: Integers, tolerance: float, group: Integers, branches: Integers, chances: Floats, doubts: Floats,
    successor: Integers, reward: Floats, values: Floats, discount: float, unknown_value: float, curiosity: float,
) -> None:  # fmt: skip
    """Sweep back and forth until the values hold still; they start below any sum of rewards, and so only rise.

    The tables are first put together for the states at hand, so that a sweep reads straight through memory.

    Args:
        states: [R] the states to sweep, nearest first; nothing leads out of them.
        tolerance: ε.
        group: [S].
        branches: [G, A, K].
        chances: [G, A, K].
        doubts: [G, A].
        successor: [B, S].
        reward: [B, S].
        values: [S] is overwritten for the states.
        discount: γ.
        unknown_value: V(s_max).
        curiosity: What it is worth to settle a doubt.
    """
    count, actions, width = len(states), branches.shape[1], branches.shape[2]
    constants, lowest = np.empty((count, actions)), 0.0
    weights, targets = np.empty((count, actions, width)), np.empty((count, actions, width), np.int32)
    for at in range(count):
        state = states[at]
        for action in range(actions):
            constants[at, action] = _backup(
                state, action, group, branches, chances, doubts, successor, reward, discount, unknown_value, curiosity,
                weights[at, action], targets[at, action],
            )  # fmt: skip
        for branch in branches[group[state]].flat:
            if branch != NONE:
                lowest = min(lowest, reward[branch, state])
    for state in states:
        values[state] = lowest / (1 - discount)
    change = math.inf
    while change > tolerance:
        change = 0.0
        for turn in range(2 * count):  # there, towards the start, and back again
            at = count - 1 - turn if turn < count else turn - count
            best = values[states[at]]
            before = best
            for action in range(actions):
                value = constants[at, action]
                for place in range(width):
                    value += weights[at, action, place] * values[targets[at, action, place]]
                best = max(best, value)
            values[states[at]] = best
            change = max(change, best - before)
