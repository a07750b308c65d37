"""Delta coding of occupancy grids: a frame contains only the tiles that have changed since the previous frame.

A tile has 64 × 64 grid cells. Probabilities are stored in percent as in nav_msgs/OccupancyGrid, in steps of 5 %.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose

TILE = 64  # side of a tile, grid cells
UNKNOWN_PERCENT = 255  # value of unknown cells; ROS's -1 as an unsigned byte
PERCENT_STEP = 5  # %, unit of stored probabilities
MAX_MAP_CELLS = 64_000_000  # largest decoded map, grid cells: 400 × 400 m at 5 cm
MAX_EXTENT = 20_000.0  # m from the anchor to the map's edges
ALIGNMENT_TOLERANCE = 0.1  # grid cells between a grid's raster and that of the tiles
ROTATION_TOLERANCE = 1e-6  # rad between a grid's orientation and that of the tiles

TileKey = tuple[int, int]  # x and y of a tile, counted in tiles from the anchor


@dataclass
class TileEncoder:
    """Finds the tiles that changed from one map to the next.

    Tiles are numbered from an anchor. A grid with the anchor's orientation and an offset of whole grid cells continues
    the same tiles; any other grid becomes the new anchor, and all its tiles are encoded again.

    Attributes:
        anchor: Map-frame pose of the corner of tile (0, 0).
        resolution: Side of a grid cell, m.
        anchor_number: Number of the anchor, counted from 1.
        tiles: [TILE, TILE] P(occupied) in percent of each tile, as last encoded.
    """

    anchor: Pose = field(default_factory=Pose)
    resolution: float = 0.0
    anchor_number: int = 0
    tiles: dict[TileKey, NDArray[np.uint8]] = field(default_factory=dict)

    def changed_tiles(self, grid: OccupancyGrid) -> tuple[NDArray[np.int32], NDArray[np.uint8]]:
        """[K, 2] x and y of the tiles that changed, and [K, TILE, TILE] their P(occupied) in percent."""
        current = _tiles_of(grid, *self._aligned_offset(grid))
        blank = np.full((TILE, TILE), UNKNOWN_PERCENT, np.uint8)
        tiles = {key: tile for key, tile in current.items() if key in self.tiles or (tile != UNKNOWN_PERCENT).any()}
        tiles.update({key: blank for key in self.tiles if key not in tiles})
        changed = [key for key, tile in tiles.items() if not np.array_equal(tile, self.tiles.get(key, blank))]
        self.tiles.update({key: tiles[key].copy() for key in changed})
        keys = np.array(changed, "<i4").reshape(-1, 2)
        percent = np.array([tiles[key] for key in changed], np.uint8).reshape(-1, TILE, TILE)
        return keys, percent

    def _aligned_offset(self, grid: OccupancyGrid) -> tuple[int, int]:
        """Offset of the grid from the anchor, columns and rows; a grid that is not aligned becomes the new anchor."""
        if self.anchor_number and grid.resolution == self.resolution:
            offset = self.anchor.inverse @ grid.origin
            column, row = round(offset.x / self.resolution), round(offset.y / self.resolution)
            misalignment = math.hypot(offset.x - column * self.resolution, offset.y - row * self.resolution)
            if misalignment < self.resolution * ALIGNMENT_TOLERANCE and abs(offset.theta) < ROTATION_TOLERANCE:
                return column, row
        self.anchor, self.resolution = grid.origin, grid.resolution
        self.anchor_number += 1
        self.tiles.clear()
        return 0, 0


def _tiles_of(grid: OccupancyGrid, column: int, row: int) -> dict[TileKey, NDArray[np.uint8]]:
    """All tiles that a grid overlaps.

    Args:
        grid: The grid.
        column: Column of the grid's first cell, counted from the anchor.
        row: Row of the grid's first cell, counted from the anchor.
    """
    height, width = grid.shape
    first_x, first_y = column // TILE, row // TILE
    columns, rows = (column + width - 1) // TILE - first_x + 1, (row + height - 1) // TILE - first_y + 1
    canvas = np.full((rows * TILE, columns * TILE), UNKNOWN_PERCENT, np.uint8)
    top, left = row - first_y * TILE, column - first_x * TILE
    canvas[top : top + height, left : left + width] = percent_of(grid)
    blocks = canvas.reshape(rows, TILE, columns, TILE).swapaxes(1, 2)
    return {(first_x + x, first_y + y): blocks[y, x] for y in range(rows) for x in range(columns)}


def percent_of(grid: OccupancyGrid) -> NDArray[np.uint8]:
    """[H, W] P(occupied) in percent, in steps of 5; `UNKNOWN_PERCENT` where it is exactly 50 %."""
    percent: NDArray[np.uint8] = (np.rint(grid.probability * (100 / PERCENT_STEP)) * PERCENT_STEP).astype(np.uint8)
    percent[np.abs(grid.probability - 0.5) < 0.5 / 100] = UNKNOWN_PERCENT
    return percent


@dataclass
class TileDecoder:
    """Accumulates changed tiles into maps.

    Attributes:
        anchor_number: Number of the anchor that the tiles are counted from.
        tiles: [TILE, TILE] P(occupied) in percent of each tile received so far.
    """

    anchor_number: int = 0
    tiles: dict[TileKey, NDArray[np.uint8]] = field(default_factory=dict)

    def update(self, anchor_number: int, keys: NDArray[np.int32], percent: NDArray[np.uint8]) -> None:
        """Apply changed tiles.

        Args:
            anchor_number: Number of the anchor; a new anchor discards all tiles received before.
            keys: [K, 2] x and y of the tiles.
            percent: [K, TILE, TILE] P(occupied) of the tiles, percent.

        Raises:
            ValueError: The shape of `percent` is invalid, or a value is no percentage.
        """
        if anchor_number != self.anchor_number:
            self.anchor_number = anchor_number
            self.tiles.clear()
        if percent.shape != (len(keys), TILE, TILE):
            raise ValueError(f"{len(keys)} tiles with values of shape {percent.shape}")
        if ((percent > 100) & (percent != UNKNOWN_PERCENT)).any():
            raise ValueError("a tile has more than 100 percent")
        self.tiles.update(zip([(int(x), int(y)) for x, y in keys], percent, strict=True))

    def grid(self, anchor: Pose, resolution: float) -> OccupancyGrid:
        """The map of all tiles received so far."""
        return _joined(self.tiles, resolution, anchor)


def _joined(tiles: Mapping[TileKey, NDArray[np.uint8]], resolution: float, anchor: Pose) -> OccupancyGrid:
    """The smallest grid that contains all tiles."""
    if not tiles:
        return OccupancyGrid(np.full((1, 1), 0.5, np.float32), resolution, anchor)
    keys = np.array(sorted(tiles))
    low, high = keys.min(axis=0), keys.max(axis=0) + 1
    if math.prod((high - low).tolist()) * TILE**2 > MAX_MAP_CELLS:
        raise ValueError(f"the map has more than {MAX_MAP_CELLS:,} cells")
    if float(np.abs([low, high]).max()) * TILE * resolution > MAX_EXTENT:
        raise ValueError(f"the map extends beyond {MAX_EXTENT:,.0f} m")
    percent = np.full(tuple((high - low)[::-1] * TILE), UNKNOWN_PERCENT, np.uint8)
    for (x, y), tile in tiles.items():
        row, column = (y - low[1]) * TILE, (x - low[0]) * TILE
        percent[row : row + TILE, column : column + TILE] = tile
    table = np.arange(UNKNOWN_PERCENT + 1, dtype=np.float32) / np.float32(100.0)
    table[UNKNOWN_PERCENT] = 0.5
    probability = table[percent]
    corner = anchor @ Pose(float(low[0]) * TILE * resolution, float(low[1]) * TILE * resolution)
    return OccupancyGrid(probability, resolution, corner)
