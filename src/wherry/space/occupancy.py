"""Occupancy grids: probabilities of cells, which are free, occupied or unknown (paper, section 5)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.space.grid_cells import cell_centres, cells_at
from wherry.space.pose import IDENTITY, Floats, Pose

FREE_THRESHOLD = 0.196  # probability below which a cell is free, as in map_server
OCCUPIED_THRESHOLD = 0.65  # probability above which a cell is occupied, as in map_server
UNKNOWN = 0.5  # probability of an unknown cell
NO_DISCS = np.zeros((0, 3))  # an empty array of discs: x, y, radius, m, map frame


@dataclass(frozen=True)
class OccupancyGrid:
    """A map of square cells.

    Attributes:
        probability: Probability that each cell is occupied, [H, W] float32; row 0 has the smallest y, column 0 the
            smallest x; 0.5 is unknown.
        resolution: Side of a cell, m.
        origin: Pose of the outer corner of cell [0, 0] in the map frame.
    """

    probability: NDArray[np.float32]
    resolution: float
    origin: Pose = IDENTITY

    @property
    def occupied(self) -> NDArray[np.bool_]:
        """Which cells are occupied, [H, W]."""
        return self.probability > OCCUPIED_THRESHOLD

    @property
    def free(self) -> NDArray[np.bool_]:
        """Which cells are free, [H, W]."""
        return self.probability < FREE_THRESHOLD

    @property
    def unknown(self) -> NDArray[np.bool_]:
        """Which cells are neither occupied nor free, [H, W]."""
        return ~(self.occupied | self.free)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and of columns, (H, W)."""
        height, width = self.probability.shape
        return height, width

    def cells_at(self, points: Floats) -> NDArray[np.int64]:
        """The cells that contain points, which may be outside of the grid.

        Args:
            points: Points in the map frame, [N, 2] m.

        Returns:
            Rows and columns, [N, 2].
        """
        return cells_at(points, self.origin, self.resolution)

    def contains(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Which cells are on the grid.

        Args:
            cells: Rows and columns, [N, 2].

        Returns:
            Whether each cell is on the grid, [N].
        """
        rows, columns = cells.T
        height, width = self.shape
        inside: NDArray[np.bool_] = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
        return inside

    def centres(self, cells: NDArray[np.int64]) -> Floats:
        """The centres of cells.

        Args:
            cells: Rows and columns, [N, 2], as from `cells_at` or ``np.argwhere(grid.occupied)``.

        Returns:
            Points in the map frame, [N, 2] m.
        """
        return cell_centres(cells, self.origin, self.resolution)

    def distances_to(self, point: Floats, window: tuple[slice, slice] = (slice(None), slice(None))) -> Floats:
        """Distances of the cells' centres from a point.

        Args:
            point: Point in the map frame, [2] m.
            window: Rows and columns to compute, clipped to the grid; by default the whole grid.

        Returns:
            Distances in the window, [rows, columns] m.
        """
        column, row = self.origin.inverse.transform(point[None, :])[0] / self.resolution
        height, width = self.shape
        rows, columns = np.arange(height)[window[0], None] + 0.5, np.arange(width)[None, window[1]] + 0.5
        distances: Floats = np.hypot(rows - row, columns - column) * self.resolution
        return distances

    def occupied_points(self) -> Floats:
        """Centres of the occupied cells in the map frame, row by row, [N, 2] m."""
        return self.centres(np.argwhere(self.occupied))


def probability_of(log_odds: NDArray[np.float32]) -> NDArray[np.float32]:
    """Probabilities p of log odds log(p / (1 − p)), elementwise."""
    probability: NDArray[np.float32] = np.float32(1.0) / (np.float32(1.0) + np.exp(-log_odds))
    return probability


def log_odds_of(probability: float) -> float:
    """Log odds log(p / (1 − p)) of a probability p."""
    return math.log(probability / (1.0 - probability))
