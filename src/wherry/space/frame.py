"""The grid of cells that is laid on a map: cells to metres and back (paper, section 7)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.space.pose import Floats, Pose

COARSE_STEP = math.radians(0.5)
FINE_STEP = math.radians(0.02)


@dataclass(frozen=True, slots=True)
class CellFrame:
    """Where a grid of square cells lies in the map.

    Attributes:
        origin: The outer corner of cell (0, 0) in the map frame; its x axis is the grid's east.
        cell_size: m, a cell's side.
    """

    origin: Pose
    cell_size: float

    def centre(self, x: int, y: int) -> Floats:
        """[2] m, map frame: the middle of a cell."""
        point: Floats = self.centres(np.array([[x, y]]))[0]
        return point

    def centres(self, cells: NDArray[np.int64]) -> Floats:
        """[N, 2] m, map frame: the centres of cells [N, 2] (x, y)."""
        return self.origin.transform((cells + 0.5) * self.cell_size)

    def cells_at(self, points: Floats) -> NDArray[np.int64]:
        """The cells that contain points.

        Args:
            points: [N, 2] m, map frame.

        Returns:
            [N, 2] x and y of each point's cell.
        """
        return np.floor(self.origin.inverse.transform(points) / self.cell_size).astype(np.int64)

    def cell_at(self, x: float, y: float) -> tuple[int, int]:
        """The cell that contains a point of the map frame, m."""
        column, row = self.cells_at(np.array([[x, y]]))[0]
        return int(column), int(row)

    def heading(self, dx: int, dy: int) -> float:
        """θ, rad, map frame: the direction from a cell towards the one ``dx`` columns east and ``dy`` rows north."""
        return math.remainder(self.origin.theta + math.atan2(dy, dx), math.tau)


def lay_cells(walls: Floats, cell_size: float) -> CellFrame:
    """Lay a grid of cells on a map so that the walls fall on the cells' edges.

    A wall that stands on an edge has one coordinate that is a multiple of the cell size. As phases of a circle of one
    cell, such coordinates point the same way; the grid's angle is the one at which they agree best, and the angle of
    their mean is its offset (a circular mean, Mardia & Jupp 2000, section 2.2).

    Args:
        walls: [N, 2] m, map frame: points on walls, N ≥ 1.
        cell_size: m.

    Returns:
        A frame turned by no more than 45.5° against the map, in which every wall point has non-negative cells.
    """
    # The points that go furthest decide how finely angles can be told apart; the middle makes the search symmetric.
    middle = (walls.min(axis=0) + walls.max(axis=0)) / 2
    centred = walls - middle
    coarse = np.arange(-math.pi / 4, math.pi / 4, COARSE_STEP)
    best = coarse[np.argmax([abs(_mean_phase(centred, angle, cell_size)).sum() for angle in coarse])]
    fine = best + np.arange(-COARSE_STEP, COARSE_STEP + FINE_STEP / 2, FINE_STEP)
    theta = float(fine[np.argmax([abs(_mean_phase(centred, angle, cell_size)).sum() for angle in fine])])

    offset = np.angle(_mean_phase(centred, theta, cell_size)) / math.tau * cell_size
    turned = Pose(theta=-theta).transform(centred)
    # A point in front of an edge by less than half a cell may still belong to it: one row of cells to spare.
    lowest = (np.floor((turned.min(axis=0) - offset) / cell_size) - 1) * cell_size + offset
    corner = Pose(theta=theta).transform(lowest[None, :])[0] + middle
    return CellFrame(Pose(float(corner[0]), float(corner[1]), theta), cell_size)


def _mean_phase(points: Floats, angle: float, cell_size: float) -> NDArray[np.complex128]:
    """[2] mean of exp(2πi u / cell) of the points' coordinates u along the two axes of a grid turned by ``angle``."""
    turned = Pose(theta=-angle).transform(points)
    phases: NDArray[np.complex128] = np.exp(1j * math.tau / cell_size * turned).mean(axis=0)
    return phases
