"""The shortest delivery on the true plan, which a robot's path is compared with."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator

from wherry.floorplan.plan import Cell, Direction, FloorPlan

_State = tuple[Cell, frozenset[Cell], bool]
"""The robot's cell, the cells of the boxes on the floor, and whether the robot holds a box."""


def shortest_delivery(plan: FloorPlan, robot: Cell, boxes: Iterable[Cell], *, has_load: bool) -> int | None:
    """The smallest number of moves in which a robot can deliver all boxes (0–1 breadth-first search).

    The robot carries one box at a time, and with a full fork it cannot enter another box's cell.

    Args:
        plan: The true plan; its own boxes and robot are ignored.
        robot: The robot's cell.
        boxes: The cells of the boxes on the floor.
        has_load: Whether the robot holds a further box.

    Returns:
        Number of moves between cells; pick-ups and drop-offs cost none. None if not all boxes can be delivered. Time
        and memory are O(cells × 2^boxes).
    """
    start: _State = (robot, frozenset(boxes), has_load)
    moves = {start: 0}
    queue = deque([start])
    while queue:
        state = queue.popleft()
        _, on_floor, is_loaded = state
        if not on_floor and not is_loaded:
            return moves[state]
        for successor, cost in _successors(plan, state):
            cost_so_far = moves[state] + cost
            if cost_so_far < moves.get(successor, cost_so_far + 1):
                moves[successor] = cost_so_far
                # Zero-cost successors go first, so that states are expanded in the order of their moves.
                (queue.append if cost else queue.appendleft)(successor)
    return None


def _successors(plan: FloorPlan, state: _State) -> Iterator[tuple[_State, int]]:
    """The states that one action leads to, and its number of moves, 0 or 1."""
    cell, on_floor, is_loaded = state
    if is_loaded and cell in plan.warehouse:
        yield (cell, on_floor, False), 0
    if not is_loaded and cell in on_floor:
        yield (cell, on_floor - {cell}, True), 0
    is_fork_full = is_loaded or cell in on_floor
    for direction in Direction:
        neighbour = cell.neighbour(direction)
        if not plan.is_blocked(cell, direction) and not (is_fork_full and neighbour in on_floor):
            yield (neighbour, on_floor, is_loaded), 1
