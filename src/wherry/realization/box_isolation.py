"""Which box tracks stand free of walls on a map, and the map without its boxes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from wherry.realization.box_tracks import BoxTrack
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats

RIM_WIDTH = 0.05  # m around a box's radius in which occupied cells may still be the box itself
RING_WIDTH = 0.075  # m beyond the rim in which occupied cells connected to the box make it part of a wall
UNKNOWN_GAP_WIDTH = 0.05  # m beyond the rim in which a wall may be connected to the box through unknown cells
PARTIAL_MAP_GAP_WIDTH = 0.25  # m beyond the rim, the same as UNKNOWN_GAP_WIDTH for a map that is still growing
MIN_FREE_RATIO = 0.7  # share of the ring's cells known to be free; a box seen from one side hides a fifth of its ring


def isolated_boxes(tracks: Sequence[BoxTrack], grid: OccupancyGrid, radius: float) -> tuple[BoxTrack, ...]:
    """The confirmed tracks that no wall on the map touches; a track that one touches is a wall's end or a jamb.

    Args:
        tracks: Box tracks.
        grid: The map; boxes may be on it or not.
        radius: Radius of a box, m.
    """
    return tuple(track for track in tracks if track.is_confirmed and not _Surroundings.of(track, grid, radius).has_wall)


def isolated_boxes_on_partial_map(
    tracks: Sequence[BoxTrack], grid: OccupancyGrid, radius: float
) -> tuple[BoxTrack, ...]:
    """As `isolated_boxes`, but only those with known free space around them, so that no later scan can show a wall."""
    return tuple(track for track in tracks if track.is_confirmed and _Surroundings.of(track, grid, radius).is_free)


@dataclass(frozen=True)
class _Surroundings:
    """The map around a box track.

    Attributes:
        distance: [H, W] distance from the outer edge of the box's rim, m; at most 0 on the box.
        free: [H, W] True where the map is free.
        occupied: [H, W] True where the map is occupied.
    """

    distance: Floats
    free: NDArray[np.bool_]
    occupied: NDArray[np.bool_]

    @classmethod
    def of(cls, track: BoxTrack, grid: OccupancyGrid, radius: float) -> _Surroundings:
        """Cut the surroundings out of a map."""
        window = _window(track, grid, radius + RIM_WIDTH + PARTIAL_MAP_GAP_WIDTH)
        distance = _distances(track, grid, window) - radius - RIM_WIDTH
        return cls(distance, grid.free[window], grid.occupied[window])

    @property
    def has_wall(self) -> bool:
        """Whether occupied cells beyond the rim are connected to the box, directly or through a small unknown gap."""
        return self._has_connected_wall(self.occupied, RING_WIDTH) or self._has_connected_wall(
            ~self.free, UNKNOWN_GAP_WIDTH
        )

    @property
    def is_free(self) -> bool:
        """Whether the ring around the box is known to be free, and no wall can be connected through unknown cells."""
        ring = (self.distance > 0.0) & (self.distance < RING_WIDTH)
        is_known_free = bool(ring.any()) and float(np.mean(self.free[ring])) >= MIN_FREE_RATIO
        return is_known_free and not self._has_connected_wall(~self.free, PARTIAL_MAP_GAP_WIDTH)

    def _has_connected_wall(self, cells: NDArray[np.bool_], width: float) -> bool:
        """Whether cells within a width, m, of the rim connect the box to an occupied cell beyond the rim."""
        component = self._component_of_box(cells & (self.distance < width))
        return bool(np.any(component & self.occupied & (self.distance > 0.0)))

    def _component_of_box(self, cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """[H, W] the 8-connected component of cells that contains the box."""
        on_box = self.distance <= 0.0
        labels, _ = ndimage.label(cells | on_box, structure=np.ones((3, 3)))
        component: NDArray[np.bool_] = (labels > 0) & np.isin(labels, labels[on_box])
        return component


def erase_boxes(grid: OccupancyGrid, tracks: Sequence[BoxTrack], radius: float) -> OccupancyGrid:
    """The map with the cells of boxes set free, since boxes are removed and walls are not; the same map if no boxes."""
    if not tracks:
        return grid
    probability = grid.probability.copy()
    reach = radius + 1.5 * grid.resolution
    for track in tracks:
        window = _window(track, grid, reach)
        probability[window][_distances(track, grid, window) < reach] = 0.0
    return replace(grid, probability=probability)


def _window(track: BoxTrack, grid: OccupancyGrid, reach: float) -> tuple[slice, slice]:
    """Rows and columns of the map that contain all cells within a reach, m, of a box's centre."""
    row, column = grid.cells_at(np.array([[track.x, track.y]]))[0].tolist()
    half = math.ceil(reach / grid.resolution) + 1
    return (
        slice(max(row - half, 0), max(row + half + 1, 0)),
        slice(max(column - half, 0), max(column + half + 1, 0)),
    )


def _distances(track: BoxTrack, grid: OccupancyGrid, window: tuple[slice, slice]) -> Floats:
    """[H, W] distances, m, of the centres of a window's cells from a box's centre."""
    return grid.distances_to(np.array([track.x, track.y]), window)
