"""Scans that are kept, and the map that is drawn of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wherry.mapping.cloud import Cloud
from wherry.robot import Scan
from wherry.space.mapper import GridMapper
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose

INTO_WALL = 1e-4  # m; a beam that ends on a cell's edge belongs to the cell behind it


@dataclass(frozen=True)
class Keyscan:
    """A scan that is part of the map.

    Attributes:
        scan: As it was measured.
        cloud: Its points, in the base_link frame.
    """

    scan: Scan
    cloud: Cloud


class MapDrawing:
    """The occupancy grid of keyscans at their present poses; draws again only what has moved.

    Args:
        lidar: Where it is mounted, in the base_link frame.
        resolution: m, a grid cell's side.
        range_limit: m, readings beyond it are left out.
        empty_range: m, how far a beam that met nothing is believed to be free.
    """

    def __init__(self, lidar: Pose, resolution: float, range_limit: float, empty_range: float) -> None:
        self._lidar = lidar
        self._resolution = resolution
        self._range_limit = range_limit
        self._empty_range = empty_range
        self._mapper = GridMapper(resolution)
        self._drawn = np.zeros((0, 3))
        self._excluded = np.zeros((0, 3))

    def grid(self, keyscans: Sequence[Keyscan], poses: Floats, exclude: Floats) -> OccupancyGrid:
        """Draw keyscans.

        Args:
            keyscans: N of them; those drawn before come first, in the same order.
            poses: [N, 3] m, m, rad, map frame: base_link at each.
            exclude: [K, 3] m: x, y and radius of discs; beams that ended there leave no hit.
        """
        if not self._still_holds(poses, exclude):
            self._mapper, self._drawn = GridMapper(self._resolution), np.zeros((0, 3))
        self._excluded = exclude.copy()
        for keyscan, pose in zip(keyscans[len(self._drawn) :], poses[len(self._drawn) :], strict=True):
            self._draw(keyscan.scan, Pose.from_array(pose) @ self._lidar)
        self._drawn = np.vstack([self._drawn, poses[len(self._drawn) :]])
        return self._mapper.grid()

    def _still_holds(self, poses: Floats, exclude: Floats) -> bool:
        """Whether everything drawn still is where it was, to half a grid cell (at 5 m, for angles)."""
        if not np.array_equal(exclude, self._excluded):
            return False
        moved = np.abs(poses[: len(self._drawn)] - self._drawn)
        moved[:, 2] = 5.0 * np.minimum(moved[:, 2], math.tau - moved[:, 2])
        return bool((moved < self._resolution / 2.0).all())

    def _draw(self, scan: Scan, lidar: Pose) -> None:
        """Add one scan to the map."""
        hit = scan.valid & (scan.ranges <= self._range_limit)
        empty = np.isposinf(scan.ranges) | (scan.valid & ~hit)
        limit = min(self._empty_range, scan.range_max, self._range_limit)
        reach = np.where(hit, scan.ranges + INTO_WALL, limit if limit > 0.0 else np.nan)
        used = hit | (empty & (limit > 0.0))
        angles = scan.angles[used] + lidar.theta
        place = np.array([lidar.x, lidar.y])
        ends = place + reach[used, None] * np.column_stack([np.cos(angles), np.sin(angles)])
        standing = hit[used]
        for x, y, radius in self._excluded:
            standing &= np.hypot(ends[:, 0] - x, ends[:, 1] - y) > radius
        self._mapper.add(place, ends, standing)
