"""Rays through a grid, cell by cell (Amanatides & Woo 1987): what a lidar would measure on a map."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import kernel, stepper
from wherry.space.pose import Floats, Pose


def cast_rays(
    blocked: NDArray[np.bool_],
    resolution: float,
    origin: Pose,
    poses: Floats,
    angles: Floats,
    range_max: float,
) -> Floats:
    """Distances at which rays enter the first blocked cell; exact for grids whose cells are the truth.

    Args:
        blocked: [H, W] cells that stop a ray; what lies outside the grid does not.
        resolution: m, a cell's side.
        origin: The outer corner of cell [0, 0] in the map frame.
        poses: [N, 3] m, m, rad, map frame: where the lidars stand.
        angles: [R] rad, the beams' directions in the lidar's frame.
        range_max: m, rays end there.

    Returns:
        [N, R] m; ``inf`` where a ray met nothing, 0 where it starts in a blocked cell.
    """
    starts = origin.inverse.transform(np.asarray(poses, dtype=np.float64)[:, :2]) / resolution
    directions = np.asarray(poses, dtype=np.float64)[:, 2:3] - origin.theta + angles[None, :]
    return _cast_rays(blocked, starts, directions, range_max / resolution) * resolution


@kernel
def _cast_rays(blocked: NDArray[np.bool_], starts: Floats, directions: Floats, limit: float) -> Floats:
    """As `cast_rays`, in cells: starts [N, 2], directions [N, R] rad, lengths [N, R]."""
    lengths = np.empty(directions.shape)
    for n in range(directions.shape[0]):
        for r in range(directions.shape[1]):
            angle = directions[n, r]
            lengths[n, r] = ray_length(blocked, starts[n, 0], starts[n, 1], math.cos(angle), math.sin(angle), limit)
    return lengths


@kernel
def ray_length(blocked: NDArray[np.bool_], x: float, y: float, dx: float, dy: float, limit: float) -> float:
    """How far a ray gets before it enters a blocked cell, in cells; ``inf`` if it gets as far as the limit.

    Args:
        blocked: [H, W].
        x: The start, in cells from the grid's corner.
        y: The start, likewise.
        dx: The direction; a unit vector.
        dy: The direction, likewise.
        limit: Cells.
    """
    height, width = blocked.shape
    for column, row, entered in traverse(x, y, dx, dy, limit):
        if 0 <= column < width and 0 <= row < height:
            if blocked[row, column]:
                return entered
        elif (
            (column < 0 and dx <= 0)
            or (column >= width and dx >= 0)
            or (row < 0 and dy <= 0)
            or (row >= height and dy >= 0)
        ):
            break  # the ray left the grid and does not come back
    return math.inf


@stepper
def traverse(x: float, y: float, dx: float, dy: float, limit: float) -> Iterator[tuple[int, int, float]]:
    """Yield the cells that a ray crosses, in order: column, row, and how far along the ray it is entered.

    Crossings are computed from whole cell numbers each time, so that nothing accumulates along a long ray.

    Args:
        x: The start, in cells from the grid's corner.
        y: The start, likewise.
        dx: The direction; a unit vector.
        dy: The direction, likewise.
        limit: Cells; a cell entered at or beyond it is not crossed.
    """
    column, row = math.floor(x), math.floor(y)
    step_x = 1 if dx > 0 else -1
    step_y = 1 if dy > 0 else -1
    ahead_x = 1 if dx > 0 else 0  # the edge of the present cell that the ray leaves through
    ahead_y = 1 if dy > 0 else 0
    per_column = 1.0 / dx if dx != 0.0 else math.inf
    per_row = 1.0 / dy if dy != 0.0 else math.inf
    leave_x = (column + ahead_x - x) * per_column if dx != 0.0 else math.inf
    leave_y = (row + ahead_y - y) * per_row if dy != 0.0 else math.inf
    entered = 0.0
    while entered < limit:
        yield column, row, entered
        if leave_x <= leave_y:
            entered = leave_x
            column += step_x
            leave_x = (column + ahead_x - x) * per_column
        else:
            entered = leave_y
            row += step_y
            leave_y = (row + ahead_y - y) * per_row
