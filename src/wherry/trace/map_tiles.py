"""Delta coding of occupancy grids: a frame contains only those tiles of the map that changed since the frame before.

Tiles are 64 × 64 grid cells; probabilities are rounded to steps of 5 %.
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
UNKNOWN_PERCENT = 255  # unknown; ROS's -1 as an unsigned byte
PERCENT_STEP = 5
MAX_MAP_CELLS = 64_000_000  # largest decoded map, grid cells: 400 × 400 m at 5 cm
MAX_TILE_OFFSET = 0.1  # grid cells by which a grid may lie off the tiles' raster and still be aligned with it
MAX_TILE_ROTATION = 1e-6  # rad by which its angle may differ

Key = tuple[int, int]


@dataclass
class TileEncoder:
    """Finds the tiles that changed from one map to the next.

    Tiles are counted from an anchor: a grid with the anchor's orientation, a whole number of grid cells away from it,
    continues the same tiles; any other grid starts new ones.

    Attributes:
        anchor: Map-frame pose of the corner of tile (0, 0).
        resolution: Side of a grid cell, m.
        number: Number of anchors so far.
        pixels: Percent of each tile as last sent.
    """

    anchor: Pose = field(default_factory=Pose)
    resolution: float = 0.0
    number: int = 0
    pixels: dict[Key, NDArray[np.uint8]] = field(default_factory=dict)

    def changed_tiles(self, grid: OccupancyGrid) -> tuple[NDArray[np.int32], NDArray[np.uint8]]:
        """[K, 2] x and y of the tiles that changed, and [K, TILE, TILE] their percent."""
        current = _tiles_of(grid, *self._aligned_offset(grid))
        blank = np.full((TILE, TILE), UNKNOWN_PERCENT, np.uint8)
        tiles = {key: tile for key, tile in current.items() if key in self.pixels or (tile != UNKNOWN_PERCENT).any()}
        tiles.update({key: blank for key in self.pixels if key not in tiles})
        changed = [key for key, tile in tiles.items() if not np.array_equal(tile, self.pixels.get(key, blank))]
        self.pixels.update({key: tiles[key].copy() for key in changed})
        keys = np.array(changed, "<i4").reshape(-1, 2)
        pixels = np.array([tiles[key] for key in changed], np.uint8).reshape(-1, TILE, TILE)
        return keys, pixels

    def _aligned_offset(self, grid: OccupancyGrid) -> tuple[int, int]:
        """Column and row of the grid's first cell from the anchor; a grid that is not aligned becomes the anchor."""
        if self.number and grid.resolution == self.resolution:
            offset = self.anchor.inverse @ grid.origin
            column, row = round(offset.x / self.resolution), round(offset.y / self.resolution)
            misfit = math.hypot(offset.x - column * self.resolution, offset.y - row * self.resolution)
            if misfit < self.resolution * MAX_TILE_OFFSET and abs(offset.theta) < MAX_TILE_ROTATION:
                return column, row
        self.anchor, self.resolution = grid.origin, grid.resolution
        self.number += 1
        self.pixels.clear()
        return 0, 0


def _tiles_of(grid: OccupancyGrid, column: int, row: int) -> dict[Key, NDArray[np.uint8]]:
    """All tiles that a grid touches, by x and y; `column` and `row` are of its first cell."""
    height, width = grid.shape
    first_x, first_y = column // TILE, row // TILE
    columns, rows = (column + width - 1) // TILE - first_x + 1, (row + height - 1) // TILE - first_y + 1
    canvas = np.full((rows * TILE, columns * TILE), UNKNOWN_PERCENT, np.uint8)
    top, left = row - first_y * TILE, column - first_x * TILE
    canvas[top : top + height, left : left + width] = percent_of(grid)
    blocks = canvas.reshape(rows, TILE, columns, TILE).swapaxes(1, 2)
    return {(first_x + x, first_y + y): blocks[y, x] for y in range(rows) for x in range(columns)}


def percent_of(grid: OccupancyGrid) -> NDArray[np.uint8]:
    """[H, W] P(occupied) in percent as in nav_msgs/OccupancyGrid, in steps of 5; 255 for exactly 50 %: unknown."""
    percent: NDArray[np.uint8] = (np.rint(grid.probability * (100 / PERCENT_STEP)) * PERCENT_STEP).astype(np.uint8)
    percent[np.abs(grid.probability - 0.5) < 0.5 / 100] = UNKNOWN_PERCENT
    return percent


@dataclass
class TileDecoder:
    """Accumulates changed tiles into maps.

    Attributes:
        number: Number of the anchor that the tiles are counted from.
        pixels: Percent of each tile received so far.
    """

    number: int = 0
    pixels: dict[Key, NDArray[np.uint8]] = field(default_factory=dict)

    def update(self, number: int, keys: NDArray[np.int32], pixels: NDArray[np.uint8]) -> None:
        """Take over changed tiles.

        Args:
            number: Number of the anchor; a new one drops all tiles received before.
            keys: [K, 2] x and y of the tiles.
            pixels: [K, TILE, TILE] their percent.

        Raises:
            ValueError: The pixels' shape is another one.
        """
        if number != self.number:
            self.number = number
            self.pixels.clear()
        if pixels.shape != (len(keys), TILE, TILE):
            raise ValueError(f"{len(keys)} tiles with pixels of shape {pixels.shape}")
        self.pixels.update(zip([(int(x), int(y)) for x, y in keys], pixels, strict=True))

    def grid(self, anchor: Pose, resolution: float) -> OccupancyGrid:
        """The map of all tiles received so far."""
        return _joined(self.pixels, resolution, anchor)


def _joined(tiles: Mapping[Key, NDArray[np.uint8]], resolution: float, anchor: Pose) -> OccupancyGrid:
    """The smallest grid that contains all tiles."""
    if not tiles:
        return OccupancyGrid(np.full((1, 1), 0.5, np.float32), resolution, anchor)
    keys = np.array(sorted(tiles))
    low, high = keys.min(axis=0), keys.max(axis=0) + 1
    if int(np.prod(high - low)) * TILE**2 > MAX_MAP_CELLS:
        raise ValueError("the map is too large")
    percent = np.full(tuple((high - low)[::-1] * TILE), UNKNOWN_PERCENT, np.uint8)
    for (x, y), tile in tiles.items():
        row, column = (y - low[1]) * TILE, (x - low[0]) * TILE
        percent[row : row + TILE, column : column + TILE] = tile
    probability = np.where(percent == UNKNOWN_PERCENT, 0.5, percent / 100.0).astype(np.float32)
    corner = anchor @ Pose(float(low[0]) * TILE * resolution, float(low[1]) * TILE * resolution)
    return OccupancyGrid(probability, resolution, corner)
