"""Cells of a square grid that is placed in the map frame: which one contains a point, and where their centres are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wherry.space.pose import Floats, Pose


def cells_at(points: Floats, origin: Pose, resolution: float) -> NDArray[np.int64]:
    """The grid cells that contain points.

    Args:
        points: [N, 2] m, map frame.
        origin: The outer corner of grid cell [0, 0] in the map frame.
        resolution: Side of a grid cell, m.

    Returns:
        [N, 2] row and column; both may lie outside the grid.
    """
    return np.floor(origin.inverse.transform(points) / resolution).astype(np.int64)[:, ::-1]


def cell_centres(cells: NDArray[np.int64], origin: Pose, resolution: float) -> Floats:
    """The centres of grid cells.

    Args:
        cells: [N, 2] row and column.
        origin: The outer corner of grid cell [0, 0] in the map frame.
        resolution: Side of a grid cell, m.

    Returns:
        [N, 2] m, map frame.
    """
    return origin.transform((cells[:, ::-1] + 0.5) * resolution)
