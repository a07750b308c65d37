"""Scans into maps: log-odds in tiles, so that a large site costs only where it was seen (paper, section 5).

Every scan is one observation of each cell that it crosses (Moravec & Elfes 1985; log-odds as in Thrun et al. 2005,
table 9.1): cells where a beam ended count as hit, cells that beams crossed and in which none ended count as free.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import kernel
from wherry.space.occupancy import OccupancyGrid, log_odds_of, probability_of
from wherry.space.pose import Floats, Pose
from wherry.space.raycast import traverse

TILE_BITS = 6
TILE = 1 << TILE_BITS  # cells, a tile's side: a power of two, so that a cell's tile is a shift away
CELL_BITS = TILE - 1
HIT = log_odds_of(0.95)
MISS = log_odds_of(0.18)  # once seen through is free, one hit outweighs two misses
LARGEST_LOG_ODDS = 6.0  # so that what moved is unlearnt in a few scans
MARGIN = 1  # cells around what was seen, so that a wall is never on the grid's edge


@dataclass
class GridMapper:
    """A log-odds map that grows as scans are added.

    Tiles of 64 × 64 cells are made when a beam first touches them; ``index`` says which, ``tiles`` holds them.

    Args:
        resolution: m, a cell's side. Cell edges lie on whole multiples of it in the map frame.
    """

    resolution: float
    corner: tuple[int, int] = (0, 0)  # the tile column and row that index[0, 0] stands for
    index: NDArray[np.int32] = field(default_factory=lambda: np.full((0, 0), -1, np.int32))
    tiles: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, TILE, TILE), np.float32))
    seen: NDArray[np.int32] = field(default_factory=lambda: np.zeros((0, TILE, TILE), np.int32))
    tile_count: int = 0
    scan_count: int = 0

    def add(self, lidar: Floats, ends: Floats, hit: NDArray[np.bool_]) -> None:
        """Add one scan.

        Args:
            lidar: [2] m, map frame: where the beams start.
            ends: [N, 2] m, map frame: where they end.
            hit: [N] whether something stands there; otherwise the beam is only known to be free up to there.
        """
        if len(ends) == 0:
            return
        self._make_room(np.vstack([ends, lidar]))
        self.scan_count += 1
        shift = np.array(self.corner) * TILE
        start, stops = lidar / self.resolution - shift, ends / self.resolution - shift
        self._make_tiles(_touched(self.index, start, stops))
        _add_scan(self.index, self.tiles, self.seen, self.scan_count, start, stops, hit)

    def grid(self) -> OccupancyGrid:
        """The map so far, cut to what was seen; a single unknown cell if that is nothing."""
        rows, columns = np.nonzero(self.index >= 0)
        if len(rows) == 0:
            return OccupancyGrid(np.full((1, 1), 0.5, np.float32), self.resolution)
        low, high = np.array([rows.min(), columns.min()]), np.array([rows.max(), columns.max()]) + 1
        log_odds = np.zeros(tuple((high - low) * TILE), np.float32)
        for row, column in zip(rows, columns, strict=True):
            y, x = (row - low[0]) * TILE, (column - low[1]) * TILE
            log_odds[y : y + TILE, x : x + TILE] = self.tiles[self.index[row, column]]
        known_rows, known_columns = np.nonzero(log_odds.any(axis=1))[0], np.nonzero(log_odds.any(axis=0))[0]
        top, bottom = known_rows[-1] + 1 + MARGIN, max(known_rows[0] - MARGIN, 0)
        right, left = known_columns[-1] + 1 + MARGIN, max(known_columns[0] - MARGIN, 0)
        corner_x = ((self.corner[0] + low[1]) * TILE + left) * self.resolution
        corner_y = ((self.corner[1] + low[0]) * TILE + bottom) * self.resolution
        cut = probability_of(np.ascontiguousarray(log_odds[bottom:top, left:right]))
        return OccupancyGrid(cut, self.resolution, Pose(float(corner_x), float(corner_y)))

    def _make_room(self, points: Floats) -> None:
        """Grow the index so that it covers points, [N, 2] m; doubling margins keep this rare."""
        tiles = np.floor(points / (self.resolution * TILE)).astype(np.int64)
        low, high = tiles.min(axis=0), tiles.max(axis=0) + 1
        rows, columns = self.index.shape
        if self.index.size == 0:
            old_low, old_high = low, low
        else:
            old_low = np.array(self.corner)
            old_high = old_low + np.array([columns, rows])
            if (low >= old_low).all() and (high <= old_high).all():
                return
            spare = (old_high - old_low) // 2
            low = np.where(low < old_low, np.minimum(low, old_low - spare), old_low)
            high = np.where(high > old_high, np.maximum(high, old_high + spare), old_high)
        grown = np.full((high[1] - low[1], high[0] - low[0]), -1, np.int32)
        at = old_low - low
        grown[at[1] : at[1] + rows, at[0] : at[0] + columns] = self.index
        self.index, self.corner = grown, (int(low[0]), int(low[1]))

    def _make_tiles(self, touched: NDArray[np.bool_]) -> None:
        """Make the tiles that a scan touches and that do not exist yet."""
        rows, columns = np.nonzero(touched & (self.index < 0))
        wanted = self.tile_count + len(rows)
        if wanted > len(self.tiles):
            more = max(wanted - len(self.tiles), len(self.tiles) // 2)
            self.tiles = np.concatenate([self.tiles, np.zeros((more, TILE, TILE), np.float32)])
            self.seen = np.concatenate([self.seen, np.zeros((more, TILE, TILE), np.int32)])
        self.index[rows, columns] = np.arange(self.tile_count, wanted)
        self.tile_count = wanted


@kernel
def _touched(index: NDArray[np.int32], start: Floats, stops: Floats) -> NDArray[np.bool_]:
    """The tiles that beams touch, [tile rows, tile columns]; start [2] and stops [N, 2] in cells of the index."""
    touched = np.zeros(index.shape, np.bool_)
    for n in range(len(stops)):
        dx, dy = (stops[n, 0] - start[0]) / TILE, (stops[n, 1] - start[1]) / TILE
        length = math.hypot(dx, dy)
        touched[int(stops[n, 1] // TILE), int(stops[n, 0] // TILE)] = True
        if length > 0.0:
            for column, row, _ in traverse(start[0] / TILE, start[1] / TILE, dx / length, dy / length, length):
                if 0 <= column < index.shape[1] and 0 <= row < index.shape[0]:
                    touched[row, column] = True
    return touched


@kernel
def _add_scan(
    index: NDArray[np.int32],
    tiles: NDArray[np.float32],
    seen: NDArray[np.int32],
    scan: int,
    start: Floats,
    stops: Floats,
    hit: NDArray[np.bool_],
) -> None:
    """Update log-odds by one scan: hits first, then what beams crossed; no cell twice, which ``seen`` remembers.

    Tile and cell are worked out in place: a call with arrays in the inner loop costs ten times as much.
    """
    for n in range(len(stops)):
        column, row = math.floor(stops[n, 0]), math.floor(stops[n, 1])
        tile = index[row >> TILE_BITS, column >> TILE_BITS]
        y, x = row & CELL_BITS, column & CELL_BITS
        if hit[n] and seen[tile, y, x] != scan:
            seen[tile, y, x] = scan
            tiles[tile, y, x] = min(tiles[tile, y, x] + HIT, LARGEST_LOG_ODDS)
    for n in range(len(stops)):
        dx, dy = stops[n, 0] - start[0], stops[n, 1] - start[1]
        length = math.hypot(dx, dy)
        if length == 0.0:
            continue
        for column, row, _ in traverse(start[0], start[1], dx / length, dy / length, length):
            tile_row, tile_column = row >> TILE_BITS, column >> TILE_BITS
            if not (0 <= tile_row < index.shape[0] and 0 <= tile_column < index.shape[1]):
                continue  # rounding, on the outermost edge
            tile = index[tile_row, tile_column]
            y, x = row & CELL_BITS, column & CELL_BITS
            if tile >= 0 and seen[tile, y, x] != scan:
                seen[tile, y, x] = scan
                tiles[tile, y, x] = max(tiles[tile, y, x] + MISS, -LARGEST_LOG_ODDS)
