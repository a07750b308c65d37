"""Compiled Bellman backups on the tables of a `StateSpace`: reachability, greedy actions and value sweeps."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from wherry.kernels import kernel
from wherry.planning.lookahead import Q_TOLERANCE
from wherry.planning.state_space import NOT_GROUNDED, TERMINAL_SUCCESSOR, UNKNOWN_SUCCESSOR, Floats, Integers

NO_OUTCOME = -1  # entry of the outcomes table: the action does not exist in the group, or has no further outcome


class BackupTables(NamedTuple):
    """An MDP as arrays: S states in G groups, A actions with up to K outcomes each, O conditional outcomes in all.

    Attributes:
        group: [S] group number of every state.
        outcomes: [G, A, K] numbers of the predicted conditional outcomes, or NO_OUTCOME.
        probabilities: [G, A, K] probability of each predicted outcome.
        disagreements: [G, A] the disagreement of each prediction.
        successor: [O, S] number of each successor state, or a negative constant of `state_space`.
        reward: [O, S] reward of outcome o in state s.
        values: [S] V(s).
        discount: γ.
        unknown_value: V(s_max).
        curiosity: Bonus for an action of disagreement 1, in units of reward.
    """

    group: Integers
    outcomes: Integers
    probabilities: Floats
    disagreements: Floats
    successor: Integers
    reward: Floats
    values: Floats
    discount: float
    unknown_value: float
    curiosity: float


@kernel
def reachable_states(
    starts: Integers, n_states: int, tables: BackupTables, queried_revisions: Integers, revisions: Integers
) -> tuple[Integers, Integers]:
    """Find all states that can be reached from some states, breadth first.

    Args:
        starts: [N] state numbers.
        n_states: S, the number of states.
        tables: The MDP, of which entries may be missing.
        queried_revisions: [G, A] revision at which the model was last queried about a group and action.
        revisions: [A] current revision of every action.

    Returns:
        [R] the reachable states, nearest first; [M, 2] the missing entries: a state with the number of an outcome that
        is not grounded in it yet, or with NO_OUTCOME if the model has to be queried first.
    """
    group, outcomes, successor = tables.group, tables.outcomes, tables.successor
    seen = np.zeros(n_states, np.bool_)
    order = np.empty(n_states, np.int32)
    missing = np.empty((n_states * outcomes.shape[1] * outcomes.shape[2], 2), np.int32)
    n_reached, n_missing, n_expanded = 0, 0, 0
    for start in starts:
        if not seen[start]:
            seen[start] = True
            order[n_reached] = start
            n_reached += 1
    while n_expanded < n_reached:
        state = order[n_expanded]
        n_expanded += 1
        for action in range(outcomes.shape[1]):
            is_queried = queried_revisions[group[state], action] == revisions[action]
            for outcome in outcomes[group[state], action]:
                if is_queried and outcome == NO_OUTCOME:
                    continue
                if not is_queried or successor[outcome, state] == NOT_GROUNDED:
                    missing[n_missing, 0] = state
                    missing[n_missing, 1] = outcome if is_queried else NO_OUTCOME
                    n_missing += 1
                    continue
                target = successor[outcome, state]
                if target >= 0 and not seen[target]:
                    seen[target] = True
                    order[n_reached] = target
                    n_reached += 1
    return order[:n_reached].copy(), missing[:n_missing].copy()


@kernel
def linear_backup(state: int, action: int, tables: BackupTables, weights: Floats, targets: Integers) -> float:
    """Q(s, a) as a linear function of the values: the returned constant plus Σ_k weights[k] V(targets[k]).

    The constant is -inf where the action is impossible.

    Args:
        state: s.
        action: a.
        tables: The MDP.
        weights: [K] is overwritten: γ P(s'|s, a), or 0 for an outcome without successor.
        targets: [K] is overwritten: s', or 0.
    """
    group = tables.group[state]
    total, constant = 0.0, 0.0
    weights[:] = 0.0
    targets[:] = 0
    for k in range(tables.outcomes.shape[2]):
        outcome, probability = tables.outcomes[group, action, k], tables.probabilities[group, action, k]
        if outcome == NO_OUTCOME or probability == 0.0:
            continue
        target = tables.successor[outcome, state]
        if target >= 0:
            constant += probability * tables.reward[outcome, state]
            weights[k], targets[k] = probability * tables.discount, target
        elif target == TERMINAL_SUCCESSOR:
            constant += probability * tables.reward[outcome, state]
        elif target == UNKNOWN_SUCCESSOR:
            constant += probability * tables.unknown_value
        else:
            continue
        total += probability
    if total == 0:
        return -math.inf
    weights /= total
    disagreement: float = tables.disagreements[group, action]
    return constant / total + tables.curiosity * disagreement


@kernel
def greedy_action(state: int, tables: BackupTables) -> int:
    """The number of the best action; of equally good ones the first."""
    width = tables.outcomes.shape[2]
    weights, targets = np.empty(width), np.empty(width, np.int32)
    best, best_value = 0, -math.inf
    for action in range(tables.outcomes.shape[1]):
        value = linear_backup(state, action, tables, weights, targets)
        for k in range(width):
            value += weights[k] * tables.values[targets[k]]
        if value > best_value + Q_TOLERANCE:
            best, best_value = action, value
    return best


@kernel
def sweep(states: Integers, tolerance: float, tables: BackupTables) -> None:
    """Gauss–Seidel value iteration in alternating directions until no value changes by more than the tolerance.

    Values start below every possible return, so they increase monotonically. The linear backups are tabulated first,
    so that a sweep reads memory sequentially.

    Args:
        states: [R] a closed set of states, nearest first.
        tolerance: ε.
        tables: The MDP; its values are overwritten for the states.
    """
    group, outcomes, values = tables.group, tables.outcomes, tables.values
    n_states, n_actions, width = len(states), outcomes.shape[1], outcomes.shape[2]
    constants, lowest_reward = np.empty((n_states, n_actions)), 0.0
    weights = np.empty((n_states, n_actions, width))
    targets = np.empty((n_states, n_actions, width), np.int32)
    for index in range(n_states):
        state = states[index]
        for action in range(n_actions):
            row = index, action
            constants[row] = linear_backup(state, action, tables, weights[row], targets[row])
        for outcome in outcomes[group[state]].flat:
            if outcome != NO_OUTCOME:
                lowest_reward = min(lowest_reward, tables.reward[outcome, state])
    for state in states:
        values[state] = lowest_reward / (1 - tables.discount)
    change = math.inf
    while change > tolerance:
        change = 0.0
        for turn in range(2 * n_states):  # from the farthest state to the nearest, and back
            index = n_states - 1 - turn if turn < n_states else turn - n_states
            best = values[states[index]]
            previous = best
            for action in range(n_actions):
                value = constants[index, action]
                for k in range(width):
                    value += weights[index, action, k] * values[targets[index, action, k]]
                best = max(best, value)
            values[states[index]] = best
            change = max(change, best - previous)
