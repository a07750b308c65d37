"""Keyframes, and the occupancy grid that is rendered from them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wherry.mapping.point_cloud import PointCloud
from wherry.robot import Scan
from wherry.space.mapper import GridMapper
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose

HIT_EXTENSION = 1e-4  # m added to a hit's range, so that a beam that ends on a cell's edge hits the cell behind it
ANGLE_LEVER = 5.0  # m from the robot at which a change of its heading must move walls by less than half a grid cell


@dataclass(frozen=True)
class Keyframe:
    """A scan that is kept as a node of the map.

    Attributes:
        scan: The scan as measured.
        cloud: Points of the scan in the base_link frame.
    """

    scan: Scan
    cloud: PointCloud


class MapRenderer:
    """Renders keyframes to an occupancy grid; only new keyframes are drawn unless the poses of earlier ones changed.

    Args:
        lidar: Pose of the lidar in the base_link frame.
        resolution: Side of a grid cell, m.
        range_limit: Longest range that is used, m.
        empty_range: Length that is taken as free along a beam without a return, m.
    """

    def __init__(self, lidar: Pose, resolution: float, range_limit: float, empty_range: float) -> None:
        self._lidar = lidar
        self._resolution = resolution
        self._range_limit = range_limit
        self._empty_range = empty_range
        self._mapper = GridMapper(resolution)
        self._drawn = np.zeros((0, 3))
        self._excluded = np.zeros((0, 3))

    def grid(self, keyframes: Sequence[Keyframe], poses: Floats, exclude: Floats) -> OccupancyGrid:
        """Render keyframes.

        Args:
            keyframes: N keyframes; those of earlier calls come first, in the same order.
            poses: base_link at each keyframe in the map frame, [N, 3] m, m, rad.
            exclude: Discs whose hits are left out: x, y and radius in the map frame, [K, 3] m.
        """
        if not self._is_current(poses, exclude):
            self._mapper, self._drawn = GridMapper(self._resolution), np.zeros((0, 3))
        self._excluded = exclude.copy()
        for keyframe, pose in zip(keyframes[len(self._drawn) :], poses[len(self._drawn) :], strict=True):
            self._draw(keyframe.scan, Pose.from_array(pose) @ self._lidar)
        self._drawn = np.vstack([self._drawn, poses[len(self._drawn) :]])
        return self._mapper.grid()

    def _is_current(self, poses: Floats, exclude: Floats) -> bool:
        """Whether all drawn keyframes are within half a grid cell of where they were drawn."""
        if not np.array_equal(exclude, self._excluded):
            return False
        moved = np.abs(poses[: len(self._drawn)] - self._drawn)
        moved[:, 2] = ANGLE_LEVER * np.minimum(moved[:, 2], math.tau - moved[:, 2])
        return bool((moved < self._resolution / 2.0).all())

    def _draw(self, scan: Scan, lidar: Pose) -> None:
        """Add one scan, taken from the lidar's pose in the map frame."""
        hit = scan.valid & (scan.ranges <= self._range_limit)
        without_return = np.isposinf(scan.ranges) | (scan.valid & ~hit)
        limit = min(self._empty_range, scan.range_max, self._range_limit)
        lengths = np.where(hit, scan.ranges + HIT_EXTENSION, limit if limit > 0.0 else np.nan)
        used = hit | (without_return & (limit > 0.0))
        angles = scan.angles[used] + lidar.theta
        origin = np.array([lidar.x, lidar.y])
        ends = origin + lengths[used, None] * np.column_stack([np.cos(angles), np.sin(angles)])
        is_hit = hit[used]
        for x, y, radius in self._excluded:
            is_hit &= np.hypot(ends[:, 0] - x, ends[:, 1] - y) > radius
        self._mapper.add(origin, ends, is_hit)
