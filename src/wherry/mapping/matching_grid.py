"""Grids that scans are matched to; they grow scan by scan, and no cell is ever recomputed.

A grid holds the same points in two forms. Likelihoods, smeared over cells, serve the search for a pose: a cell of the
level with windows of k cells holds the greatest likelihood of the k × k cells that begin there, so that one lookup
bounds k × k poses (Olson 2009; Hess et al. 2016, section V-B). Surfels, one averaged point with a normal per cell,
serve the refinement of a pose.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import kernel
from wherry.mapping.point_cloud import PointCloud
from wherry.space.pose import Floats
from wherry.space.tiles import enlarge

RESOLUTION = 0.05  # m, side of a cell
WINDOW_SIZES = (1, 4, 8)  # cells along a window's side, on each likelihood level
SMEAR_SIGMA = 0.06  # m, standard deviation of the likelihood around a point
STAMP_RADIUS = 3  # cells to either side of a point whose likelihood it raises
MAX_LIKELIHOOD = 255  # value of a cell that contains a point
MIN_SPARE_CELLS = 64  # cells that the arrays grow by at least
MIN_NORMAL_COSINE = 0.7  # cosine of the angle between the normals of points on one surface


class MatchingGrid:
    """Likelihoods and surfels of scans in one frame.

    Attributes:
        corner: Column and row of the arrays' cell [0, 0], [2]; cell (c, r) begins at (c, r) · `RESOLUTION`.
        likelihood: Likelihoods 0 to 255, [L, H, W] uint8, one level for each of `WINDOW_SIZES`.
        surfel_at: Index of the surfel in each cell, or −1, [H, W] int32.
        surfels: Sums over the points of a cell, [S, 5]: x m, y m, normal x, normal y, and the number of points.
        surfel_count: Number of rows of ``surfels`` in use.
        scan_count: Number of scans added.
    """

    def __init__(self) -> None:
        self.corner = np.zeros(2, np.int64)
        self.likelihood = np.zeros((len(WINDOW_SIZES), 0, 0), np.uint8)
        self.surfel_at = np.zeros((0, 0), np.int32)
        self.surfels = np.zeros((0, 5))
        self.surfel_count = 0
        self.scan_count = 0

    def add(self, cloud: PointCloud) -> None:
        """Add the points of a scan, given in the grid's frame."""
        self.scan_count += 1
        if len(cloud.points) == 0:
            return
        self._reserve(cloud.points)
        needed = self.surfel_count + len(cloud.points)
        if needed > len(self.surfels):
            self.surfels = np.vstack([self.surfels, np.zeros((max(needed, 1024), 5))])
        _stamp(self.likelihood, self.corner, cloud.points, STAMPS)
        self.surfel_count = _add_surfels(
            self.surfel_at, self.surfels, self.surfel_count, self.corner, cloud.points, cloud.normals
        )

    @property
    def is_empty(self) -> bool:
        """Whether no scan that was added has points."""
        return self.surfel_at.size == 0

    @property
    def nbytes(self) -> int:
        """Memory that the arrays take, bytes."""
        return self.likelihood.nbytes + self.surfel_at.nbytes + self.surfels.nbytes

    def _reserve(self, points: Floats) -> None:
        """Enlarge the arrays to cover points [N, 2] m and the stamps around them."""
        cells = np.floor(points / RESOLUTION).astype(np.int64)
        low = cells.min(axis=0) - STAMP_RADIUS - max(WINDOW_SIZES)
        high = cells.max(axis=0) + STAMP_RADIUS + 1
        if self.surfel_at.size:
            height, width = self.surfel_at.shape
            end = self.corner + np.array([width, height])
            if (low >= self.corner).all() and (high <= end).all():
                return
            spare = np.maximum(
                MIN_SPARE_CELLS, (end - self.corner) // 4
            )  # in proportion to the size, so that copies are rare
            low = np.where(low < self.corner, low - spare, self.corner)
            high = np.where(high > end, high + spare, end)
        self.likelihood = enlarge(self.likelihood, self.corner, low, high, 0)
        self.surfel_at = enlarge(self.surfel_at, self.corner, low, high, -1)
        self.corner = low


def _stamp_of(window: int) -> NDArray[np.uint8]:
    """Likelihoods that one point leaves on the level with windows of this many cells."""
    offsets = np.arange(-STAMP_RADIUS, STAMP_RADIUS + 1) * RESOLUTION
    squared = offsets[:, None] ** 2 + offsets[None, :] ** 2
    smear = np.round(MAX_LIKELIHOOD * np.exp(-squared / (2.0 * SMEAR_SIGMA**2)))
    size = 2 * STAMP_RADIUS + window
    padded = np.zeros((size + window - 1, size + window - 1))
    padded[window - 1 : window - 1 + len(offsets), window - 1 : window - 1 + len(offsets)] = smear
    windows = np.lib.stride_tricks.sliding_window_view(padded, (window, window))
    stamp: NDArray[np.uint8] = windows.max(axis=(2, 3)).astype(np.uint8)
    return stamp


STAMPS = tuple(_stamp_of(window) for window in WINDOW_SIZES)


@kernel
def _stamp(
    likelihood: NDArray[np.uint8], corner: NDArray[np.int64], points: Floats, stamps: tuple[NDArray[np.uint8], ...]
) -> None:
    """Raise the likelihoods around points [N, 2] m on every level to those of the stamps."""
    for n in range(len(points)):
        column = math.floor(points[n, 0] / RESOLUTION) - corner[0]
        row = math.floor(points[n, 1] / RESOLUTION) - corner[1]
        if likelihood[0, row, column] == MAX_LIKELIHOOD:  # an earlier point in this cell left the same stamps
            continue
        for level in range(len(stamps)):
            stamp = stamps[level]
            size = len(stamp)
            first_row, first_column = row + STAMP_RADIUS + 1 - size, column + STAMP_RADIUS + 1 - size
            for i in range(size):
                for j in range(size):
                    likelihood[level, first_row + i, first_column + j] = max(
                        likelihood[level, first_row + i, first_column + j], stamp[i, j]
                    )


@kernel
def _add_surfels(
    surfel_at: NDArray[np.int32],
    surfels: Floats,
    count: int,
    corner: NDArray[np.int64],
    points: Floats,
    normals: Floats,
) -> int:
    """Average points and normals into the surfels of their cells; return the number of surfels.

    A cell keeps the surface that was observed first; points on the other side of a thin wall are left out.
    """
    for n in range(len(points)):
        if normals[n, 0] == 0.0 and normals[n, 1] == 0.0:
            continue
        column = math.floor(points[n, 0] / RESOLUTION) - corner[0]
        row = math.floor(points[n, 1] / RESOLUTION) - corner[1]
        surfel = surfel_at[row, column]
        if surfel < 0:
            surfel = count
            count += 1
            surfel_at[row, column] = surfel
        else:
            facing = surfels[surfel, 2] * normals[n, 0] + surfels[surfel, 3] * normals[n, 1]
            if facing < MIN_NORMAL_COSINE * math.hypot(surfels[surfel, 2], surfels[surfel, 3]):
                continue
        surfels[surfel, 0] += points[n, 0]
        surfels[surfel, 1] += points[n, 1]
        surfels[surfel, 2] += normals[n, 0]
        surfels[surfel, 3] += normals[n, 1]
        surfels[surfel, 4] += 1.0
    return count
