"""Best-first search on a lazily grounded model: A* to a goal, and uniform-cost search for the cheapest experiment.

An unknown outcome has no successor, so plans of `a_star` contain none; `cheapest_experiment` searches for them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import count

from wherry.oomdp.domain import Action
from wherry.oomdp.mdp import Outcome, Prediction
from wherry.oomdp.objects import State
from wherry.planning.prediction_cache import PredictionCache

UnmetGoals = Callable[[State], float]
"""Number of unmet goals in a state, such as boxes to deliver; 0 in a goal state."""

Heuristic = Callable[[State], float]
"""h(s), admissible: never more than the number of steps from a state to the nearest goal state."""

Parents = dict[State, tuple[State, Action]]
"""For each generated state, the state and action from which it was reached at the lowest cost so far."""


@dataclass(frozen=True, slots=True)
class Plan:
    """A sequence of actions with the states that it passes through.

    Attributes:
        actions: The actions, in order.
        states: The state before each action, followed by the final state unless the last action is an experiment.
        cost: Sum of the step costs.
    """

    actions: tuple[Action, ...]
    states: tuple[State, ...]
    cost: float


def step_cost(outcome: Outcome) -> float:
    """1/p, the expected number of attempts until an outcome of probability p happens."""
    return 1 / outcome.probability


def zero_heuristic(state: State) -> float:
    """h(s) = 0, which makes A* a uniform-cost search."""
    return 0.0


def a_star(
    cache: PredictionCache, start: State, unmet_goals: UnmetGoals, heuristic: Heuristic = zero_heuristic
) -> tuple[Plan, float]:
    """The shortest plan to a state with the fewest unmet goals, found by A* (Hart, Nilsson, Raphael 1968).

    Every action is assumed to have its most likely outcome. Among states of equal f = g + h the deepest is expanded
    first.

    Args:
        cache: The predictions of the model.
        start: s_0.
        unmet_goals: Number of unmet goals; a state where it is 0 ends the search.
        heuristic: h.

    Returns:
        The plan, empty if no state has fewer unmet goals than the start; and the number of unmet goals in its final
        state.
    """
    cache.refresh()
    cost_so_far, parents = {start: 0.0}, Parents()
    best, fewest_unmet = start, unmet_goals(start)
    insertion = count()
    open_list = [(heuristic(start), 0.0, next(insertion), start)]
    expanded = set[State]()
    while open_list and fewest_unmet > 0:
        _, _, _, state = heappop(open_list)
        if state in expanded:
            continue
        expanded.add(state)
        unmet = unmet_goals(state)
        if unmet < fewest_unmet:
            best, fewest_unmet = state, unmet
        for action, prediction in cache.predictions(state):
            successor = prediction.most_likely.next_state
            if successor is None or successor is state:
                continue
            g = cost_so_far[state] + 1
            if g < cost_so_far.get(successor, math.inf):
                cost_so_far[successor], parents[successor] = g, (state, action)
                heappush(open_list, (g + heuristic(successor), -g, next(insertion), successor))
    return _plan(parents, cost_so_far, best), fewest_unmet


def cheapest_experiment(
    cache: PredictionCache, start: State, *, disagreements_only: bool = False, max_cost: float = math.inf
) -> Plan | None:
    """The plan of least total cost that ends with an experiment: an action from which something can be learnt.

    A step before the experiment costs `step_cost`, and the experiment `experiment_cost`.

    Args:
        cache: The predictions of the model.
        start: s_0.
        disagreements_only: Whether only actions on which hypotheses disagree are experiments, and not those with
            unknown outcomes.
        max_cost: Cost that the plan must stay below.

    Returns:
        The plan, whose last action is the experiment; None if there is no experiment below the maximum cost.
    """
    cache.refresh()
    cost_so_far, parents = {start: 0.0}, Parents()
    insertion = count()
    open_list = [(0.0, next(insertion), start)]
    expanded = set[State]()
    best, best_cost = None, max_cost
    while open_list and open_list[0][0] < best_cost:
        _, _, state = heappop(open_list)
        if state in expanded:
            continue
        expanded.add(state)
        for action, prediction in cache.predictions(state):
            total = cost_so_far[state] + experiment_cost(prediction, disagreements_only=disagreements_only)
            if total < best_cost:
                best, best_cost = (state, action), total
            for outcome in prediction.outcomes:
                if outcome.next_state is None or not outcome.probability:
                    continue
                g = cost_so_far[state] + step_cost(outcome)
                if g < cost_so_far.get(outcome.next_state, math.inf):
                    cost_so_far[outcome.next_state], parents[outcome.next_state] = g, (state, action)
                    heappush(open_list, (g, next(insertion), outcome.next_state))
    if best is None:
        return None
    state, action = best
    approach = _plan(parents, cost_so_far, state)
    return Plan((*approach.actions, action), approach.states, best_cost)


def experiment_cost(prediction: Prediction, *, disagreements_only: bool) -> float:
    """1/i, where i is the larger of the disagreement and the probability of an unknown outcome; infinite if i is 0.

    With ``disagreements_only``, i is the disagreement alone.
    """
    unknown = [outcome.probability for outcome in prediction.outcomes if outcome.next_state is None]
    information = max(prediction.disagreement, 0.0 if disagreements_only else max(unknown, default=0.0))
    return 1 / information if information else math.inf


def _plan(parents: Parents, cost_so_far: dict[State, float], end: State) -> Plan:
    """The plan to a state, traced back through its parents."""
    actions, states = list[Action](), [end]
    while states[-1] in parents:
        before, action = parents[states[-1]]
        actions.append(action)
        states.append(before)
    return Plan(tuple(reversed(actions)), tuple(reversed(states)), cost_so_far[end])
