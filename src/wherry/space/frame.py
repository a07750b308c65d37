"""Frames of cell grids on a map: conversion between cells and metres (paper, section 7)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.space.pose import Floats, Pose

COARSE_STEP = math.radians(0.5)  # rad, step of the first search for the grid's angle
FINE_STEP = math.radians(0.02)  # rad, step of the search around the best coarse angle


@dataclass(frozen=True, slots=True)
class CellFrame:
    """A grid of square cells in the map frame.

    Attributes:
        origin: Pose of the outer corner of cell (0, 0) in the map frame; its x axis points to the grid's east.
        cell_size: Side of a cell, m.
    """

    origin: Pose
    cell_size: float

    def centre(self, x: int, y: int) -> Floats:
        """Centre of a cell in the map frame, [2] m."""
        point: Floats = self.centres(np.array([[x, y]]))[0]
        return point

    def centres(self, cells: NDArray[np.int64]) -> Floats:
        """Centres of cells.

        Args:
            cells: x and y of cells, [N, 2].

        Returns:
            Points in the map frame, [N, 2] m.
        """
        return self.origin.transform((cells + 0.5) * self.cell_size)

    def cells_at(self, points: Floats) -> NDArray[np.int64]:
        """The cells that contain points.

        Args:
            points: Points in the map frame, [N, 2] m.

        Returns:
            x and y of the cells, [N, 2].
        """
        return np.floor(self.origin.inverse.transform(points) / self.cell_size).astype(np.int64)

    def cell_at(self, x: float, y: float) -> tuple[int, int]:
        """The cell that contains a point of the map frame (m)."""
        column, row = self.cells_at(np.array([[x, y]]))[0]
        return int(column), int(row)

    def heading(self, dx: int, dy: int) -> float:
        """Direction from a cell to the one ``dx`` columns east and ``dy`` rows north, in the map frame, rad."""
        return math.remainder(self.origin.theta + math.atan2(dy, dx), math.tau)


def fit_cell_frame(walls: Floats, cell_size: float) -> CellFrame:
    """Fit a grid of cells to a map so that the walls are on the cells' edges.

    One coordinate of each wall point is a multiple of the cell size, so modulo the cell size these coordinates have the
    same phase. The grid's angle maximizes the resultant of all phases, whose direction gives the grid's offset
    (circular mean, Mardia & Jupp 2000, section 2.2).

    Args:
        walls: Points on walls in the map frame, [N, 2] m, N ≥ 1.
        cell_size: Side of a cell, m.

    Returns:
        A frame rotated by at most 45.5° from the map frame, in which all wall points are in cells with x and y ≥ 0.
    """
    # Rotating around the middle of all points makes the search equally sensitive in both directions.
    middle = (walls.min(axis=0) + walls.max(axis=0)) / 2
    centred = walls - middle
    coarse = np.arange(-math.pi / 4, math.pi / 4, COARSE_STEP)
    best = coarse[np.argmax([abs(_mean_phase(centred, angle, cell_size)).sum() for angle in coarse])]
    fine = best + np.arange(-COARSE_STEP, COARSE_STEP + FINE_STEP / 2, FINE_STEP)
    theta = float(fine[np.argmax([abs(_mean_phase(centred, angle, cell_size)).sum() for angle in fine])])

    offset = np.angle(_mean_phase(centred, theta, cell_size)) / math.tau * cell_size
    turned = Pose(theta=-theta).transform(centred)
    # Noise may move a point of the outermost edge into the cell beyond it, so one more row of cells is added.
    lowest = (np.floor((turned.min(axis=0) - offset) / cell_size) - 1) * cell_size + offset
    corner = Pose(theta=theta).transform(lowest[None, :])[0] + middle
    return CellFrame(Pose(float(corner[0]), float(corner[1]), theta), cell_size)


def _mean_phase(points: Floats, angle: float, cell_size: float) -> NDArray[np.complex128]:
    """Mean of exp(2πi u / cell) over the points' coordinates u along both axes of a grid at an angle, rad, [2]."""
    turned = Pose(theta=-angle).transform(points)
    phases: NDArray[np.complex128] = np.exp(1j * math.tau / cell_size * turned).mean(axis=0)
    return phases
