"""Frontier exploration: the next best viewpoint on a map that is being built (Yamauchi 1997).

A frontier is the border between known free space and unknown space. At candidate positions near the frontiers, ray
casting computes the unknown area that a lidar would see, the gain. The best viewpoint has the highest utility: gain
discounted by travel cost (González-Baños & Latombe 2002).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from wherry.kernels import kernel
from wherry.navigation.path import Costmap, travel_costs
from wherry.space.distance_field import nearest_cells
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose
from wherry.space.raycast import traverse

SENSOR_RANGE = 6.0  # m, assumed range of the lidar
RAYS = 360  # rays cast from each candidate
MAX_CANDIDATES = 48  # candidate positions that are evaluated
CANDIDATE_SPACING = 0.5  # m, side of the square blocks that each yield one candidate
MIN_GAIN = 0.05  # m² of visible unknown area that make a viewpoint worthwhile
MIN_FRONTIER_LENGTH = 0.15  # m; shorter ones are gaps between beams
VISITED_RADIUS = 0.35  # m around a visited viewpoint within which candidates are discarded
COST_SCALE = 4.0  # m of travel cost by which a viewpoint's utility falls by a factor e


@dataclass(frozen=True, slots=True)
class Viewpoint:
    """A position to explore from.

    Attributes:
        position: [2] m, map frame.
        gain: Unknown area that a lidar would see from the position, m².
        travel_cost: Cost of the path to the position, m, from `travel_costs`.
    """

    position: Floats
    gain: float
    travel_cost: float

    @property
    def utility(self) -> float:
        """The gain, discounted exponentially by the travel cost, m² (González-Baños & Latombe 2002, section 5)."""
        return self.gain * math.exp(-self.travel_cost / COST_SCALE)


def next_viewpoint(
    grid: OccupancyGrid, costmap: Costmap, pose: Pose, visited: Floats, *, min_gain: float = MIN_GAIN
) -> Viewpoint | None:
    """Choose the viewpoint with the highest utility.

    Args:
        grid: The map so far.
        costmap: The costmap of the map.
        pose: base_link in the map frame.
        visited: [K, 2] viewpoints that were tried before and are not chosen again, m, map frame.
        min_gain: Smallest gain that makes a viewpoint worthwhile, m².

    Returns:
        The best viewpoint; None if no reachable one is worthwhile, that is, the map is complete.
    """
    costs = travel_costs(costmap, np.array([pose.x, pose.y]))
    candidates = _unvisited(_candidates(grid, costmap, costs), visited)
    viewpoints = [
        Viewpoint(position, visible_unknown_area(grid, position), float(costs[costmap.cell_at(position)]))
        for position in candidates
    ]
    worthwhile = [viewpoint for viewpoint in viewpoints if viewpoint.gain >= min_gain]
    return max(worthwhile, key=lambda viewpoint: viewpoint.utility, default=None)


def frontier_cells(grid: OccupancyGrid) -> NDArray[np.bool_]:
    """[H, W] True for free cells that border on unknown ones, in components of at least `MIN_FRONTIER_LENGTH`."""
    is_frontier = ndimage.binary_dilation(grid.unknown) & grid.free
    labels, count = ndimage.label(is_frontier, structure=np.ones((3, 3)))
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    sizes[0] = 0
    is_long: NDArray[np.bool_] = sizes[labels] * grid.resolution >= MIN_FRONTIER_LENGTH
    return is_long


def visible_unknown_area(grid: OccupancyGrid, position: Floats) -> float:
    """Area, m², of the unknown cells that rays from a position, [2] m, map frame, cross before an occupied one.

    Unknown cells are assumed to be transparent, so this is an upper bound; each cell counts once.
    """
    start = grid.origin.inverse.transform(position[None, :])[0] / grid.resolution
    angles = np.linspace(0.0, math.tau, RAYS, endpoint=False)
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    cells = _count_unknown(grid.occupied, grid.unknown, start, directions, SENSOR_RANGE / grid.resolution)
    return cells * grid.resolution**2


def _candidates(grid: OccupancyGrid, costmap: Costmap, costs: Floats) -> Floats:
    """[N, 2] m, map frame: the reachable cells nearest to frontier cells, subsampled to `MAX_CANDIDATES`."""
    frontier = frontier_cells(grid)
    reachable = np.isfinite(costs)
    if not frontier.any() or not reachable.any():
        return np.zeros((0, 2))
    cells = np.unique(nearest_cells(reachable)[:, frontier].T, axis=0)
    cells = _cheapest_of_each_block(cells, costs, max(round(CANDIDATE_SPACING / grid.resolution), 1))
    if len(cells) > MAX_CANDIDATES:
        cells = cells[np.linspace(0, len(cells) - 1, MAX_CANDIDATES).round().astype(np.int64)]
    return costmap.centres(cells)


def _cheapest_of_each_block(cells: NDArray[np.int64], costs: Floats, block: int) -> NDArray[np.int64]:
    """[M, 2] the cell with the lowest travel cost in each block of block × block cells, sorted by cost."""
    order = np.lexsort((cells[:, 1], cells[:, 0], costs[cells[:, 0], cells[:, 1]]))
    _, first = np.unique(cells[order] // block, axis=0, return_index=True)
    return cells[order][np.sort(first)]


def _unvisited(candidates: Floats, visited: Floats) -> Floats:
    """[M, 2] m: the candidates [N, 2] outside `VISITED_RADIUS` of all visited viewpoints [K, 2]."""
    if not len(visited):
        return candidates
    nearest = np.hypot(*(candidates[:, None, :] - visited[None, :, :]).transpose(2, 0, 1)).min(axis=1)
    remaining: Floats = candidates[nearest > VISITED_RADIUS]
    return remaining


@kernel
def _count_unknown(
    occupied: NDArray[np.bool_], unknown: NDArray[np.bool_], start: Floats, directions: Floats, max_range: float
) -> int:
    """Number of distinct unknown cells that rays cross before an occupied one; start and max_range in cells."""
    height, width = occupied.shape
    counted = np.zeros((height, width), np.bool_)
    count = 0
    for n in range(len(directions)):
        for column, row, _ in traverse(start[0], start[1], directions[n, 0], directions[n, 1], max_range):
            if not (0 <= row < height and 0 <= column < width) or occupied[row, column]:
                break
            if unknown[row, column] and not counted[row, column]:
                counted[row, column] = True
                count += 1
    return count
