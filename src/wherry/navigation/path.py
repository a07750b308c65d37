"""Shortest paths that keep away from walls (A*, Hart et al. 1968, on a grid of clearances)."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import kernel
from wherry.space.distance_field import obstacle_distances
from wherry.space.occupancy import OccupancyGrid, cell_centres
from wherry.space.pose import Floats, Pose

PREFERRED_CLEARANCE = 0.15  # m beyond the robot's radius: closer to walls than this, a metre costs more
WALL_COST = 8.0  # how many more metres a metre costs that touches a wall
NO_DISCS = np.zeros((0, 3))
STEPS = ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1))  # to a cell's neighbours: rows, columns


@dataclass(frozen=True)
class Costmap:
    """Where the middle of a round robot may be, and how gladly.

    Attributes:
        clearance: [H, W] float32 m, from a grid cell's middle to the nearest thing that is in the way.
        passable: [H, W] whether the robot fits there.
        cost: [H, W] float32, what a metre costs there: 1 in the open, more beside walls, ``inf`` where it does not fit.
        resolution: m, a grid cell's side.
        origin: The outer corner of grid cell [0, 0] in the map frame.
    """

    clearance: NDArray[np.float32]
    passable: NDArray[np.bool_]
    cost: NDArray[np.float32]
    resolution: float
    origin: Pose

    @classmethod
    def of(
        cls,
        grid: OccupancyGrid,
        radius: float,
        *,
        obstacles: Floats = NO_DISCS,
        known_free: Floats = NO_DISCS,
        unknown_passable: bool = False,
    ) -> Self:
        """Inflate a map by the robot's radius.

        Args:
            grid: The map.
            radius: m, the robot's.
            obstacles: [K, 3] m, map frame: x, y and radius of discs that are in the way too, as boxes are.
            known_free: [K, 3] m, likewise: discs that are not, whatever the map says; the robot's own place is one
                that its lidar does not see.
            unknown_passable: Whether to drive where the map knows nothing.
        """
        blocked = grid.occupied if unknown_passable else ~grid.free
        blocked &= ~_inside(grid, known_free) | grid.occupied
        # What lies outside the map is unknown too, which one row of cells around it stands for.
        framed = np.pad(blocked, 1, constant_values=not unknown_passable)
        distance = obstacle_distances(framed)
        # From middle to middle; the thing in the way begins half a cell earlier.
        clearance = np.maximum(distance[1:-1, 1:-1] - 0.5, 0.0) * grid.resolution
        for x, y, disc in obstacles:
            clearance = np.minimum(clearance, np.maximum(_distances(grid, x, y) - disc, 0.0))
        passable = clearance >= radius
        nearness = np.clip(1.0 - (clearance - radius) / PREFERRED_CLEARANCE, 0.0, 1.0)
        cost = np.where(passable, 1.0 + WALL_COST * nearness**2, math.inf)
        return cls(clearance.astype(np.float32), passable, cost.astype(np.float32), grid.resolution, grid.origin)

    def cell_at(self, point: Floats) -> tuple[int, int]:
        """Row and column of the grid cell that contains a point, [2] m, map frame; it may lie outside the map."""
        column, row = np.floor(self.origin.inverse.transform(point[None, :2])[0] / self.resolution).astype(np.int64)
        return int(row), int(column)

    def centres(self, cells: NDArray[np.int64]) -> Floats:
        """[N, 2] m, map frame: the middles of grid cells [N, 2] (row, column)."""
        return cell_centres(cells, self.resolution, self.origin)

    def is_passable(self, point: Floats) -> bool:
        """Whether the robot fits at a point, [2] m, map frame."""
        row, column = self.cell_at(point)
        height, width = self.passable.shape
        return 0 <= row < height and 0 <= column < width and bool(self.passable[row, column])

    def nearest_passable(self, point: Floats, within: float = math.inf) -> tuple[int, int] | None:
        """Row and column of the passable cell nearest to a point, [2] m, map frame; None if none is so near, m."""
        if self.is_passable(point):
            return self.cell_at(point)
        cells = np.argwhere(self.passable)
        if len(cells) == 0:
            return None
        distances = np.hypot(*(self.centres(cells) - point[:2]).T)
        nearest = int(np.argmin(distances))
        if distances[nearest] > within:
            return None
        return int(cells[nearest, 0]), int(cells[nearest, 1])

    def roomiest(self, point: Floats, within: float) -> tuple[int, int]:
        """Row and column of the cell around a point, [2] m, map frame, with the greatest clearance.

        Args:
            point: On the map.
            within: m.
        """
        row, column = self.cell_at(point)
        reach = round(within / self.resolution)
        top, left = max(row - reach, 0), max(column - reach, 0)
        around = self.clearance[top : row + reach + 1, left : column + reach + 1]
        best = np.unravel_index(int(np.argmax(around)), around.shape)
        return top + int(best[0]), left + int(best[1])


def shortest_path(costmap: Costmap, start: Floats, goal: Floats, *, within: float = 0.3) -> Floats | None:
    """The cheapest way for the robot's middle, cut straight wherever that costs no more.

    Args:
        costmap: Where the robot may be.
        start: [2] m, map frame.
        goal: [2] m, map frame.
        within: m, how far from ``start`` and ``goal`` the nearest place may be where the robot fits.

    Returns:
        [N, 2] m, map frame, from start to goal (or to the place nearest to it that fits); None if there is no way.
    """
    first, last = costmap.nearest_passable(start, within), costmap.nearest_passable(goal, within)
    if first is None or last is None:
        return None
    costs, parents = _search(costmap.cost, *first, *last)
    if not math.isfinite(costs[last]):
        return None
    cells = _trace_back(parents, *last)
    points = costmap.centres(cells[_shortcuts(costmap.cost, cells)])
    if costmap.is_passable(goal):
        points[-1] = goal[:2]
    if len(points) == 1 or not costmap.is_passable(start):
        return np.vstack([start[:2], points])  # first of all to where the robot fits
    points[0] = start[:2]
    return points


def travel_costs(costmap: Costmap, start: Floats, *, within: float = 0.3) -> NDArray[np.float64]:
    """What it costs to get from a place to every other (Dijkstra 1959).

    Args:
        costmap: Where the robot may be.
        start: [2] m, map frame.
        within: m, how far from ``start`` the nearest place may be where the robot fits.

    Returns:
        [H, W] m, each metre weighted by `Costmap.cost`; ``inf`` where the robot cannot get to.
    """
    first = costmap.nearest_passable(start, within)
    if first is None:
        return np.full(costmap.passable.shape, math.inf)
    costs, _ = _search(costmap.cost, *first, -1, -1)
    return costs * costmap.resolution


def _distances(grid: OccupancyGrid, x: float, y: float) -> Floats:
    """[H, W] m, from the grid cells' middles to a point of the map frame."""
    column, row = grid.origin.inverse.transform(np.array([[x, y]]))[0] / grid.resolution
    rows, columns = np.arange(grid.shape[0])[:, None] + 0.5, np.arange(grid.shape[1])[None, :] + 0.5
    distances: Floats = np.hypot(rows - row, columns - column) * grid.resolution
    return distances


