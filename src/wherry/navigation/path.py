"""Shortest paths on a costmap that penalizes low clearance (A*, Hart et al. 1968; Dijkstra 1959)."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import kernel
from wherry.space.distance_field import obstacle_distances
from wherry.space.grid_cells import cell_centres, cells_at
from wherry.space.occupancy import NO_DISCS, OccupancyGrid
from wherry.space.pose import Floats, Pose

INFLATION_DISTANCE = 0.15  # m beyond the robot's radius within which low clearance raises the cost
WALL_COST = 8.0  # additional cost, m, of each metre driven in contact with a wall
SNAP_DISTANCE = 0.3  # m by which a start or goal in collision may be moved to the nearest passable cell
SHORTCUT_TOLERANCE = 1e-6  # relative rounding error allowed when a line's cost is compared with that of the path
STEPS = ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1))  # row, column offsets of neighbours


@dataclass(frozen=True)
class Costmap:
    """Clearance, passability and cost of each grid cell for the centre of a round robot.

    Attributes:
        clearance: [H, W] float32, distance from a grid cell's centre to the nearest obstacle's edge, m.
        passable: [H, W] True where the clearance is at least the robot's radius.
        cost: [H, W] float32, cost of driving one metre, m: 1 in open space, more near obstacles, ``inf`` where not
            passable.
        resolution: Side of a grid cell, m.
        origin: Outer corner of grid cell [0, 0] in the map frame.
    """

    clearance: NDArray[np.float32]
    passable: NDArray[np.bool_]
    cost: NDArray[np.float32]
    resolution: float
    origin: Pose

    @classmethod
    def from_grid(
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
            radius: Radius of the robot's footprint, m.
            obstacles: [K, 3] x, y, radius, m, map frame, of discs that are further obstacles, such as boxes.
            known_free: [K, 3] x, y, radius, m, map frame, of discs in which unknown cells count as free, such as the
                robot's own footprint, which its lidar cannot see.
            unknown_passable: Whether unknown cells count as free.
        """
        blocked = grid.occupied if unknown_passable else ~grid.free
        blocked &= ~_in_discs(grid, known_free) | grid.occupied
        # A border of one cell represents the unknown space outside the map.
        padded = np.pad(blocked, 1, constant_values=not unknown_passable)
        distance = obstacle_distances(padded)
        # The distance transform measures to the centre of an obstacle's cell, half a cell beyond the obstacle's edge.
        clearance = np.maximum(distance[1:-1, 1:-1] - 0.5, 0.0) * grid.resolution
        for x, y, obstacle_radius in obstacles:
            clearance = np.minimum(clearance, np.maximum(grid.distances_to(np.array([x, y])) - obstacle_radius, 0.0))
        passable = clearance >= radius
        proximity = np.clip(1.0 - (clearance - radius) / INFLATION_DISTANCE, 0.0, 1.0)
        cost = np.where(passable, 1.0 + WALL_COST * proximity**2, math.inf)
        return cls(clearance.astype(np.float32), passable, cost.astype(np.float32), grid.resolution, grid.origin)

    def cell_at(self, point: Floats) -> tuple[int, int]:
        """Row and column of the grid cell that contains a point, [2] m, map frame; it may lie outside the map."""
        row, column = cells_at(point[None, :2], self.origin, self.resolution)[0]
        return int(row), int(column)

    def centres(self, cells: NDArray[np.int64]) -> Floats:
        """[N, 2] centres of grid cells [N, 2] (row, column), m, map frame."""
        return cell_centres(cells, self.origin, self.resolution)

    def is_passable(self, point: Floats) -> bool:
        """Whether the robot fits at a point, [2] m, map frame."""
        row, column = self.cell_at(point)
        height, width = self.passable.shape
        return 0 <= row < height and 0 <= column < width and bool(self.passable[row, column])

    def nearest_passable(self, point: Floats, max_distance: float = math.inf) -> tuple[int, int] | None:
        """Row and column of the passable cell nearest to a point.

        Args:
            point: [2] m, map frame.
            max_distance: Largest distance of the cell's centre from the point, m.

        Returns:
            The row and column; None if there is no such cell.
        """
        if self.is_passable(point):
            return self.cell_at(point)
        cells = np.argwhere(self.passable)
        if len(cells) == 0:
            return None
        distances = np.hypot(*(self.centres(cells) - point[:2]).T)
        nearest = int(np.argmin(distances))
        if distances[nearest] > max_distance:
            return None
        return int(cells[nearest, 0]), int(cells[nearest, 1])

    def max_clearance_cell(self, point: Floats, reach: float) -> tuple[int, int]:
        """Row and column of the cell with the largest clearance in the square around a point.

        Args:
            point: [2] m, map frame, on the map.
            reach: Half the square's side, m.
        """
        row, column = self.cell_at(point)
        half = round(reach / self.resolution)
        top, left = max(row - half, 0), max(column - half, 0)
        window = self.clearance[top : row + half + 1, left : column + half + 1]
        best = np.unravel_index(int(np.argmax(window)), window.shape)
        return top + int(best[0]), left + int(best[1])


