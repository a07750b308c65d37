"""Tiles, square blocks of cells that are allocated on demand, and growing arrays of cells."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

TILE_BITS = 6  # binary logarithm of `TILE_SIZE`
TILE_SIZE = 1 << TILE_BITS  # cells along a tile's side; a power of two, so that a bit shift gives a cell's tile
CELL_MASK = TILE_SIZE - 1  # bits of a cell's column or row that are its offset within the tile

Scalar = TypeVar("Scalar", bound=np.generic)


def enlarge(
    array: NDArray[Scalar], low: NDArray[np.int64], new_low: NDArray[np.int64], new_high: NDArray[np.int64], fill: int
) -> NDArray[Scalar]:
    """Copy an array of cells into one that covers more cells.

    Args:
        array: Values, [..., H, W].
        low: Column and row of ``array[..., 0, 0]``, [2].
        new_low: Column and row of the first cell to cover, [2]; at most ``low``.
        new_high: Column and row after the last cell to cover, [2].
        fill: Value of the added cells.

    Returns:
        Values, [..., new H, new W].
    """
    columns, rows = new_high - new_low
    height, width = array.shape[-2:]
    enlarged = np.full((*array.shape[:-2], rows, columns), fill, array.dtype)
    column, row = low - new_low
    if array.size:
        enlarged[..., row : row + height, column : column + width] = array
    return enlarged
