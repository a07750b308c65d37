"""Breadth-first search through an environment, for comparison with planners."""

from __future__ import annotations

from collections import deque

from wherry.oomdp.mdp import DeterministicMdp
from wherry.oomdp.objects import State


def steps_to_every_state(environment: DeterministicMdp, start: State) -> dict[State, int]:
    """The fewest steps to every reachable state; terminal states are not expanded."""
    steps, queue = {start: 0}, deque([start])
    while queue:
        state = queue.popleft()
        for action in environment.domain.ground_actions(state):
            result = environment.transition(state, action)
            if result.next_state not in steps:
                steps[result.next_state] = steps[state] + 1
                if not result.terminated:
                    queue.append(result.next_state)
    return steps
