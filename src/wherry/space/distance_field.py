"""Distance fields: how far every place of a map is from the nearest obstacle (Felzenszwalb and Huttenlocher, 2012)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import kernel
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose


@dataclass(frozen=True)
class DistanceField:
    """Distances from the centres of a grid's cells to the centre of the nearest occupied cell.

    Attributes:
        distance: [H, W] float32 m, at most ``limit``; row 0 is the smallest y.
        resolution: m, a grid cell's side.
        origin: The outer corner of grid cell [0, 0] in the map frame.
        limit: m, the distance that stands for everything farther, and for everything outside the grid.
    """

    distance: NDArray[np.float32]
    resolution: float
    origin: Pose
    limit: float

    @classmethod
    def of(cls, grid: OccupancyGrid, limit: float) -> DistanceField:
        """The exact Euclidean distance transform of a grid's occupied cells.

        Args:
            grid: The map; unknown cells count as empty.
            limit: m, distances are cut off here.
        """
        cells = _squared_distances(grid.occupied, math.ceil(limit / grid.resolution) + 1)
        distance = np.minimum(np.sqrt(cells) * np.float32(grid.resolution), np.float32(limit))
        return cls(distance.astype(np.float32, copy=False), grid.resolution, grid.origin, limit)

    def at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Look distances up, without interpolation.

        Args:
            points: [N, 2] m, map frame.

        Returns:
            [N] m.
        """
        cells = self.origin.inverse.transform(points) / self.resolution
        height, width = self.distance.shape
        inside = (cells >= 0).all(axis=1) & (cells[:, 0] < width) & (cells[:, 1] < height)
        found = np.full(len(points), self.limit)
        column, row = cells[inside].astype(np.int64).T
        found[inside] = self.distance[row, column]
        return found


def _squared_distances(occupied: NDArray[np.bool_], reach: int) -> NDArray[np.float32]:
    """Squared distances to the nearest occupied cell: along the columns first, then along each row.

    Args:
        occupied: [H, W].
        reach: Cells; larger distances are not told apart.

    Returns:
        [H, W] cells², at most ``reach``².
    """
    column = _column_distances(occupied, reach)
    squared = np.empty_like(column)
    for y in range(len(column)):
        _row_envelope(column[y], float(reach), squared[y])
    return squared


@kernel
def _column_distances(occupied: NDArray[np.bool_], reach: int) -> NDArray[np.float32]:
    """[H, W] cells to the nearest occupied cell above or below."""
    height, width = occupied.shape
    far = np.float32(reach)
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
def _row_envelope(column: NDArray[np.float32], far: float, squared: NDArray[np.float32]) -> None:
    """Write [W] the lower envelope of the parabolas (x − v)² + column[v]² of one row, at most far²."""
    width = len(column)
    vertex = np.empty(width, np.int64)
    boundary = np.empty(width, np.float64)
    count = 0
    for x in range(width):
        if column[x] >= far:  # a parabola that starts at the limit never shows below it
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
    squared[:] = far * far
    current = 0
    for x in range(width if count > 0 else 0):
        while current + 1 < count and boundary[current + 1] < x:
            current += 1
        v = vertex[current]
        squared[x] = min(far * far, (x - v) * (x - v) + column[v] * column[v])
