"""Occupancy grid mapping with known poses (paper, section 5).

Every scan is one observation of each cell that its beams touch (Moravec & Elfes 1985; log odds as in Thrun et al. 2005,
table 9.1): cells in which a beam ended are hits, cells that beams only crossed are misses. Log odds are kept in tiles,
so that memory grows with the observed area only.
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
from wherry.space.tiles import CELL_MASK, TILE_BITS, TILE_SIZE, enlarge

HIT_LOG_ODDS = log_odds_of(0.95)  # added to a cell in which a beam ended
MISS_LOG_ODDS = log_odds_of(
    0.18
)  # added to a crossed cell; one miss makes a cell free; a hit and a miss leave it occupied
MAX_LOG_ODDS = 6.0  # bound of the absolute value, so that few scans change a cell whose object has moved
MARGIN = 1  # cells, width of the unknown border of a map, so that no wall is on its edge


@dataclass
class GridMapper:
    """A map of log odds that grows as scans are added; tiles are allocated when a beam first touches them.

    Args:
        resolution: Side of a cell, m; cell edges are at whole multiples of it in the map frame.

    Attributes:
        corner: Column and row, in tiles, of index[0, 0], [2].
        index: Index of each tile, or −1 where none is allocated, [rows, columns].
        tiles: Log odds of the allocated tiles, [T, TILE_SIZE, TILE_SIZE]; the first ``tile_count`` are in use.
        last_scan: Number of the last scan that observed each cell, [T, TILE_SIZE, TILE_SIZE].
        tile_count: Number of allocated tiles.
        scan_count: Number of scans added.
    """

    resolution: float
    corner: NDArray[np.int64] = field(default_factory=lambda: np.zeros(2, np.int64))
    index: NDArray[np.int32] = field(default_factory=lambda: np.full((0, 0), -1, np.int32))
    tiles: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, TILE_SIZE, TILE_SIZE), np.float32))
    last_scan: NDArray[np.int32] = field(default_factory=lambda: np.zeros((0, TILE_SIZE, TILE_SIZE), np.int32))
    tile_count: int = 0
    scan_count: int = 0

    def add(self, lidar: Floats, ends: Floats, hit: NDArray[np.bool_]) -> None:
        """Add one scan.

        Args:
            lidar: Position of the lidar in the map frame, [2] m.
            ends: Ends of the beams in the map frame, [N, 2] m.
            hit: Which beams ended at an obstacle, [N]; the others are only known to be free up to their ends.
        """
        if len(ends) == 0:
            return
        self._reserve(np.vstack([ends, lidar]))
        self.scan_count += 1
        shift = self.corner * TILE_SIZE
        start, stops = lidar / self.resolution - shift, ends / self.resolution - shift
        self._allocate_tiles(_touched_tiles(self.index, start, stops))
        _add_scan(self.index, self.tiles, self.last_scan, self.scan_count, start, stops, hit)

    def grid(self) -> OccupancyGrid:
        """The map so far, cropped to the observed cells and a margin; a single unknown cell if there are none."""
        rows, columns = np.nonzero(self.index >= 0)
        if len(rows) == 0:
            return OccupancyGrid(np.full((1, 1), 0.5, np.float32), self.resolution)
        low, high = np.array([rows.min(), columns.min()]), np.array([rows.max(), columns.max()]) + 1
        log_odds = np.zeros(tuple((high - low) * TILE_SIZE), np.float32)
        for row, column in zip(rows, columns, strict=True):
            y, x = (row - low[0]) * TILE_SIZE, (column - low[1]) * TILE_SIZE
            log_odds[y : y + TILE_SIZE, x : x + TILE_SIZE] = self.tiles[self.index[row, column]]
        known_rows, known_columns = np.nonzero(log_odds.any(axis=1))[0], np.nonzero(log_odds.any(axis=0))[0]
        top, bottom = known_rows[-1] + 1 + MARGIN, max(known_rows[0] - MARGIN, 0)
        right, left = known_columns[-1] + 1 + MARGIN, max(known_columns[0] - MARGIN, 0)
        corner_x = ((self.corner[0] + low[1]) * TILE_SIZE + left) * self.resolution
        corner_y = ((self.corner[1] + low[0]) * TILE_SIZE + bottom) * self.resolution
        cropped = probability_of(np.ascontiguousarray(log_odds[bottom:top, left:right]))
        return OccupancyGrid(cropped, self.resolution, Pose(float(corner_x), float(corner_y)))

    def _reserve(self, points: Floats) -> None:
        """Enlarge the index to cover points [N, 2] m; it grows by half of its size, so that this is rare."""
        tiles = np.floor(points / (self.resolution * TILE_SIZE)).astype(np.int64)
        low, high = tiles.min(axis=0), tiles.max(axis=0) + 1
        if self.index.size:
            rows, columns = self.index.shape
            end = self.corner + np.array([columns, rows])
            if (low >= self.corner).all() and (high <= end).all():
                return
            spare = (end - self.corner) // 2
            low = np.where(low < self.corner, np.minimum(low, self.corner - spare), self.corner)
            high = np.where(high > end, np.maximum(high, end + spare), end)
        self.index = enlarge(self.index, self.corner, low, high, -1)
        self.corner = low

    def _allocate_tiles(self, touched: NDArray[np.bool_]) -> None:
        """Allocate the touched tiles, [rows, columns], that do not exist yet."""
        rows, columns = np.nonzero(touched & (self.index < 0))
        needed = self.tile_count + len(rows)
        if needed > len(self.tiles):
            added = max(needed - len(self.tiles), len(self.tiles) // 2)
            self.tiles = np.concatenate([self.tiles, np.zeros((added, TILE_SIZE, TILE_SIZE), np.float32)])
            self.last_scan = np.concatenate([self.last_scan, np.zeros((added, TILE_SIZE, TILE_SIZE), np.int32)])
        self.index[rows, columns] = np.arange(self.tile_count, needed)
        self.tile_count = needed


@kernel
def _touched_tiles(index: NDArray[np.int32], start: Floats, stops: Floats) -> NDArray[np.bool_]:
    """Which tiles beams touch, [rows, columns], of start [2] and stops [N, 2] in cells from the index's corner."""
    touched = np.zeros(index.shape, np.bool_)
    for n in range(len(stops)):
        dx, dy = (stops[n, 0] - start[0]) / TILE_SIZE, (stops[n, 1] - start[1]) / TILE_SIZE
        length = math.hypot(dx, dy)
        touched[int(stops[n, 1] // TILE_SIZE), int(stops[n, 0] // TILE_SIZE)] = True
        if length > 0.0:
            for column, row, _ in traverse(
                start[0] / TILE_SIZE, start[1] / TILE_SIZE, dx / length, dy / length, length
            ):
                if 0 <= column < index.shape[1] and 0 <= row < index.shape[0]:
                    touched[row, column] = True
    return touched


@kernel
def _add_scan(
    index: NDArray[np.int32],
    tiles: NDArray[np.float32],
    last_scan: NDArray[np.int32],
    scan: int,
    start: Floats,
    stops: Floats,
    hit: NDArray[np.bool_],
) -> None:
    """Update log odds with one scan: first the hits, then the misses, no cell twice.

    Tile and cell are computed inline, since a call that takes arrays makes the inner loop ten times slower.
    """
    for n in range(len(stops)):
        column, row = math.floor(stops[n, 0]), math.floor(stops[n, 1])
        tile = index[row >> TILE_BITS, column >> TILE_BITS]
        y, x = row & CELL_MASK, column & CELL_MASK
        if hit[n] and last_scan[tile, y, x] != scan:
            last_scan[tile, y, x] = scan
            tiles[tile, y, x] = min(tiles[tile, y, x] + HIT_LOG_ODDS, MAX_LOG_ODDS)
    for n in range(len(stops)):
        dx, dy = stops[n, 0] - start[0], stops[n, 1] - start[1]
        length = math.hypot(dx, dy)
        if length == 0.0:
            continue
        for column, row, _ in traverse(start[0], start[1], dx / length, dy / length, length):
            tile_row, tile_column = row >> TILE_BITS, column >> TILE_BITS
            if not (0 <= tile_row < index.shape[0] and 0 <= tile_column < index.shape[1]):
                continue  # rounding has moved the beam beyond the outermost tile
            tile = index[tile_row, tile_column]
            y, x = row & CELL_MASK, column & CELL_MASK
            if tile >= 0 and last_scan[tile, y, x] != scan:
                last_scan[tile, y, x] = scan
                tiles[tile, y, x] = max(tiles[tile, y, x] + MISS_LOG_ODDS, -MAX_LOG_ODDS)
