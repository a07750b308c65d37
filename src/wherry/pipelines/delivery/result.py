"""The result of a delivery, and the shortest delivery that it is compared with."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from enum import StrEnum

from wherry.floorplan.plan import Cell, Direction, FloorPlan


class DeliveryStatus(StrEnum):
    """How a delivery ended; the values are those of result.json."""

    DELIVERED = "delivered"
    NOT_DELIVERED = "not delivered"
    STOPPED = "stopped"


EXIT_STATUS = {DeliveryStatus.DELIVERED: 0, DeliveryStatus.NOT_DELIVERED: 1, DeliveryStatus.STOPPED: 130}


@dataclass(frozen=True, slots=True)
class DeliveryResult:
    """The referee's score of a delivery; None for a metric that could not be measured.

    Attributes:
        delivered: Number of boxes that the warehouse has taken.
        boxes: Number of boxes in the world.
        unreachable: Number of boxes that no robot could have delivered.
        collisions: Number of contacts of the robot or its load with a wall, an obstacle or another box.
        learning_steps: Number of actions whose outcome the robot could not predict.
        actions: Number of actions.
        path_ratio: Cells driven while following complete plans ÷ fewest cells, on the true plan, of the same progress.
        localization_rmse_m: Root mean square error of the position after mapping, m, map aligned with the world.
        map_error_m: Median distance of the map's occupied cells from the true walls, m.
        sim_seconds: Simulated time, s.
        wall_seconds: Wall-clock time, s.
        real_time_factor: Simulated time ÷ wall-clock time.
        seed: Seed of the run.
        world: Name of the world.
        status: How the delivery ended.
    """

    delivered: int
    boxes: int
    unreachable: int
    collisions: int
    learning_steps: int
    actions: int
    path_ratio: float | None
    localization_rmse_m: float | None
    map_error_m: float | None
    sim_seconds: float
    wall_seconds: float
    real_time_factor: float
    seed: int
    world: str
    status: DeliveryStatus

    def as_json(self) -> dict[str, object]:
        """The attributes, with floats rounded to four decimals."""
        return {name: round(value, 4) if isinstance(value, float) else value for name, value in asdict(self).items()}

    @property
    def metrics(self) -> dict[str, str]:
        """The metrics for people: names in words, values with units."""

        def centimetres(value: float | None) -> str:
            return "not measured" if value is None else f"{100 * value:.1f} cm"

        return {
            "boxes delivered": f"{self.delivered} of {self.boxes}",
            "boxes that cannot be reached": str(self.unreachable),
            "collisions": str(self.collisions),
            "actions": str(self.actions),
            "actions with an unpredictable outcome": str(self.learning_steps),
            "cells driven ÷ fewest possible, while delivering": (
                "not measured" if self.path_ratio is None else f"{self.path_ratio:.2f}"
            ),
            "localization error (RMSE)": centimetres(self.localization_rmse_m),
            "map error (median)": centimetres(self.map_error_m),
            "simulated time": f"{self.sim_seconds:.0f} s",
            "wall-clock time": f"{self.wall_seconds:.1f} s",
        }

    @property
    def verdict(self) -> str:
        """The result in a few words."""
        if self.status is DeliveryStatus.STOPPED:
            return "stopped"
        if self.status is DeliveryStatus.NOT_DELIVERED:
            return "not all delivered"
        if not self.unreachable:
            return "all delivered"
        return "all reachable boxes delivered" if self.delivered else "no box can be reached"

    @property
    def exit_status(self) -> int:
        """Exit status of the command."""
        return EXIT_STATUS[self.status]


def shortest_delivery(plan: FloorPlan, robot: Cell, boxes: Iterable[Cell], *, has_load: bool) -> int | None:
    """The fewest cells that a robot must drive to deliver all boxes (breadth-first search, zero-cost actions first).

    The robot carries one box at a time, and with a full fork it cannot enter another box's cell.

    Args:
        plan: The true plan; its own boxes and robot are ignored.
        robot: The robot's cell.
        boxes: The cells of the boxes on the floor.
        has_load: Whether the robot holds one more box.

    Returns:
        Number of moves, without pick-ups and drop-offs; None if not all boxes can be delivered. The search grows with
        cells × 2^boxes.
    """
    start: _State = (robot, frozenset(boxes), has_load)
    moves = {start: 0}
    queue = deque([start])
    while queue:
        state = queue.popleft()
        _, on_floor, carrying = state
        if not on_floor and not carrying:
            return moves[state]
        for successor, cost in _successors(plan, state):
            reached = moves[state] + cost
            if reached < moves.get(successor, reached + 1):
                moves[successor] = reached
                # Zero-cost successors go first, so that states are expanded in the order of their moves.
                (queue.append if cost else queue.appendleft)(successor)
    return None


_State = tuple[Cell, frozenset[Cell], bool]  # the robot's cell, the cells of boxes on the floor, whether it has a load


def _successors(plan: FloorPlan, state: _State) -> Iterator[tuple[_State, int]]:
    """The states that one action leads to, and the number of cells it drives."""
    cell, on_floor, carrying = state
    if carrying and cell in plan.warehouse:
        yield (cell, on_floor, False), 0
    if not carrying and cell in on_floor:
        yield (cell, on_floor - {cell}, True), 0
    fork_full = carrying or cell in on_floor
    for direction in Direction:
        there = cell.neighbour(direction)
        if not plan.is_blocked(cell, direction) and not (fork_full and there in on_floor):
            yield (there, on_floor, carrying), 1
