"""The compiled inner loops of R-max: act greedily, learn, and repair the values that became too high.

Values are kept between steps. The value of a state is V(s_max) until its last unknown action was tried, so after most
steps no value changes at all; after the others only the values that depended on the unknown step are recomputed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from wherry.baselines.compiled.model_entries import NONE
from wherry.baselines.compiled.tabular import Booleans, Floats, Integers
from wherry.kernels import kernel
from wherry.planning.lookahead import Q_TOLERANCE


class RmaxProblem(NamedTuple):
    """What the kernels read. A step is numbered by its state and action together, s·A + a.

    Attributes:
        successor: [S, A] number of s'.
        reward: [S, A] r.
        terminates: [S, A] whether the step ends the episode.
        first_predecessor: [S + 1] where the steps into each state begin in ``predecessors``.
        predecessors: [W] steps that lead into a state from another one.
        required: [S, A, V] numbers of the entries that every step requires, followed by `NONE`.
        first_user: [P + 1] where the steps that require each entry begin in ``users``.
        users: [U] steps that require an entry.
        discount: γ.
        v_max: V(s_max) = R_max / (1 − γ).
        lower_bound: Lower bound of all values.
        tolerance: ε, precision of the values.
    """

    successor: Integers
    reward: Floats
    terminates: Booleans
    first_predecessor: Integers
    predecessors: Integers
    required: Integers
    first_user: Integers
    users: Integers
    discount: float
    v_max: float
    lower_bound: float
    tolerance: float


class RmaxKnowledge(NamedTuple):
    """What the kernels update in place.

    Attributes:
        is_filled: [P] whether each entry is filled.
        missing: [S, A] number of entries that a step lacks.
        values: [S] V of what is known.
        queue: [S] states whose values are to be recomputed, from the front.
        is_queued: [S] whether a state is in the queue; all False between calls.
    """

    is_filled: Booleans
    missing: Integers
    values: Floats
    queue: Integers
    is_queued: Booleans


@kernel
def run_episode(start: int, max_steps: int, problem: RmaxProblem, knowledge: RmaxKnowledge) -> int:
    """Run one episode: act greedily, learn, and repair the values; return its number of steps."""
    state = start
    for step in range(1, max_steps + 1):
        action = _greedy_action(state, problem, knowledge)
        learnt = _learn(state, action, problem, knowledge)
        if learnt:
            _recompute(_queue_overestimated(learnt, problem, knowledge), problem, knowledge)
        if problem.terminates[state, action]:
            return step
        state = problem.successor[state, action]
    return max_steps


@kernel
def _learn(state: int, action: int, problem: RmaxProblem, knowledge: RmaxKnowledge) -> int:
    """Fill the entries of a step, and queue the states of which a step becomes known by that.

    Returns:
        Number of states in the queue.
    """
    actions, queued = knowledge.missing.shape[1], 0
    for entry in problem.required[state, action]:
        if entry == NONE or knowledge.is_filled[entry]:
            continue
        knowledge.is_filled[entry] = True
        for step in problem.users[problem.first_user[entry] : problem.first_user[entry + 1]]:
            user, by = step // actions, step % actions
            knowledge.missing[user, by] -= 1
            if knowledge.missing[user, by] == 0 and not knowledge.is_queued[user]:
                knowledge.is_queued[user] = True
                knowledge.queue[queued] = user
                queued += 1
    for at in range(queued):
        knowledge.is_queued[knowledge.queue[at]] = False
    return queued


@kernel
def _queue_overestimated(learnt: int, problem: RmaxProblem, knowledge: RmaxKnowledge) -> int:
    """Keep in the queue the states whose values are too high now, and add all states that depend on them.

    A state depends on another if some step from it to there is worth as much as the state. All states left out have a
    best step that leads to none in the queue, so that their values stay right.

    Args:
        learnt: Number of states in the queue at the beginning.
        problem: The MDP and its entries.
        knowledge: Values and queue.

    Returns:
        Number of states in the queue.
    """
    successor, reward, terminates = problem.successor, problem.reward, problem.terminates
    missing, values = knowledge.missing, knowledge.values
    discount, v_max = problem.discount, problem.v_max
    queue, is_queued, predecessors = knowledge.queue, knowledge.is_queued, problem.predecessors
    actions, queued = missing.shape[1], 0
    for at in range(learnt):
        state = queue[at]
        if values[state] > _max_q(state, successor, reward, terminates, missing, values, discount, v_max):
            is_queued[state] = True
            queue[queued] = state
            queued += 1
    at = 0
    while at < queued:
        target = queue[at]
        at += 1
        for step in predecessors[problem.first_predecessor[target] : problem.first_predecessor[target + 1]]:
            state, action = step // actions, step % actions
            if is_queued[state] or missing[state, action]:
                continue
            if reward[state, action] + discount * values[target] >= values[state]:
                is_queued[state] = True
                queue[queued] = state
                queued += 1
    for at in range(queued):
        is_queued[queue[at]] = False
    return queued


@kernel
def _recompute(count: int, problem: RmaxProblem, knowledge: RmaxKnowledge) -> None:
    """Recompute the values of the states in the queue from below, in alternating sweeps, until none changes."""
    successor, reward, terminates = problem.successor, problem.reward, problem.terminates
    missing, values = knowledge.missing, knowledge.values
    discount, v_max = problem.discount, problem.v_max
    queue = knowledge.queue
    for at in range(count):
        values[queue[at]] = problem.lower_bound
    change = math.inf
    while change > problem.tolerance:
        change = 0.0
        for turn in range(2 * count):
            state = queue[turn if turn < count else 2 * count - 1 - turn]
            value = max(values[state], _max_q(state, successor, reward, terminates, missing, values, discount, v_max))
            change = max(change, value - values[state])
            values[state] = value


@kernel
def _q_value(
    state: int,
    action: int,
    successor: Integers,
    reward: Floats,
    terminates: Booleans,
    missing: Integers,
    values: Floats,
    discount: float,
    v_max: float,
) -> float:
    """Return Q(s, a); V(s_max) where the step is not known. Passing whole tuples here would be much slower."""
    if missing[state, action]:
        return v_max
    q: float = reward[state, action]
    if not terminates[state, action]:
        q += discount * values[successor[state, action]]
    return q


@kernel
def _max_q(
    state: int,
    successor: Integers,
    reward: Floats,
    terminates: Booleans,
    missing: Integers,
    values: Floats,
    discount: float,
    v_max: float,
) -> float:
    """Return max_a Q(s, a)."""
    highest = -math.inf
    for action in range(successor.shape[1]):
        q = _q_value(state, action, successor, reward, terminates, missing, values, discount, v_max)
        highest = max(highest, q)
    return highest


@kernel
def _greedy_action(state: int, problem: RmaxProblem, knowledge: RmaxKnowledge) -> int:
    """Return the first of the best actions."""
    best, highest = 0, -math.inf
    successor, reward, terminates = problem.successor, problem.reward, problem.terminates
    missing, values = knowledge.missing, knowledge.values
    for action in range(successor.shape[1]):
        q = _q_value(state, action, successor, reward, terminates, missing, values, problem.discount, problem.v_max)
        if q > highest + Q_TOLERANCE:
            best, highest = action, q
    return best


@kernel
def count_solved(probes: Integers, problem: RmaxProblem, knowledge: RmaxKnowledge) -> int:
    """Return how many of the probes [P, 2], states and fewest steps, the greedy policy solves in that many steps."""
    solved = 0
    for probe in range(len(probes)):
        state = probes[probe, 0]
        for step in range(1, probes[probe, 1] + 1):
            action = _greedy_action(state, problem, knowledge)
            if problem.terminates[state, action]:
                solved += step == probes[probe, 1]
                break
            state = problem.successor[state, action]
    return solved