def _inside(grid: OccupancyGrid, discs: Floats) -> NDArray[np.bool_]:
    """[H, W] which grid cells' middles lie in one of the discs."""
    inside = np.zeros(grid.shape, np.bool_)
    for x, y, radius in discs:
        inside |= _distances(grid, x, y) <= radius
    return inside


@kernel
def _search(
    cost: NDArray[np.float32], row: int, column: int, goal_row: int, goal_column: int
) -> tuple[Floats, NDArray[np.int8]]:
    """A* over the eight neighbours, or Dijkstra to everywhere if the goal is negative.

    Returns:
        [H, W] costs in cells, final for the goal and for every cell that is cheaper, and [H, W] the step, 0 to 7, that
        led to each cell.
    """
    height, width = cost.shape
    costs = np.full((height, width), np.inf)
    parents = np.full((height, width), np.int8(-1))
    done = np.zeros((height, width), np.bool_)
    costs[row, column] = 0.0
    queue = [(0.0, row, column)]
    while len(queue) > 0:
        _, row, column = heapq.heappop(queue)
        if done[row, column]:
            continue
        done[row, column] = True
        if row == goal_row and column == goal_column:
            break
        for step in range(8):
            down, right = STEPS[step]
            next_row, next_column = row + down, column + right
            if not (0 <= next_row < height and 0 <= next_column < width) or done[next_row, next_column]:
                continue
            length = math.sqrt(down * down + right * right)
            reached = costs[row, column] + length * 0.5 * (cost[row, column] + cost[next_row, next_column])
            if reached < costs[next_row, next_column]:
                costs[next_row, next_column] = reached
                parents[next_row, next_column] = step
                rest = 0.0  # a metre costs at least 1, so the straight line never promises too little
                if goal_row >= 0:
                    rest = math.hypot(goal_row - next_row, goal_column - next_column)
                heapq.heappush(queue, (reached + rest, next_row, next_column))
    return costs, parents


def _trace_back(parents: NDArray[np.int8], row: int, column: int) -> NDArray[np.int64]:
    """[N, 2] the cells that lead to one, from the start on."""
    cells = [(row, column)]
    while parents[row, column] >= 0:
        down, right = STEPS[parents[row, column]]
        row, column = row - down, column - right
        cells.append((row, column))
    return np.array(cells[::-1], dtype=np.int64)


def _shortcuts(cost: NDArray[np.float32], cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """[M] which of a path's cells to keep, such that straight lines between them cost no more than the path."""
    return np.array(_keep(cost, cells), dtype=np.int64)


@kernel
def _keep(cost: NDArray[np.float32], cells: NDArray[np.int64]) -> list[int]:
    """As `_shortcuts`: from each kept cell on to the last one that a straight line reaches as cheaply."""
    kept = [0]
    here = 0
    while here < len(cells) - 1:
        best = here + 1
        along = _line_cost(cost, cells[here], cells[here + 1])
        for ahead in range(here + 2, len(cells)):
            along += _line_cost(cost, cells[ahead - 1], cells[ahead])
            if _line_cost(cost, cells[here], cells[ahead]) <= along * (1.0 + 1e-6):
                best = ahead
        kept.append(best)
        here = best
    return kept


@kernel
def _line_cost(cost: NDArray[np.float32], start: NDArray[np.int64], end: NDArray[np.int64]) -> float:
    """What the straight line between two cells' middles costs, in cells; sampled twice a cell."""
    rows, columns = end[0] - start[0], end[1] - start[1]
    length = math.hypot(rows, columns)
    samples = max(int(2.0 * length), 1)
    total = 0.0
    for sample in range(samples + 1):
        share = sample / samples
        row, column = math.floor(start[0] + 0.5 + share * rows), math.floor(start[1] + 0.5 + share * columns)
        weight = 0.5 if sample in (0, samples) else 1.0
        total += weight * cost[row, column]
    return total * length / samples
