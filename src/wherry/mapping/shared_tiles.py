"""Likelihood maps of many particles in one pool of tiles; equal parts exist once and are copied when one is written to.

When particles are drawn again, a map is copied by copying which tiles it is made of.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import kernel
from wherry.mapping.submap import FULL, REACH, RESOLUTION, STAMPS
from wherry.space.pose import Floats

TILE_BITS = 6
TILE = 1 << TILE_BITS  # cells, a tile's side
CELL_BITS = TILE - 1
MARGIN = 8  # tiles, room made beyond what is needed


class SharedTiles:
    """Maps of N particles.

    Attributes:
        corner: [2] int, the tile column and row that index[:, 0, 0] stands for.
        index: [N, H, W] int32, which tile each part of a particle's map is; tile 0 is empty for ever.
        tiles: [T, TILE, TILE] uint8, likelihoods as in a `Submap`'s finest level.
        users: [T] how often a tile stands in the index.
    """

    def __init__(self, count: int) -> None:
        self.corner = np.zeros(2, np.int64)
        self.index = np.zeros((count, 0, 0), np.int32)
        self.tiles = np.zeros((1, TILE, TILE), np.uint8)
        self.users = np.ones(1, np.int64)

    def add(self, particle: int, points: Floats) -> None:
        """Smear points, [N, 2] m, map frame, into one particle's map."""
        if len(points) == 0:
            return
        cells = np.floor(points / RESOLUTION).astype(np.int64)
        self._make_room(cells)
        offset = self.corner * TILE
        low, high = (cells - offset - REACH) >> TILE_BITS, (cells - offset + REACH) >> TILE_BITS
        corners = np.vstack(
            [low, high, np.column_stack([low[:, 0], high[:, 1]]), np.column_stack([high[:, 0], low[:, 1]])]
        )
        touched = np.zeros(self.index.shape[1:], np.bool_)
        touched[corners[:, 1], corners[:, 0]] = True
        self._own(particle, *np.nonzero(touched))
        _stamp(self.index[particle], self.tiles, cells - offset, STAMPS[0])

    def draw(self, parents: NDArray[np.int64]) -> None:
        """Give each particle the map of its parent, [N]."""
        self.index = self.index[parents]
        self.users = np.bincount(self.index.ravel(), minlength=len(self.tiles)).astype(np.int64)
        self.users[0] += 1  # the empty tile is never anyone's own

    def _own(self, particle: int, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> None:
        """See to it that tiles of a particle's map are its own, so that they may be written to."""
        present = self.index[particle, rows, columns]
        shared = (self.users[present] > 1) | (present == 0)
        rows, columns, present = rows[shared], columns[shared], present[shared]
        if len(present) == 0:
            return
        unused = np.flatnonzero(self.users[1:] == 0) + 1
        missing = len(present) - len(unused)
        if missing > 0:
            more = max(missing, len(self.tiles) // 2)
            unused = np.concatenate([unused, np.arange(len(self.tiles), len(self.tiles) + more)])
            self.tiles = np.concatenate([self.tiles, np.zeros((more, TILE, TILE), np.uint8)])
            self.users = np.concatenate([self.users, np.zeros(more, np.int64)])
        own = unused[: len(present)]
        self.tiles[own] = self.tiles[present]
        self.users[own] = 1
        np.subtract.at(self.users, present, 1)
        self.users[0] = max(self.users[0], 2)
        self.index[particle, rows, columns] = own

    def _make_room(self, cells: NDArray[np.int64]) -> None:
        """Grow the index so that cells, [N, 2], and all that is smeared around them fit."""
        low, high = (cells.min(axis=0) - REACH) >> TILE_BITS, ((cells.max(axis=0) + REACH) >> TILE_BITS) + 1
        count, rows, columns = self.index.shape
        if self.index.size:
            end = self.corner + np.array([columns, rows])
            if (low >= self.corner).all() and (high <= end).all():
                return
            low = np.where(low < self.corner, low - MARGIN, self.corner)
            high = np.where(high > end, high + MARGIN, end)
        grown = np.zeros((count, high[1] - low[1], high[0] - low[0]), np.int32)
        if self.index.size:
            x, y = self.corner - low
            grown[:, y : y + rows, x : x + columns] = self.index
        self.index, self.corner = grown, low


@kernel
def _stamp(
    index: NDArray[np.int32], tiles: NDArray[np.uint8], cells: NDArray[np.int64], stamp: NDArray[np.uint8]
) -> None:
    """Raise likelihoods around cells [N, 2] of one particle's map, whose tiles there are its own."""
    for n in range(len(cells)):
        column, row = cells[n, 0], cells[n, 1]
        if tiles[index[row >> TILE_BITS, column >> TILE_BITS], row & CELL_BITS, column & CELL_BITS] == FULL:
            continue
        for i in range(len(stamp)):
            for j in range(len(stamp)):
                y, x = row + i - REACH, column + j - REACH
                tile = index[y >> TILE_BITS, x >> TILE_BITS]
                value = tiles[tile, y & CELL_BITS, x & CELL_BITS]
                tiles[tile, y & CELL_BITS, x & CELL_BITS] = max(value, stamp[i, j])


@kernel
def log_likelihood(
    index: NDArray[np.int32],
    tiles: NDArray[np.uint8],
    corner: NDArray[np.int64],
    points: Floats,
    x: float,
    y: float,
    theta: float,
    logs: Floats,
) -> float:
    """Sum of ``logs[likelihood]`` of points seen from a pose on one particle's map.

    Args:
        index: [H, W], the particle's.
        tiles: [T, TILE, TILE].
        corner: [2], of the index, in tiles.
        points: [N, 2] m, base_link frame.
        x: m, map frame.
        y: m, map frame.
        theta: rad.
        logs: [256].
    """
    cos, sin = math.cos(theta), math.sin(theta)
    scale = 1.0 / RESOLUTION
    left, bottom = corner[0] * TILE, corner[1] * TILE
    height, width = index.shape
    total = 0.0
    for n in range(len(points)):
        column = math.floor((x + cos * points[n, 0] - sin * points[n, 1]) * scale) - left
        row = math.floor((y + sin * points[n, 0] + cos * points[n, 1]) * scale) - bottom
        tile_column, tile_row = column >> TILE_BITS, row >> TILE_BITS
        value = 0
        if 0 <= tile_column < width and 0 <= tile_row < height:
            value = tiles[index[tile_row, tile_column], row & CELL_BITS, column & CELL_BITS]
        total += logs[value]
    return total
