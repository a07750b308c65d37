"""A piece of map that scans are matched to and that grows with each of them; nothing in it is ever rebuilt.

It holds the same points twice. As likelihoods, smeared over cells, for finding a scan's place from afar: level by
level, each cell of level k holding the greatest likelihood of the k × k cells that begin there, so that one look-up
bounds k × k of them (Olson 2009, and Hess et al. 2016, section V-B). As surfels, points with a direction averaged in
each cell, for finding it exactly.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import kernel
from wherry.mapping.cloud import Cloud
from wherry.space.pose import Floats

RESOLUTION = 0.05  # m, a cell's side
LEVELS = (1, 4, 8)  # cells
SMEAR = 0.06  # m, σ of a likelihood
REACH = 3  # cells, how far a point is smeared
FULL = 255  # the likelihood of a cell with a point in it
GROWTH = 64  # cells, room made beyond what is needed, at least
SAME_SURFACE = 0.7  # cosine of the angle between two normals up to which they are one surface's


class Submap:
    """Likelihoods and surfels of scans, in the frame of the first one.

    Attributes:
        corner: [2] int, column and row that cell [0, 0] stands for; cell (column, row) begins at RESOLUTION times it.
        likelihood: [L, H, W] uint8, one layer for each of `LEVELS`.
        surfel_at: [H, W] int32, the surfel in each cell, or −1.
        surfels: [S, 5] sums of x, y (m) and of the normal's x, y over the points in a cell, and their number.
        scans: How many were added.
    """

    def __init__(self) -> None:
        self.corner = np.zeros(2, np.int64)
        self.likelihood = np.zeros((len(LEVELS), 0, 0), np.uint8)
        self.surfel_at = np.zeros((0, 0), np.int32)
        self.surfels = np.zeros((0, 5))
        self.surfel_count = 0
        self.scans = 0

    def add(self, cloud: Cloud) -> None:
        """Add a scan's points, given in the submap's frame."""
        self.scans += 1
        if len(cloud.points) == 0:
            return
        self._make_room(cloud.points)
        needed = self.surfel_count + len(cloud.points)
        if needed > len(self.surfels):
            self.surfels = np.vstack([self.surfels, np.zeros((max(needed, 1024), 5))])
        _stamp(self.likelihood, self.corner, cloud.points, STAMPS)
        self.surfel_count = _add_surfels(
            self.surfel_at, self.surfels, self.surfel_count, self.corner, cloud.points, cloud.normals
        )

    @property
    def nbytes(self) -> int:
        """Bytes that it takes."""
        return self.likelihood.nbytes + self.surfel_at.nbytes + self.surfels.nbytes

    def _make_room(self, points: Floats) -> None:
        """Grow the arrays so that points, [N, 2] m, and all that is smeared around them fit."""
        cells = np.floor(points / RESOLUTION).astype(np.int64)
        low, high = cells.min(axis=0) - REACH - max(LEVELS), cells.max(axis=0) + REACH + 1
        height, width = self.surfel_at.shape
        if self.surfel_at.size:
            end = self.corner + np.array([width, height])
            if (low >= self.corner).all() and (high <= end).all():
                return
            spare = np.maximum(GROWTH, (end - self.corner) // 4)  # a share, so that a large map is seldom copied
            low = np.where(low < self.corner, low - spare, self.corner)
            high = np.where(high > end, high + spare, end)
        columns, rows = high - low
        likelihood = np.zeros((len(LEVELS), rows, columns), np.uint8)
        surfel_at = np.full((rows, columns), -1, np.int32)
        if self.surfel_at.size:
            x, y = self.corner - low
            likelihood[:, y : y + height, x : x + width] = self.likelihood
            surfel_at[y : y + height, x : x + width] = self.surfel_at
        self.likelihood, self.surfel_at, self.corner = likelihood, surfel_at, low


def _stamp_of(level: int) -> NDArray[np.uint8]:
    """What one point leaves on a level: its smear's greatest value over each cell's ``level`` × ``level`` cells."""
    offsets = np.arange(-REACH, REACH + 1) * RESOLUTION
    squared = offsets[:, None] ** 2 + offsets[None, :] ** 2
    smear = np.round(FULL * np.exp(-squared / (2.0 * SMEAR**2)))
    size = 2 * REACH + level
    padded = np.zeros((size + level - 1, size + level - 1))
    padded[level - 1 : level - 1 + len(offsets), level - 1 : level - 1 + len(offsets)] = smear
    pooled = [
        [padded[row : row + level, column : column + level].max() for column in range(size)] for row in range(size)
    ]
    return np.array(pooled, np.uint8)


STAMPS = tuple(_stamp_of(level) for level in LEVELS)


@kernel
def _stamp(
    likelihood: NDArray[np.uint8], corner: NDArray[np.int64], points: Floats, stamps: tuple[NDArray[np.uint8], ...]
) -> None:
    """Raise likelihoods around points on every level; the greatest value counts, so adding is all there is to do."""
    for n in range(len(points)):
        column = math.floor(points[n, 0] / RESOLUTION) - corner[0]
        row = math.floor(points[n, 1] / RESOLUTION) - corner[1]
        if likelihood[0, row, column] == FULL:  # a point in this cell has left the same stamps before
            continue
        for level in range(len(stamps)):
            stamp = stamps[level]
            size = len(stamp)
            first_row, first_column = row + REACH + 1 - size, column + REACH + 1 - size
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
    """Average points and normals into the cells that they lie in; return how many surfels there are then.

    A cell keeps the surface that it saw first: a thin wall's other side belongs to another cell, or is left out.
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
            if facing < SAME_SURFACE * math.hypot(surfels[surfel, 2], surfels[surfel, 3]):
                continue
        surfels[surfel, 0] += points[n, 0]
        surfels[surfel, 1] += points[n, 1]
        surfels[surfel, 2] += normals[n, 0]
        surfels[surfel, 3] += normals[n, 1]
        surfels[surfel, 4] += 1.0
    return count
