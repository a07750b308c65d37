"""Conversion between points of the map frame and the cells of a grid that is placed in it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wherry.space.pose import Floats, Pose


def cells_at(points: Floats, origin: Pose, resolution: float) -> NDArray[np.int64]:
    """The grid cells that contain points.

    Args:
        points: Points in the map frame, [N, 2] m.
        origin: Pose of the outer corner of cell [0, 0] in the map frame.
        resolution: Side of a cell, m.

    Returns:
        Rows and columns, [N, 2]; they may be outside of the grid.
    """
    return np.floor(origin.inverse.transform(points) / resolution).astype(np.int64)[:, ::-1]


def cell_centres(cells: NDArray[np.int64], origin: Pose, resolution: float) -> Floats:
    """The centres of grid cells.

    Args:
        cells: Rows and columns, [N, 2].
        origin: Pose of the outer corner of cell [0, 0] in the map frame.
        resolution: Side of a cell, m.

    Returns:
        Points in the map frame, [N, 2] m.
    """
    return origin.transform((cells[:, ::-1] + 0.5) * resolution)
