"""The walls and obstacles of a floor plan in metres, as a grid whose lines stand where walls begin and end.

Everything that stands fast is made of rectangles with edges on a few lines: at each border between cells one through
the middle of a wall and one at either face. On the grid of these lines every element is all solid or all free, so that
rays, distances and the rectangles for the physics are exact without any resolution.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.floorplan.plan import Cell, Direction, FloorPlan
from wherry.kernels import kernel
from wherry.space.pose import Floats

WALL_THICKNESS = 0.06  # m; walls stand astride the borders of cells
FREE, WALL, OBSTACLE = 0, 1, 2

_LINES = 3  # for each border between cells: a wall's one face, its middle, its other face


@dataclass(frozen=True)
class Solids:
    """What stands fast, in the world frame: cell (x, y)'s centre is at ((x + ½), (y + ½)) × cell size.

    Attributes:
        xs: [C + 1] m, the grid's lines from south to north.
        ys: [R + 1] m, the lines from west to east.
        kinds: [R, C] uint8, FREE, WALL or OBSTACLE; row 0 is the southmost.
    """

    xs: Floats
    ys: Floats
    kinds: NDArray[np.uint8]

    @classmethod
    def of(cls, plan: FloorPlan) -> Solids:
        """Build a floor plan: outer and inner walls, and obstacles that fill their cells from border to border."""
        kinds = np.zeros((_LINES * (plan.height + 1) - 1, _LINES * (plan.width + 1) - 1), dtype=np.uint8)
        for cell in plan.obstacles:
            left, bottom = _LINES * cell.x + 1, _LINES * cell.y + 1
            kinds[bottom : bottom + _LINES, left : left + _LINES] = OBSTACLE
        for wall in plan.walls:
            _build_wall(kinds, wall.cell, Direction.NORTH if wall.north else Direction.EAST)
        kinds[:2], kinds[-2:], kinds[:, :2], kinds[:, -2:] = WALL, WALL, WALL, WALL
        return cls(_lines(plan.width, plan.cell_size), _lines(plan.height, plan.cell_size), kinds)

    def rectangles(self, kind: int) -> Floats:
        """Cover everything of one kind by a few rectangles, which may overlap.

        Returns:
            [K, 4] m, world frame: left, bottom, right, top.
        """
        wanted = self.kinds == kind
        left = wanted.copy()
        found = []
        while left.any():
            row, column = np.unravel_index(np.argmax(left), left.shape)
            candidates = (_grow(wanted, int(row), int(column)), _grow(wanted.T, int(column), int(row))[::-1])
            rows, columns = max(candidates, key=lambda candidate: np.count_nonzero(left[candidate]))
            left[rows, columns] = False
            found.append((self.xs[columns.start], self.ys[rows.start], self.xs[columns.stop], self.ys[rows.stop]))
        return np.array(found, dtype=np.float64).reshape(-1, 4)

    def surfaces(self) -> Floats:
        """The faces that can be seen from free space.

        Returns:
            [S, 4] m, world frame: left, bottom, right, top of each; one side is 0.
        """
        solid = self.kinds != FREE
        upright = [(self.xs[x], y0, self.xs[x], y1) for x, y0, y1 in _faces(solid, self.ys)]
        level = [(x0, self.ys[y], x1, self.ys[y]) for y, x0, x1 in _faces(solid.T, self.xs)]
        return np.array(upright + level, dtype=np.float64).reshape(-1, 4)


def clearance(solids: Solids, points: Floats) -> Floats:
    """How far points are from anything solid, 0 inside it and outside the building.

    Args:
        solids: The walls and obstacles.
        points: [N, 2] m, world frame.

    Returns:
        [N] m.
    """
    distances = distances_to(np.vstack([solids.rectangles(WALL), solids.rectangles(OBSTACLE)]), points)
    outside = ((points < (solids.xs[0], solids.ys[0])) | (points > (solids.xs[-1], solids.ys[-1]))).any(axis=1)
    distances[outside] = 0.0
    return distances


def distances_to(rectangles: Floats, points: Floats) -> Floats:
    """How far points are from the nearest rectangle, 0 inside.

    Args:
        rectangles: [K, 4] m, left, bottom, right, top.
        points: [N, 2] m.

    Returns:
        [N] m.
    """
    return _distances_to(rectangles, np.ascontiguousarray(points, dtype=np.float64))


@kernel
def _distances_to(rectangles: Floats, points: Floats) -> Floats:
    """As `distances_to`."""
    distances = np.empty(len(points))
    for n in range(len(points)):
        x, y = points[n, 0], points[n, 1]
        nearest = np.inf
        for k in range(len(rectangles)):
            dx = max(rectangles[k, 0] - x, 0.0, x - rectangles[k, 2])
            dy = max(rectangles[k, 1] - y, 0.0, y - rectangles[k, 3])
            nearest = min(nearest, dx * dx + dy * dy)
        distances[n] = np.sqrt(nearest)
    return distances


def _lines(cells: int, size: float) -> Floats:
    """[3 * (cells + 1)] m: the faces and the middle of a wall at every border."""
    borders = size * np.arange(cells + 1)
    return (borders[:, None] + WALL_THICKNESS / 2 * np.array([-1.0, 0.0, 1.0])).ravel()


def _build_wall(kinds: NDArray[np.uint8], cell: Cell, direction: Direction) -> None:
    """Fill in the wall on a cell's edge, with half a wall's thickness beyond both its ends."""
    column, row = _LINES * (cell.x + direction.dx), _LINES * (cell.y + direction.dy)
    across, along = 2, _LINES + 2
    rows, columns = (across, along) if direction.dy else (along, across)
    kinds[row : row + rows, column : column + columns] = WALL


def _grow(wanted: NDArray[np.bool_], row: int, column: int) -> tuple[slice, slice]:
    """The rows and columns of a rectangle of wanted elements around one: as wide as can be, then as high."""
    first, last = column, column + 1
    while first > 0 and wanted[row, first - 1]:
        first -= 1
    while last < wanted.shape[1] and wanted[row, last]:
        last += 1
    bottom, top = row, row + 1
    while bottom > 0 and wanted[bottom - 1, first:last].all():
        bottom -= 1
    while top < wanted.shape[0] and wanted[top, first:last].all():
        top += 1
    return slice(bottom, top), slice(first, last)


def _faces(solid: NDArray[np.bool_], lines: Floats) -> list[tuple[int, float, float]]:
    """The runs of faces between neighbouring columns of which one is solid: line's index, start, end."""
    borders = solid[:, 1:] != solid[:, :-1]
    faces = []
    for column in range(borders.shape[1]):
        edges = np.flatnonzero(np.diff(borders[:, column].astype(np.int8), prepend=0, append=0))
        faces += [(column + 1, lines[start], lines[end]) for start, end in edges.reshape(-1, 2)]
    return faces
