"""Exact ranges in rooms of simple shapes."""

from __future__ import annotations

import numpy as np

from wherry.space.pose import Floats, Pose


def rectangle_ranges(lidar: Pose, angles: Floats, width: float, height: float) -> Floats:
    """Ranges [R] m from a lidar to the walls of a rectangle around the origin, for beams at angles [R] rad."""
    directions = angles + lidar.theta
    cos, sin = np.cos(directions), np.sin(directions)
    with np.errstate(divide="ignore"):
        to_sides = (np.where(cos > 0.0, width / 2.0, -width / 2.0) - lidar.x) / cos
        to_ends = (np.where(sin > 0.0, height / 2.0, -height / 2.0) - lidar.y) / sin
    ranges: Floats = np.minimum(to_sides, to_ends)
    return ranges


def circle_ranges(lidar: Pose, angles: Floats, radius: float) -> Floats:
    """Ranges [R] m from a lidar to the wall of a round hall around the origin, for beams at angles [R] rad."""
    directions = angles + lidar.theta
    along = lidar.x * np.cos(directions) + lidar.y * np.sin(directions)
    ranges: Floats = -along + np.sqrt(along**2 + radius**2 - lidar.x**2 - lidar.y**2)
    return ranges
