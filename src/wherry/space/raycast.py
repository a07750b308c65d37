"""Ray casting in grids, cell by cell (Amanatides & Woo 1987)."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import generator_kernel, kernel
from wherry.space.pose import Floats, Pose


def cast_rays(
    blocked: NDArray[np.bool_],
    resolution: float,
    origin: Pose,
    poses: Floats,
    angles: Floats,
    range_max: float,
) -> Floats:
    """Distances at which rays enter the first blocked cell.

    Args:
        blocked: Cells that stop a ray, [H, W]; cells outside of the grid do not.
        resolution: Side of a cell, m.
        origin: Pose of the outer corner of cell [0, 0] in the map frame.
        poses: Poses of lidars in the map frame, [N, 3] m, m, rad.
        angles: Directions of the beams in the lidar frame, [R] rad.
        range_max: Length at which rays end, m.

    Returns:
        Distances, [N, R] m; infinite where no blocked cell was met, 0 where the ray starts in one.
    """
    starts = origin.inverse.transform(np.asarray(poses, dtype=np.float64)[:, :2]) / resolution
    directions = np.asarray(poses, dtype=np.float64)[:, 2:3] - origin.theta + angles[None, :]
    return _cast_rays(blocked, starts, directions, range_max / resolution) * resolution


@kernel
def _cast_rays(blocked: NDArray[np.bool_], starts: Floats, directions: Floats, limit: float) -> Floats:
    """As `cast_rays`, in cells from the grid's corner: starts [N, 2], directions [N, R] rad."""
    lengths = np.empty(directions.shape)
    for n in range(directions.shape[0]):
        for r in range(directions.shape[1]):
            angle = directions[n, r]
            lengths[n, r] = ray_length(blocked, starts[n, 0], starts[n, 1], math.cos(angle), math.sin(angle), limit)
    return lengths


@kernel
def ray_length(blocked: NDArray[np.bool_], x: float, y: float, dx: float, dy: float, limit: float) -> float:
    """Length of a ray up to the first blocked cell, in cells; infinite if it reaches the limit.

    Args:
        blocked: Cells that stop the ray, [H, W].
        x: Start in x, in cells from the grid's corner.
        y: Start in y, in cells from the grid's corner.
        dx: x component of the direction, a unit vector.
        dy: y component of the direction.
        limit: Length at which the ray ends, cells.
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
            break  # the ray moves away from the grid
    return math.inf


@generator_kernel
def traverse(x: float, y: float, dx: float, dy: float, limit: float) -> Iterator[tuple[int, int, float]]:
    """Yield the cells that a ray crosses in order: column, row, and the length at which the ray enters the cell.

    Lengths are computed from the cell's column and row each time, so that rounding errors do not accumulate.

    Args:
        x: Start in x, in cells from the grid's corner.
        y: Start in y, in cells from the grid's corner.
        dx: x component of the direction, a unit vector.
        dy: y component of the direction.
        limit: Length before which a cell must be entered to count, cells.
    """
    column, row = math.floor(x), math.floor(y)
    step_x = 1 if dx > 0 else -1
    step_y = 1 if dy > 0 else -1
    edge_x = 1 if dx > 0 else 0  # offset of the edge through which the ray leaves a cell
    edge_y = 1 if dy > 0 else 0
    per_column = 1.0 / dx if dx != 0.0 else math.inf
    per_row = 1.0 / dy if dy != 0.0 else math.inf
    leave_x = (column + edge_x - x) * per_column if dx != 0.0 else math.inf
    leave_y = (row + edge_y - y) * per_row if dy != 0.0 else math.inf
    entered = 0.0
    while entered < limit:
        yield column, row, entered
        if leave_x <= leave_y:
            entered = leave_x
            column += step_x
            leave_x = (column + edge_x - x) * per_column
        else:
            entered = leave_y
            row += step_y
            leave_y = (row + edge_y - y) * per_row
