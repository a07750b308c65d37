"""The compiled inner loops of R-max: act greedily, learn, and recompute the values that became too high.

Values are kept between steps. The value of a state is V(s_max) until its last unknown action was tried, so most steps
change no value; after the others only the values that depended on the unknown step are recomputed.

Array dimensions: S states, A actions, V entries of a step, P entries of all tables, W steps that change the state,
U requirements (pairs of a step and an entry that it requires).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from wherry.baselines.compiled.model_entries import PADDING
from wherry.baselines.compiled.tabular import Booleans, Floats, Integers
from wherry.kernels import kernel
from wherry.planning.lookahead import Q_TOLERANCE


class RmaxProblem(NamedTuple):
    """The MDP and the table entries, which the kernels only read. A step (s, a) has the number s·A + a.

    Attributes:
        successor: [S, A] number of s'.
        reward: [S, A] r.
        terminates: [S, A] whether the step ends the episode.
        first_predecessor: [S + 1] index in ``predecessors`` of the first step into each state.
        predecessors: [W] steps into a state from another one, grouped by that state.
        required: [S, A, V] numbers of the entries that every step requires, followed by `PADDING`.
        first_user: [P + 1] index in ``users`` of the first step that requires each entry.
        users: [U] steps that require an entry, grouped by that entry.
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
    """The learnt tables and values, which the kernels update in place.

    Attributes:
        is_filled: [P] whether each entry is filled.
        missing: [S, A] number of required entries of each step that are not filled.
        values: [S] V of the optimistic model.
        queue: [S] buffer for the states whose values are to be recomputed; the queue is its beginning.
        is_queued: [S] whether a state is in the queue; all False between calls.
    """

    is_filled: Booleans
    missing: Integers
    values: Floats
    queue: Integers
    is_queued: Booleans


@kernel
def run_episode(start: int, max_steps: int, problem: RmaxProblem, knowledge: RmaxKnowledge) -> int:
    """Run one episode: act greedily, learn, and recompute values; return its number of steps."""
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
    """Fill the entries of a step, and queue the states of all steps that become known thereby.

    Returns:
        Number of states in the queue.
    """
    actions, queued = knowledge.missing.shape[1], 0
    for entry in problem.required[state, action]:
        if entry == PADDING or knowledge.is_filled[entry]:
            continue
        knowledge.is_filled[entry] = True
        for step in problem.users[problem.first_user[entry] : problem.first_user[entry + 1]]:
            user_state, user_action = step // actions, step % actions
            knowledge.missing[user_state, user_action] -= 1
            if knowledge.missing[user_state, user_action] == 0 and not knowledge.is_queued[user_state]:
                knowledge.is_queued[user_state] = True
                knowledge.queue[queued] = user_state
                queued += 1
    for index in range(queued):
        knowledge.is_queued[knowledge.queue[index]] = False
    return queued


@kernel
def _queue_overestimated(learnt: int, problem: RmaxProblem, knowledge: RmaxKnowledge) -> int:
    """Keep in the queue only the states whose values are now too high, and add all states that depend on them.

    A state depends on a successor if Q of a step to it is at least V of the state. Every state outside the final queue
    has a best step to a state that is also outside, so its value is still right.

    Args:
        learnt: Number of states in the queue at the beginning.
        problem: The MDP and the table entries.
        knowledge: Values and queue.

    Returns:
        Number of states in the queue.
    """
    successor, reward, terminates = problem.successor, problem.reward, problem.terminates
    missing, values = knowledge.missing, knowledge.values
    discount, v_max = problem.discount, problem.v_max
    queue, is_queued, predecessors = knowledge.queue, knowledge.is_queued, problem.predecessors
    actions, queued = missing.shape[1], 0
    for index in range(learnt):
        state = queue[index]
        if values[state] > _max_q(state, successor, reward, terminates, missing, values, discount, v_max):
            is_queued[state] = True
            queue[queued] = state
            queued += 1
    index = 0
    while index < queued:
        target = queue[index]
        index += 1
        for step in predecessors[problem.first_predecessor[target] : problem.first_predecessor[target + 1]]:
            state, action = step // actions, step % actions
            if is_queued[state] or missing[state, action]:
                continue
            if reward[state, action] + discount * values[target] >= values[state]:
                is_queued[state] = True
                queue[queued] = state
                queued += 1
    for index in range(queued):
        is_queued[queue[index]] = False
    return queued


@kernel
def _recompute(count: int, problem: RmaxProblem, knowledge: RmaxKnowledge) -> None:
    """Recompute the values of the states in the queue from their lower bound.

    Sweeps in alternating directions are repeated until no value changes by more than the tolerance.
    """
    successor, reward, terminates = problem.successor, problem.reward, problem.terminates
    missing, values = knowledge.missing, knowledge.values
    discount, v_max = problem.discount, problem.v_max
    queue = knowledge.queue
    for index in range(count):
        values[queue[index]] = problem.lower_bound
    change = math.inf
    while change > problem.tolerance:
        change = 0.0
        for visit in range(2 * count):
            state = queue[visit if visit < count else 2 * count - 1 - visit]
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
    """Return Q(s, a); V(s_max) where the step is not known. Passing the arrays in tuples would be much slower."""
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
    """Return the first of the actions with the highest Q, within `Q_TOLERANCE`."""
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
