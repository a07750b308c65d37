"""A corridor that leaves the position along it undetermined."""

from __future__ import annotations

import numpy as np

from wherry.mapping.point_cloud import PointCloud


def bare_corridor(half_length: float) -> PointCloud:
    """Points on two parallel walls, 1.6 m apart, that reach half a length, m, to either side of the origin."""
    x = np.arange(-half_length, half_length, 0.05)
    return PointCloud(
        np.vstack([np.column_stack([x, np.full_like(x, side)]) for side in (-0.8, 0.8)]),
        np.vstack([np.tile([0.0, -side], (len(x), 1)) for side in (-1.0, 1.0)]),
    )
