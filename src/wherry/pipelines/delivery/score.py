"""What a referee computes of a run: aligned errors, and the shortest delivery that there is."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from wherry.floorplan.plan import Cell, Direction, FloorPlan
from wherry.space.pose import Floats, Pose

DELIVERED, NOT_DELIVERED, STOPPED = 0, 1, 130  # exit statuses
LEVER = 1.0  # m: a heading that is off by an angle counts like a position that is off by that angle at this distance


@dataclass(frozen=True, slots=True)
class Result:
    """What the referee says of a run; fields without a value could not be measured.

    Attributes:
        delivered: Boxes that the warehouse has taken in.
        boxes: Boxes that there were.
        unreachable: Those that no robot could have delivered.
        collisions: Contacts of the robot or its load with a wall, an obstacle or another box.
        learning_steps: Actions whose outcome the robot could not predict.
        actions: All actions.
        path_ratio: Cells driven while following a complete plan ÷ the fewest on the true plan that do as much of the
            job.
        localization_rmse_m: m, of all poses after the map was finished, against the true ones.
        map_error_m: m, median distance of mapped wall points to the true walls.
        sim_seconds: s in the simulated world.
        wall_seconds: s on the wall clock.
        real_time_factor: Simulated ÷ wall-clock time.
        seed: Of the run.
        world: Its name.
        status: "delivered", "not delivered" or "stopped".
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
    status: str

    def as_json(self) -> dict[str, object]:
        """The fields, with figures rounded to what they can be trusted for."""
        return {name: round(value, 4) if isinstance(value, float) else value for name, value in asdict(self).items()}

    @property
    def figures(self) -> dict[str, str]:
        """The fields for people: in words, and with units."""

        def metres(value: float | None) -> str:
            return "not measured" if value is None else f"{100 * value:.1f} cm"

        return {
            "boxes delivered": f"{self.delivered} of {self.boxes}",
            "boxes that nobody can reach": str(self.unreachable),
            "collisions": str(self.collisions),
            "actions": str(self.actions),
            "of which it could not tell what they do": str(self.learning_steps),
            "cells driven ÷ fewest possible, while delivering": (
                "not measured" if self.path_ratio is None else f"{self.path_ratio:.2f}"
            ),
            "localization error (rms)": metres(self.localization_rmse_m),
            "map error (median)": metres(self.map_error_m),
            "simulated time": f"{self.sim_seconds:.0f} s",
            "wall-clock time": f"{self.wall_seconds:.1f} s",
        }

    @property
    def verdict(self) -> str:
        """The outcome in a few words."""
        if self.status != "delivered":
            return {"not delivered": "not all delivered", "stopped": "stopped"}[self.status]
        if not self.unreachable:
            return "all delivered"
        return "all delivered that can be reached" if self.delivered else "nothing can be reached"

    @property
    def exit_status(self) -> int:
        """What the command exits with."""
        return {"delivered": DELIVERED, "not delivered": NOT_DELIVERED, "stopped": STOPPED}[self.status]


def align(estimated: Sequence[Pose], true: Sequence[Pose]) -> Pose:
    """The rigid motion that carries estimated poses onto true ones best, in the sense of least squares.

    A map's frame is where the robot was switched on, which no map can know; errors are therefore counted after the one
    motion that fits the whole trajectory (absolute trajectory error, Sturm et al. 2012; Umeyama 1991 without scale).
    Headings take part, so that a robot that hardly moved can be aligned too.

    Args:
        estimated: Poses in the map frame, at least one.
        true: The same instants' poses in the world frame.

    Returns:
        The map's frame in the world.
    """
    source, target = _positions(estimated), _positions(true)
    source_middle, target_middle = source.mean(axis=0), target.mean(axis=0)
    a, b = source - source_middle, target - target_middle
    turns = np.array([there.theta - here.theta for here, there in zip(estimated, true, strict=True)])
    cosines = float(np.sum(a * b)) + LEVER**2 * float(np.cos(turns).sum())
    sines = float(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])) + LEVER**2 * float(np.sin(turns).sum())
    theta = math.atan2(sines, cosines)
    offset = target_middle - Pose(theta=theta).transform(source_middle[None, :])[0]
    return Pose(float(offset[0]), float(offset[1]), theta)


def position_errors(estimated: Sequence[Pose], true: Sequence[Pose], world_from_map: Pose) -> Floats:
    """[N] m: how far each estimated position, carried into the world, is from the true one."""
    errors: Floats = np.hypot(*(world_from_map.transform(_positions(estimated)) - _positions(true)).T)
    return errors


def root_mean_square(errors: Floats) -> float:
    """√ of the mean of squares, in the errors' unit."""
    return math.sqrt(float(np.mean(errors**2)))


def shortest_delivery(plan: FloorPlan, robot: Cell, boxes: Iterable[Cell], *, loaded: bool) -> int | None:
    """The fewest cells that a robot must drive to deliver all boxes, by breadth-first search over everything.

    The robot carries one box at a time, and with a full fork it cannot enter another box's cell.

    Args:
        plan: The true plan; its own boxes and robot are not looked at.
        robot: Where the robot is.
        boxes: The boxes on the floor.
        loaded: Whether the robot holds one more.

    Returns:
        Moves, not counting pick-ups and drop-offs; None if it cannot be done. Grows with cells × 2^boxes.
    """
    start: _Situation = (robot, frozenset(boxes), loaded)
    moves = {start: 0}
    queue = deque([start])
    while queue:
        situation = queue.popleft()
        _, left, carrying = situation
        if not left and not carrying:
            return moves[situation]
        for following, cost in _next(plan, situation):
            reached = moves[situation] + cost
            if reached < moves.get(following, reached + 1):
                moves[following] = reached
                # What costs nothing is looked at first, so that situations come in the order of their moves.
                (queue.append if cost else queue.appendleft)(following)
    return None


_Situation = tuple[Cell, frozenset[Cell], bool]


def _next(plan: FloorPlan, situation: _Situation) -> Iterator[tuple[_Situation, int]]:
    """What one action can lead to, and how many cells it drives."""
    cell, left, carrying = situation
    if carrying and cell in plan.warehouse:
        yield (cell, left, False), 0
    if not carrying and cell in left:
        yield (cell, left - {cell}, True), 0
    full = carrying or cell in left
    for direction in Direction:
        there = cell.neighbour(direction)
        if not plan.is_blocked(cell, direction) and not (full and there in left):
            yield (there, left, carrying), 1


def _positions(poses: Sequence[Pose]) -> Floats:
    return np.array([[pose.x, pose.y] for pose in poses])
