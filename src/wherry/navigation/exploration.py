"""Where to look next while a map is being made: frontiers, weighed by what would be seen (Yamauchi 1997).

A frontier is where free space that is known meets what is not. From places near each frontier, rays are cast to count
how much of the unknown a lidar there would see; the best place sees much for a short way (González-Baños & Latombe
2002).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from wherry.kernels import kernel
from wherry.navigation.path import Costmap, travel_costs
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose
from wherry.space.raycast import traverse

SIGHT = 6.0  # m that a lidar is trusted to see
RAYS = 360
PLACES = 48  # at most so many places are weighed
LEAST_GAIN = 0.05  # m² of the unknown that are worth going for
LEAST_FRONTIER = 0.15  # m, frontiers shorter than this are gaps between beams
CLOSE_BY = 0.35  # m; a place that near to where the robot has looked already shows nothing new
WAY_SCALE = 4.0  # m of way that halve what a gain is worth, and a little more


@dataclass(frozen=True, slots=True)
class Viewpoint:
    """A place worth going to.

    Attributes:
        position: [2] m, map frame.
        gain: m² of the unknown that a lidar would see there.
        way: m, what it costs to get there (`travel_costs`).
    """

    position: Floats
    gain: float
    way: float

    @property
    def worth(self) -> float:
        """Gain, discounted by the way."""
        return self.gain * math.exp(-self.way / WAY_SCALE)


def frontier_cells(grid: OccupancyGrid) -> NDArray[np.bool_]:
    """[H, W] free cells beside unknown ones, in groups long enough not to be gaps between beams."""
    beside = ndimage.binary_dilation(grid.unknown) & grid.free
    labels, count = ndimage.label(beside, structure=np.ones((3, 3)))
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    sizes[0] = 0
    long_enough: NDArray[np.bool_] = sizes[labels] * grid.resolution >= LEAST_FRONTIER
    return long_enough


def next_viewpoint(
    grid: OccupancyGrid, costmap: Costmap, pose: Pose, looked: Floats, *, least_gain: float = LEAST_GAIN
) -> Viewpoint | None:
    """Choose where to look next.

    Args:
        grid: The map so far.
        costmap: Where the robot may be on it.
        pose: base_link in the map frame.
        looked: [K, 2] m, map frame: where it was sent before; not sent there again.
        least_gain: m² of the unknown that are worth going for.

    Returns:
        The best viewpoint; None if nothing that can be reached shows anything unknown: the map is finished.
    """
    ways = travel_costs(costmap, np.array([pose.x, pose.y]))
    places = _places(grid, costmap, ways)
    if len(looked):
        nearest = np.hypot(*(places[:, None, :] - looked[None, :, :]).transpose(2, 0, 1)).min(axis=1)
        places = places[nearest > CLOSE_BY]
    viewpoints = [
        Viewpoint(place, visible_unknown(grid, place), float(ways[costmap.cell_at(place)])) for place in places
    ]
    worthwhile = [viewpoint for viewpoint in viewpoints if viewpoint.gain >= least_gain]
    return max(worthwhile, key=lambda viewpoint: viewpoint.worth, default=None)


def visible_unknown(grid: OccupancyGrid, place: Floats) -> float:
    """The area, m², of unknown cells that a lidar at a place, [2] m, map frame, would see through or end in.

    What is unknown is taken for transparent, so this is an upper bound; each cell counts once.
    """
    start = grid.origin.inverse.transform(place[None, :])[0] / grid.resolution
    angles = np.linspace(0.0, math.tau, RAYS, endpoint=False)
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    cells = _count_unknown(grid.occupied, grid.unknown, start, directions, SIGHT / grid.resolution)
    return cells * grid.resolution**2


def _places(grid: OccupancyGrid, costmap: Costmap, ways: Floats) -> Floats:
    """[N, 2] m: reachable places as near as can be to the frontiers, at most `PLACES`, spread evenly over them."""
    frontier = frontier_cells(grid)
    reachable = np.isfinite(ways)
    if not frontier.any() or not reachable.any():
        return np.zeros((0, 2))
    _, nearest = ndimage.distance_transform_edt(~reachable, return_indices=True)
    cells = np.unique(nearest[:, frontier].T, axis=0).astype(np.int64)
    # One place a block of half a metre is enough, the cheapest to get to.
    block = max(round(0.5 / grid.resolution), 1)
    order = np.lexsort((cells[:, 1], cells[:, 0], ways[cells[:, 0], cells[:, 1]]))
    _, first = np.unique(cells[order] // block, axis=0, return_index=True)
    chosen = cells[order][np.sort(first)]
    if len(chosen) > PLACES:
        chosen = chosen[np.linspace(0, len(chosen) - 1, PLACES).round().astype(np.int64)]
    return costmap.centres(chosen)


@kernel
def _count_unknown(
    occupied: NDArray[np.bool_], unknown: NDArray[np.bool_], start: Floats, directions: Floats, limit: float
) -> int:
    """How many unknown cells rays cross before they meet an occupied one; cells, each counted once."""
    height, width = occupied.shape
    seen = np.zeros((height, width), np.bool_)
    count = 0
    for n in range(len(directions)):
        for column, row, _ in traverse(start[0], start[1], directions[n, 0], directions[n, 1], limit):
            if not (0 <= row < height and 0 <= column < width) or occupied[row, column]:
                break
            if unknown[row, column] and not seen[row, column]:
                seen[row, column] = True
                count += 1
    return count
