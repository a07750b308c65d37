"""Occupancy grids: what is known to be free, occupied, or not known (paper, section 5)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.space.grid_cells import cell_centres, cells_at
from wherry.space.pose import IDENTITY, Floats, Pose

FREE_BELOW = 0.196  # map_server's free_thresh
OCCUPIED_ABOVE = 0.65  # map_server's occupied_thresh
UNKNOWN = 0.5


@dataclass(frozen=True)
class OccupancyGrid:
    """A map as probabilities.

    Attributes:
        probability: [H, W] float32, P(occupied); row 0 is the smallest y, column 0 the smallest x; 0.5 is unknown.
        resolution: m, a grid cell's side.
        origin: The outer corner of grid cell [0, 0] in the map frame.
    """

    probability: NDArray[np.float32]
    resolution: float
    origin: Pose = IDENTITY

    @property
    def occupied(self) -> NDArray[np.bool_]:
        """[H, W] where something stands."""
        return self.probability > OCCUPIED_ABOVE

    @property
    def free(self) -> NDArray[np.bool_]:
        """[H, W] where nothing stands."""
        return self.probability < FREE_BELOW

    @property
    def unknown(self) -> NDArray[np.bool_]:
        """[H, W] where neither is known."""
        return ~(self.occupied | self.free)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns, [H, W]."""
        height, width = self.probability.shape
        return height, width

    def cells_at(self, points: Floats) -> NDArray[np.int64]:
        """The grid cells that contain points; they may lie outside the grid.

        Args:
            points: [N, 2] m, map frame.

        Returns:
            [N, 2] row and column.
        """
        return cells_at(points, self.origin, self.resolution)

    def contains(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Which cells lie on the grid.

        Args:
            cells: [N, 2] row and column.

        Returns:
            [N].
        """
        rows, columns = cells.T
        height, width = self.shape
        inside: NDArray[np.bool_] = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
        return inside

    def centres(self, cells: NDArray[np.int64]) -> Floats:
        """The middles of grid cells.

        Args:
            cells: [N, 2] row and column, as from `cells_at` or ``np.argwhere(grid.occupied)``.

        Returns:
            [N, 2] m, map frame.
        """
        return cell_centres(cells, self.origin, self.resolution)

    def distances_to(self, point: Floats, window: tuple[slice, slice] = (slice(None), slice(None))) -> Floats:
        """Distances of the grid cells' centres from a point.

        Args:
            point: [2] m, map frame.
            window: Rows and columns, those outside the grid left out; by default the whole grid.

        Returns:
            [H, W] distances in the window, m.
        """
        column, row = self.origin.inverse.transform(point[None, :])[0] / self.resolution
        height, width = self.shape
        rows, columns = np.arange(height)[window[0], None] + 0.5, np.arange(width)[None, window[1]] + 0.5
        distances: Floats = np.hypot(rows - row, columns - column) * self.resolution
        return distances

    def occupied_points(self) -> Floats:
        """[N, 2] m, map frame: the middles of the occupied cells, row by row."""
        return self.centres(np.argwhere(self.occupied))


def probability_of(log_odds: NDArray[np.float32]) -> NDArray[np.float32]:
    """P(occupied) of log-odds l = log(p / (1 − p))."""
    probability: NDArray[np.float32] = np.float32(1.0) / (np.float32(1.0) + np.exp(-log_odds))
    return probability


def log_odds_of(probability: float) -> float:
    """Log-odds l = log(p / (1 − p))."""
    return math.log(probability / (1.0 - probability))
