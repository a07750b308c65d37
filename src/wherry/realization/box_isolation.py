"""Rejection of box tracks that are parts of walls on the map, and removal of boxes from the map."""

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

RIM_WIDTH = 0.05  # m around the box in which occupied cells may be the box itself
RING_WIDTH = 0.075  # m beyond the rim; a box connected to occupied cells in this ring is part of a wall
UNKNOWN_GAP_WIDTH = 0.05  # m beyond the rim within which unknown cells count as a connection to a wall
PARTIAL_MAP_GAP_WIDTH = 0.25  # m, in place of UNKNOWN_GAP_WIDTH while the map is being built
MIN_FREE_RATIO = 0.7  # fraction of the ring's cells that must be free; seen from one side, a box hides a fifth


def isolated_boxes(tracks: Sequence[BoxTrack], grid: OccupancyGrid, radius: float) -> tuple[BoxTrack, ...]:
    """The confirmed tracks that are not connected to a wall on the map, as wall ends and door jambs are.

    Args:
        tracks: Box tracks.
        grid: The map, with or without boxes.
        radius: Radius of a box, m.
    """
    return tuple(
        track
        for track in tracks
        if track.is_confirmed and not _Surroundings.of(track, grid, radius).is_connected_to_wall
    )


def isolated_boxes_on_partial_map(
    tracks: Sequence[BoxTrack], grid: OccupancyGrid, radius: float
) -> tuple[BoxTrack, ...]:
    """The confirmed tracks surrounded by known free space, so that no later scan can connect them to a wall.

    Args:
        tracks: Box tracks.
        grid: The map so far, with or without boxes.
        radius: Radius of a box, m.
    """
    return tuple(
        track
        for track in tracks
        if track.is_confirmed and _Surroundings.of(track, grid, radius).is_surrounded_by_free_space
    )


@dataclass(frozen=True)
class _Surroundings:
    """The map around a box track.

    Attributes:
        distance: [H, W] distance beyond the box's rim, m; at most 0 on the box and its rim.
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
    def is_connected_to_wall(self) -> bool:
        """Whether the box is connected to occupied cells beyond its rim, directly or through a small unknown gap."""
        return self._connects_to_wall(self.occupied, RING_WIDTH) or self._connects_to_wall(
            ~self.free, UNKNOWN_GAP_WIDTH
        )

    @property
    def is_surrounded_by_free_space(self) -> bool:
        """Whether most of the ring is known to be free, and no unknown cells can connect the box to a wall."""
        ring = (self.distance > 0.0) & (self.distance < RING_WIDTH)
        is_ring_free = bool(ring.any()) and float(np.mean(self.free[ring])) >= MIN_FREE_RATIO
        return is_ring_free and not self._connects_to_wall(~self.free, PARTIAL_MAP_GAP_WIDTH)

    def _connects_to_wall(self, mask: NDArray[np.bool_], width: float) -> bool:
        """Whether a mask's cells within a width, m, of the rim connect the box to an occupied cell beyond the rim."""
        component = self._component_of_box(mask & (self.distance < width))
        return bool(np.any(component & self.occupied & (self.distance > 0.0)))

    def _component_of_box(self, mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """[H, W] the 8-connected component of a mask that contains the box."""
        on_box = self.distance <= 0.0
        labels, _ = ndimage.label(mask | on_box, structure=np.ones((3, 3)))
        component: NDArray[np.bool_] = (labels > 0) & np.isin(labels, labels[on_box])
        return component


def erase_boxes(grid: OccupancyGrid, tracks: Sequence[BoxTrack], radius: float) -> OccupancyGrid:
    """The map with the cells of boxes set free.

    Args:
        grid: The map.
        tracks: The boxes to erase.
        radius: Radius of a box, m.
    """
    if not tracks:
        return grid
    probability = grid.probability.copy()
    reach = radius + 1.5 * grid.resolution
    for track in tracks:
        window = _window(track, grid, reach)
        probability[window][_distances(track, grid, window) < reach] = 0.0
    return replace(grid, probability=probability)


def _window(track: BoxTrack, grid: OccupancyGrid, reach: float) -> tuple[slice, slice]:
    """Rows and columns of a window of the map with all cells within a distance, m, of a box's centre."""
    row, column = grid.cells_at(np.array([[track.x, track.y]]))[0].tolist()
    half = math.ceil(reach / grid.resolution) + 1
    return (
        slice(max(row - half, 0), max(row + half + 1, 0)),
        slice(max(column - half, 0), max(column + half + 1, 0)),
    )


def _distances(track: BoxTrack, grid: OccupancyGrid, window: tuple[slice, slice]) -> Floats:
    """[H, W] distances, m, of the centres of a window's cells from a box's centre."""
    return grid.distances_to(np.array([track.x, track.y]), window)