def shortest_path(
    costmap: Costmap, start: Floats, goal: Floats, *, snap_distance: float = SNAP_DISTANCE
) -> Floats | None:
    """The path of lowest cost, with straight lines wherever they cost no more than the grid path.

    Args:
        costmap: The costmap.
        start: [2] start, m, map frame.
        goal: [2] goal, m, map frame.
        snap_distance: Largest distance of the nearest passable cells from start and goal, m.

    Returns:
        [N, 2] waypoints of the robot's centre, m, map frame, from the start to the goal or, if that is in collision, to
        the nearest passable cell; None if there is no path.
    """
    first, last = costmap.nearest_passable(start, snap_distance), costmap.nearest_passable(goal, snap_distance)
    if first is None or last is None:
        return None
    costs, parents = _search(costmap.cost, *first, *last)
    if not math.isfinite(costs[last]):
        return None
    cells = _trace_back(parents, *last)
    points = costmap.centres(cells[_waypoints(costmap.cost, cells)])
    if costmap.is_passable(goal):
        points[-1] = goal[:2]
    if len(points) == 1 or not costmap.is_passable(start):
        return np.vstack([start[:2], points])  # leave a start in collision by the shortest way
    points[0] = start[:2]
    return points


def travel_costs(costmap: Costmap, start: Floats, *, snap_distance: float = SNAP_DISTANCE) -> NDArray[np.float64]:
    """The cost of the cheapest path to every grid cell (Dijkstra 1959).

    Args:
        costmap: The costmap.
        start: [2] start, m, map frame.
        snap_distance: Largest distance of the nearest passable cell from the start, m.

    Returns:
        [H, W] costs, m, each metre weighted by `Costmap.cost`; ``inf`` where there is no path.
    """
    first = costmap.nearest_passable(start, snap_distance)
    if first is None:
        return np.full(costmap.passable.shape, math.inf)
    costs, _ = _search(costmap.cost, *first, -1, -1)
    return costs * costmap.resolution


def _in_discs(grid: OccupancyGrid, discs: Floats) -> NDArray[np.bool_]:
    """[H, W] True where a grid cell's centre lies in one of the discs, [K, 3] x, y, radius, m, map frame."""
    inside = np.zeros(grid.shape, np.bool_)
    for x, y, radius in discs:
        inside |= grid.distances_to(np.array([x, y])) <= radius
    return inside


@kernel
def _search(
    cost: NDArray[np.float32], row: int, column: int, goal_row: int, goal_column: int
) -> tuple[Floats, NDArray[np.int8]]:
    """A* on the 8-connected grid, or Dijkstra to all cells if the goal is negative.

    Returns:
        [H, W] cost so far (g), in cells, which is final for the goal and all expanded cells; and [H, W] index in
        `STEPS` of the step to each cell from its predecessor, −1 without one.
    """
    height, width = cost.shape
    cost_so_far = np.full((height, width), np.inf)
    parents = np.full((height, width), np.int8(-1))
    is_expanded = np.zeros((height, width), np.bool_)
    cost_so_far[row, column] = 0.0
    open_list = [(0.0, row, column)]
    while len(open_list) > 0:
        _, row, column = heapq.heappop(open_list)
        if is_expanded[row, column]:
            continue
        is_expanded[row, column] = True
        if row == goal_row and column == goal_column:
            break
        for step in range(8):
            down, right = STEPS[step]
            next_row, next_column = row + down, column + right
            if not (0 <= next_row < height and 0 <= next_column < width) or is_expanded[next_row, next_column]:
                continue
            length = math.sqrt(down * down + right * right)
            g = cost_so_far[row, column] + length * 0.5 * (cost[row, column] + cost[next_row, next_column])
            if g < cost_so_far[next_row, next_column]:
                cost_so_far[next_row, next_column] = g
                parents[next_row, next_column] = step
                h = 0.0  # the straight line is admissible, since the cost is at least 1
                if goal_row >= 0:
                    h = math.hypot(goal_row - next_row, goal_column - next_column)
                heapq.heappush(open_list, (g + h, next_row, next_column))
    return cost_so_far, parents


def _trace_back(parents: NDArray[np.int8], row: int, column: int) -> NDArray[np.int64]:
    """[N, 2] cells (row, column) of the path from the start to a cell."""
    cells = [(row, column)]
    while parents[row, column] >= 0:
        down, right = STEPS[parents[row, column]]
        row, column = row - down, column - right
        cells.append((row, column))
    return np.array(cells[::-1], dtype=np.int64)


def _waypoints(cost: NDArray[np.float32], cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """[M] indices of the path's cells that remain as waypoints after shortcutting."""
    return np.array(_shortcut(cost, cells), dtype=np.int64)


@kernel
def _shortcut(cost: NDArray[np.float32], cells: NDArray[np.int64]) -> list[int]:
    """As `_waypoints`: the next one is the last cell that a straight line reaches at no higher cost than the path."""
    kept = [0]
    here = 0
    while here < len(cells) - 1:
        farthest = here + 1
        path_cost = _line_cost(cost, cells[here], cells[here + 1])
        for ahead in range(here + 2, len(cells)):
            path_cost += _line_cost(cost, cells[ahead - 1], cells[ahead])
            if _line_cost(cost, cells[here], cells[ahead]) <= path_cost * (1.0 + SHORTCUT_TOLERANCE):
                farthest = ahead
        kept.append(farthest)
        here = farthest
    return kept


@kernel
def _line_cost(cost: NDArray[np.float32], start: NDArray[np.int64], end: NDArray[np.int64]) -> float:
    """Cost of the line between two cells' centres, in cells, by the trapezoidal rule with two samples per cell."""
    rows, columns = end[0] - start[0], end[1] - start[1]
    length = math.hypot(rows, columns)
    samples = max(int(2.0 * length), 1)
    total = 0.0
    for sample in range(samples + 1):
        fraction = sample / samples
        row, column = math.floor(start[0] + 0.5 + fraction * rows), math.floor(start[1] + 0.5 + fraction * columns)
        weight = 0.5 if sample in (0, samples) else 1.0
        total += weight * cost[row, column]
    return total * length / samples
