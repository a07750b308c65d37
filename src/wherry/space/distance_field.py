"""Distance fields: the distance from every cell to the nearest obstacle (Felzenszwalb & Huttenlocher 2012)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from wherry.kernels import kernel
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose


@dataclass(frozen=True)
class DistanceField:
    """Distances from the centres of a grid's cells to the centre of the nearest occupied cell.

    Attributes:
        distance: Distance of each cell, at most ``limit``, [H, W] float32 m; row 0 has the smallest y.
        resolution: Side of a cell, m.
        origin: Pose of the outer corner of cell [0, 0] in the map frame.
        limit: Upper bound of the distances, and the distance of every point outside of the grid, m.
    """

    distance: NDArray[np.float32]
    resolution: float
    origin: Pose
    limit: float

    @classmethod
    def of(cls, grid: OccupancyGrid, limit: float) -> DistanceField:
        """The exact Euclidean distance transform of a grid's occupied cells.

        The upper bound makes it faster than `obstacle_distances` on large maps.

        Args:
            grid: The map; unknown cells count as free.
            limit: Upper bound of the distances, m.
        """
        cells = _squared_distances(grid.occupied, math.ceil(limit / grid.resolution) + 1)
        distance = np.minimum(np.sqrt(cells) * np.float32(grid.resolution), np.float32(limit))
        return cls(distance.astype(np.float32, copy=False), grid.resolution, grid.origin, limit)

    def at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Look up distances without interpolation.

        Args:
            points: Points in the map frame, [N, 2] m.

        Returns:
            Distances, [N] m.
        """
        cells = self.origin.inverse.transform(points) / self.resolution
        height, width = self.distance.shape
        inside = (cells >= 0).all(axis=1) & (cells[:, 0] < width) & (cells[:, 1] < height)
        found = np.full(len(points), self.limit)
        column, row = cells[inside].astype(np.int64).T
        found[inside] = self.distance[row, column]
        return found


def obstacle_distances(occupied: NDArray[np.bool_], spacing: float = 1.0) -> NDArray[np.float64]:
    """Euclidean distances to the nearest occupied cell, without an upper bound.

    Args:
        occupied: Occupied cells, [H, W].
        spacing: Distance between the centres of adjacent cells, in the unit of the result.

    Returns:
        Distances, [H, W]; infinite without any occupied cell.
    """
    if not occupied.any():
        return np.full(occupied.shape, np.inf)
    distances: NDArray[np.float64] = ndimage.distance_transform_edt(~occupied, sampling=spacing)
    return distances


def nearest_cells(target: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The nearest target cell of each cell.

    Args:
        target: Target cells, [H, W], at least one.

    Returns:
        Rows and columns of the nearest target cells, [2, H, W].

    Raises:
        ValueError: There is no target cell.
    """
    if not target.any():
        raise ValueError("there is no target cell")
    indices = ndimage.distance_transform_edt(~target, return_distances=False, return_indices=True)
    return np.asarray(indices, np.int64)


def _squared_distances(occupied: NDArray[np.bool_], limit: int) -> NDArray[np.float32]:
    """Squared distances to the nearest occupied cell: first along the columns, then along the rows.

    Args:
        occupied: Occupied cells, [H, W].
        limit: Upper bound of the distances, cells.

    Returns:
        Squared distances, [H, W] cells².
    """
    column = _column_distances(occupied, limit)
    squared = np.empty_like(column)
    for y in range(len(column)):
        _row_envelope(column[y], float(limit), squared[y])
    return squared


@kernel
def _column_distances(occupied: NDArray[np.bool_], limit: int) -> NDArray[np.float32]:
    """Distances to the nearest occupied cell of the same column, [H, W] cells."""
    height, width = occupied.shape
    far = np.float32(limit)
    column = np.empty((height, width), np.float32)
    for x in range(width):
        column[0, x] = 0.0 if occupied[0, x] else far
    for y in range(1, height):
        for x in range(width):
            column[y, x] = 0.0 if occupied[y, x] else min(column[y - 1, x] + 1.0, far)
    for y in range(height - 2, -1, -1):
        for x in range(width):
            column[y, x] = min(column[y, x], column[y + 1, x] + 1.0)
    return column


@kernel
def _row_envelope(column: NDArray[np.float32], limit: float, squared: NDArray[np.float32]) -> None:
    """Write the lower envelope of the parabolas (x − v)² + column[v]² of one row, at most limit², [W]."""
    width = len(column)
    vertex = np.empty(width, np.int64)
    boundary = np.empty(width, np.float64)
    count = 0
    for x in range(width):
        if column[x] >= limit:  # a parabola with its vertex at the limit is nowhere below it
            continue
        height = column[x] * column[x] + x * x
        start = -np.inf
        while count > 0:
            v = vertex[count - 1]
            start = (height - (column[v] * column[v] + v * v)) / (2.0 * (x - v))
            if start > boundary[count - 1]:
                break
            count -= 1
            start = -np.inf
        vertex[count] = x
        boundary[count] = start
        count += 1
    squared[:] = limit * limit
    current = 0
    for x in range(width if count > 0 else 0):
        while current + 1 < count and boundary[current + 1] < x:
            current += 1
        v = vertex[current]
        squared[x] = min(limit * limit, (x - v) * (x - v) + column[v] * column[v])
