"""Best-first search on a lazily grounded model: A* to a goal, and the cheapest way to find something out.

A step that the model cannot tell about has no successor. `a_star` never takes one, so that its plans are as sure as the
model is; `cheapest_experiment` looks for nothing else.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import count

from wherry.oomdp.domain import Action
from wherry.oomdp.mdp import Prediction
from wherry.oomdp.objects import State
from wherry.planning.successors import Successors

Remaining = Callable[[State], float]
"""How much is still to be done in a state; 0 in a goal."""

Heuristic = Callable[[State], float]
"""h(s): never more than the number of steps from a state to a goal."""


@dataclass(frozen=True, slots=True)
class Plan:
    """What to do, and where it leads.

    Attributes:
        actions: In their order.
        states: The states before every action, and, unless the last action is an experiment, the state at the end.
        cost: What it all costs.
    """

    actions: tuple[Action, ...]
    states: tuple[State, ...]
    cost: float


def step_cost(prediction: Prediction) -> float:
    """What a step costs: as many tries as it takes on average until it does what is predicted, 1/p."""
    return 1 / prediction.probability


def no_heuristic(state: State) -> float:
    """h(s) = 0: nothing is known about the way that is left."""
    return 0.0


def a_star(
    successors: Successors, start: State, remaining: Remaining, heuristic: Heuristic = no_heuristic
) -> tuple[Plan, float]:
    """The shortest plan to a state in which nothing remains to be done, or else to one in which the least remains.

    What is most likely is taken to be sure.

    Hart, Nilsson and Raphael 1968; among equally promising states the one farthest along comes first.

    Args:
        successors: The model.
        start: s_0.
        remaining: What is to become 0, or as small as can be.
        heuristic: h, admissible.

    Returns:
        The plan, which is empty where nothing can be improved, and how much remains at its end.
    """
    successors.refresh()
    cost, came_from = {start: 0.0}, dict[State, tuple[State, Action]]()
    best, least = start, remaining(start)
    tie = count()
    queue = [(heuristic(start), 0.0, next(tie), start)]
    closed = set[State]()
    while queue and least > 0:
        _, _, _, state = heappop(queue)
        if state in closed:
            continue
        closed.add(state)
        left = remaining(state)
        if left < least:
            best, least = state, left
        for action, prediction in successors.of(state):
            after = prediction.state
            if after is None or after is state:
                continue
            g = cost[state] + 1
            if g < cost.get(after, math.inf):
                cost[after], came_from[after] = g, (state, action)
                heappush(queue, (g + heuristic(after), -g, next(tie), after))
    return _plan(came_from, cost, best), least


def cheapest_experiment(
    successors: Successors, start: State, *, doubts_only: bool = False, limit: float = math.inf
) -> Plan | None:
    """The plan that ends with the experiment that is cheapest, the way there included.

    An experiment is a step that the model cannot tell about, which costs 1/p, where p is how likely it is that the
    action does anything at all; or one about which there is doubt, which costs the more the less trying it settles.
    Steps on the way of which the model is not sure cost what they take until they succeed.

    Args:
        successors: The model.
        start: s_0.
        doubts_only: Whether to settle doubts only, and to leave alone what cannot be foretold.
        limit: The most that it may cost.

    Returns:
        The plan, whose last action is the experiment, or None where there is nothing left to find out.
    """
    successors.refresh()
    cost, came_from = {start: 0.0}, dict[State, tuple[State, Action]]()
    tie = count()
    queue = [(0.0, next(tie), start)]
    closed = set[State]()
    best = None
    while queue and queue[0][0] < (limit if best is None else best[0]):
        _, _, state = heappop(queue)
        if state in closed:
            continue
        closed.add(state)
        for action, prediction in successors.of(state):
            total = cost[state] + experiment_cost(prediction, doubts_only=doubts_only)
            if total < (limit if best is None else best[0]):
                best = total, state, action
            for branch in (prediction, *prediction.otherwise):
                if branch.state is None or not branch.probability:
                    continue
                g = cost[state] + step_cost(branch)
                if g < cost.get(branch.state, math.inf):
                    cost[branch.state], came_from[branch.state] = g, (state, action)
                    heappush(queue, (g, next(tie), branch.state))
    if best is None:
        return None
    total, state, action = best
    way = _plan(came_from, cost, state)
    return Plan((*way.actions, action), way.states, total)


def experiment_cost(prediction: Prediction, *, doubts_only: bool) -> float:
    """What a step costs as an experiment: the less the more it teaches; infinite where that is nothing."""
    unknown = [branch.probability for branch in (prediction, *prediction.otherwise) if branch.state is None]
    teaches = max(prediction.doubt, 0.0 if doubts_only else max(unknown, default=0.0))
    return 1 / teaches if teaches else math.inf


def _plan(came_from: dict[State, tuple[State, Action]], cost: dict[State, float], end: State) -> Plan:
    """The way by which a search came to a state."""
    actions, states = list[Action](), [end]
    while states[-1] in came_from:
        before, action = came_from[states[-1]]
        actions.append(action)
        states.append(before)
    return Plan(tuple(reversed(actions)), tuple(reversed(states)), cost[end])
