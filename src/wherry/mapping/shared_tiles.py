"""Likelihood maps of many particles in one pool of tiles; equal tiles are shared, and copied on write.

Resampling then copies the indices of tiles instead of whole maps.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import kernel
from wherry.mapping.matching_grid import MAX_LIKELIHOOD, RESOLUTION, STAMP_RADIUS, STAMPS
from wherry.space.pose import Floats
from wherry.space.tiles import CELL_MASK, TILE_BITS, TILE_SIZE, enlarge

SPARE_TILES = 8  # tiles by which the index grows beyond the needed ones, so that it rarely grows
EMPTY_TILE = 0  # index of the tile that all parts without points share; it is never written to


class SharedTiles:
    """Likelihood maps of N particles.

    Attributes:
        corner: Column and row, in tiles, of index[:, 0, 0], [2].
        index: Index of the tile at each column and row of each particle's map, [N, H, W] int32.
        tiles: Likelihoods as on the finest level of a `MatchingGrid`, [T, TILE_SIZE, TILE_SIZE] uint8.
        users: How often each tile occurs in the index, [T].
    """

    def __init__(self, count: int) -> None:
        self.corner = np.zeros(2, np.int64)
        self.index = np.zeros((count, 0, 0), np.int32)
        self.tiles = np.zeros((1, TILE_SIZE, TILE_SIZE), np.uint8)
        self.users = np.ones(1, np.int64)

    def add(self, particle: int, points: Floats) -> None:
        """Raise the likelihoods around points [N, 2] m of the map frame in one particle's map."""
        if len(points) == 0:
            return
        cells = np.floor(points / RESOLUTION).astype(np.int64)
        self._reserve(cells)
        offset = self.corner * TILE_SIZE
        low, high = (cells - offset - STAMP_RADIUS) >> TILE_BITS, (cells - offset + STAMP_RADIUS) >> TILE_BITS
        corners = np.vstack(
            [low, high, np.column_stack([low[:, 0], high[:, 1]]), np.column_stack([high[:, 0], low[:, 1]])]
        )
        touched = np.zeros(self.index.shape[1:], np.bool_)
        touched[corners[:, 1], corners[:, 0]] = True
        self._make_writable(particle, *np.nonzero(touched))
        _stamp(self.index[particle], self.tiles, cells - offset, STAMPS[0])

    def resample(self, parents: NDArray[np.int64]) -> None:
        """Give each particle the map of its parent, [N]."""
        self.index = self.index[parents]
        self.users = np.bincount(self.index.ravel(), minlength=len(self.tiles)).astype(np.int64)
        self.users[EMPTY_TILE] += 1

    def _make_writable(self, particle: int, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> None:
        """Give a particle its own copies of those tiles at rows and columns [K] of the index that are shared."""
        present = self.index[particle, rows, columns]
        shared = (self.users[present] > 1) | (present == EMPTY_TILE)
        rows, columns, present = rows[shared], columns[shared], present[shared]
        if len(present) == 0:
            return
        unused = np.flatnonzero(self.users[1:] == 0) + 1
        missing = len(present) - len(unused)
        if missing > 0:
            added = max(missing, len(self.tiles) // 2)
            unused = np.concatenate([unused, np.arange(len(self.tiles), len(self.tiles) + added)])
            self.tiles = np.concatenate([self.tiles, np.zeros((added, TILE_SIZE, TILE_SIZE), np.uint8)])
            self.users = np.concatenate([self.users, np.zeros(added, np.int64)])
        own = unused[: len(present)]
        self.tiles[own] = self.tiles[present]
        self.users[own] = 1
        np.subtract.at(self.users, present, 1)
        self.users[EMPTY_TILE] = max(self.users[EMPTY_TILE], 2)
        self.index[particle, rows, columns] = own

    def _reserve(self, cells: NDArray[np.int64]) -> None:
        """Enlarge the index to cover cells [N, 2] and the stamps around them."""
        low = (cells.min(axis=0) - STAMP_RADIUS) >> TILE_BITS
        high = ((cells.max(axis=0) + STAMP_RADIUS) >> TILE_BITS) + 1
        if self.index.size:
            _, height, width = self.index.shape
            end = self.corner + np.array([width, height])
            if (low >= self.corner).all() and (high <= end).all():
                return
            low = np.where(low < self.corner, low - SPARE_TILES, self.corner)
            high = np.where(high > end, high + SPARE_TILES, end)
        self.index = enlarge(self.index, self.corner, low, high, EMPTY_TILE)
        self.corner = low


@kernel
def _stamp(
    index: NDArray[np.int32], tiles: NDArray[np.uint8], cells: NDArray[np.int64], stamp: NDArray[np.uint8]
) -> None:
    """Raise the likelihoods around cells [N, 2] of one particle's map, whose tiles there are writable.

    Unlike in a `MatchingGrid`, whose arrays are contiguous, each cell is looked up through the index.
    """
    for n in range(len(cells)):
        column, row = cells[n, 0], cells[n, 1]
        if tiles[index[row >> TILE_BITS, column >> TILE_BITS], row & CELL_MASK, column & CELL_MASK] == MAX_LIKELIHOOD:
            continue
        for i in range(len(stamp)):
            for j in range(len(stamp)):
                y, x = row + i - STAMP_RADIUS, column + j - STAMP_RADIUS
                tile = index[y >> TILE_BITS, x >> TILE_BITS]
                value = tiles[tile, y & CELL_MASK, x & CELL_MASK]
                tiles[tile, y & CELL_MASK, x & CELL_MASK] = max(value, stamp[i, j])


@kernel
def log_likelihood(
    index: NDArray[np.int32],
    tiles: NDArray[np.uint8],
    corner: NDArray[np.int64],
    points: Floats,
    x: float,
    y: float,
    theta: float,
    log_table: Floats,
) -> float:
    """Log likelihood of points on one particle's map, observed from a pose.

    Args:
        index: The particle's index, [H, W].
        tiles: All tiles, [T, TILE_SIZE, TILE_SIZE].
        corner: Column and row of the index, in tiles, [2].
        points: Points in the base_link frame, [N, 2] m.
        x: x of base_link in the map frame, m.
        y: y of base_link in the map frame, m.
        theta: Heading of base_link in the map frame, rad.
        log_table: Log likelihood of each value of a cell, [256].
    """
    cos, sin = math.cos(theta), math.sin(theta)
    scale = 1.0 / RESOLUTION
    left, bottom = corner[0] * TILE_SIZE, corner[1] * TILE_SIZE
    height, width = index.shape
    total = 0.0
    for n in range(len(points)):
        column = math.floor((x + cos * points[n, 0] - sin * points[n, 1]) * scale) - left
        row = math.floor((y + sin * points[n, 0] + cos * points[n, 1]) * scale) - bottom
        tile_column, tile_row = column >> TILE_BITS, row >> TILE_BITS
        value = 0
        if 0 <= tile_column < width and 0 <= tile_row < height:
            value = tiles[index[tile_row, tile_column], row & CELL_MASK, column & CELL_MASK]
        total += log_table[value]
    return total
