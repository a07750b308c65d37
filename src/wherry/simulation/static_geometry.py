"""The walls and obstacles of a floor plan as an exact rectilinear grid, whose lines are unevenly spaced.

At each border between cells there are three grid lines: one through the middle of a wall and one along each of its
faces. Every element between the lines is therefore entirely solid or entirely free, and rays, distances and the cuboids
of the physics are exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.floorplan.plan import Cell, Direction, FloorPlan
from wherry.kernels import kernel
from wherry.space.pose import Floats

WALL_THICKNESS = 0.06  # m; a wall is centred on the border between two cells
FREE, WALL, OBSTACLE = 0, 1, 2  # values of `StaticGeometry.kinds`; plain integers, since compiled kernels read them

LINES_PER_BORDER = 3  # grid lines at each border between cells


@dataclass(frozen=True)
class StaticGeometry:
    """The walls and obstacles in the world frame, in which cell (x, y) is centred at ((x + ½), (y + ½)) × cell size.

    Attributes:
        xs: [C + 1] positions of the grid lines that run from south to north, m.
        ys: [R + 1] positions of the grid lines that run from west to east, m.
        kinds: [R, C] kind of each element, FREE, WALL or OBSTACLE; row 0 is the southernmost.
    """

    xs: Floats
    ys: Floats
    kinds: NDArray[np.uint8]

    @classmethod
    def from_plan(cls, plan: FloorPlan) -> StaticGeometry:
        """Build the outer and inner walls of a plan, and obstacles that fill their cells from border to border."""
        kinds = np.zeros(
            (LINES_PER_BORDER * (plan.height + 1) - 1, LINES_PER_BORDER * (plan.width + 1) - 1), dtype=np.uint8
        )
        for cell in plan.obstacles:
            left, bottom = LINES_PER_BORDER * cell.x + 1, LINES_PER_BORDER * cell.y + 1
            kinds[bottom : bottom + LINES_PER_BORDER, left : left + LINES_PER_BORDER] = OBSTACLE
        for wall in plan.walls:
            _build_wall(kinds, wall.cell, Direction.NORTH if wall.north else Direction.EAST)
        kinds[:2], kinds[-2:], kinds[:, :2], kinds[:, -2:] = WALL, WALL, WALL, WALL
        return cls(_lines(plan.width, plan.cell_size), _lines(plan.height, plan.cell_size), kinds)

    def rectangles(self, kind: int) -> Floats:
        """Cover all elements of one kind greedily by few rectangles, which may overlap.

        Args:
            kind: WALL or OBSTACLE.

        Returns:
            [K, 4] left, bottom, right, top, m, world frame.
        """
        is_kind = self.kinds == kind
        uncovered = is_kind.copy()
        found = []
        while uncovered.any():
            row, column = np.unravel_index(np.argmax(uncovered), uncovered.shape)
            candidates = (
                _rectangle_around(is_kind, int(row), int(column)),
                _rectangle_around(is_kind.T, int(column), int(row))[::-1],
            )
            rows, columns = max(candidates, key=lambda candidate: np.count_nonzero(uncovered[candidate]))
            uncovered[rows, columns] = False
            found.append((self.xs[columns.start], self.ys[rows.start], self.xs[columns.stop], self.ys[rows.stop]))
        return np.array(found, dtype=np.float64).reshape(-1, 4)

    def surfaces(self) -> Floats:
        """The faces that are visible from free space.

        Returns:
            [S, 4] left, bottom, right, top of each face, m, world frame; its width or its height is 0.
        """
        solid = self.kinds != FREE
        vertical = [(self.xs[x], y0, self.xs[x], y1) for x, y0, y1 in _faces(solid, self.ys)]
        horizontal = [(x0, self.ys[y], x1, self.ys[y]) for y, x0, x1 in _faces(solid.T, self.xs)]
        return np.array(vertical + horizontal, dtype=np.float64).reshape(-1, 4)


def clearance(geometry: StaticGeometry, points: Floats) -> Floats:
    """Distances from points to the nearest wall or obstacle; 0 inside one and outside the building.

    Args:
        geometry: The walls and obstacles.
        points: [N, 2] m, world frame.

    Returns:
        [N] distances, m.
    """
    distances = distances_to_rectangles(np.vstack([geometry.rectangles(WALL), geometry.rectangles(OBSTACLE)]), points)
    outside = ((points < (geometry.xs[0], geometry.ys[0])) | (points > (geometry.xs[-1], geometry.ys[-1]))).any(axis=1)
    distances[outside] = 0.0
    return distances


def distances_to_rectangles(rectangles: Floats, points: Floats) -> Floats:
    """Distances from points to the nearest rectangle; 0 inside one.

    Args:
        rectangles: [K, 4] left, bottom, right, top, m.
        points: [N, 2] m.

    Returns:
        [N] distances, m.
    """
    return _distances_to_rectangles(rectangles, np.ascontiguousarray(points, dtype=np.float64))


@kernel
def _distances_to_rectangles(rectangles: Floats, points: Floats) -> Floats:
    """As `distances_to_rectangles`."""
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
    """[3 * (cells + 1)] positions of the grid lines along one axis, m."""
    borders = size * np.arange(cells + 1)
    return (borders[:, None] + WALL_THICKNESS / 2 * np.array([-1.0, 0.0, 1.0])).ravel()


def _build_wall(kinds: NDArray[np.uint8], cell: Cell, direction: Direction) -> None:
    """Mark the elements of a wall on a cell's edge; it extends half its thickness beyond both of its ends."""
    column, row = LINES_PER_BORDER * (cell.x + direction.dx), LINES_PER_BORDER * (cell.y + direction.dy)
    across, along = 2, LINES_PER_BORDER + 2
    rows, columns = (across, along) if direction.dy else (along, across)
    kinds[row : row + rows, column : column + columns] = WALL


def _rectangle_around(is_kind: NDArray[np.bool_], row: int, column: int) -> tuple[slice, slice]:
    """Rows and columns of the rectangle of True elements around one of them: as wide, and then as high, as possible."""
    first, last = column, column + 1
    while first > 0 and is_kind[row, first - 1]:
        first -= 1
    while last < is_kind.shape[1] and is_kind[row, last]:
        last += 1
    bottom, top = row, row + 1
    while bottom > 0 and is_kind[bottom - 1, first:last].all():
        bottom -= 1
    while top < is_kind.shape[0] and is_kind[top, first:last].all():
        top += 1
    return slice(bottom, top), slice(first, last)


def _faces(solid: NDArray[np.bool_], lines: Floats) -> list[tuple[int, float, float]]:
    """Faces between solid and free elements of neighbouring columns: index of the grid line, start, m, and end, m."""
    borders = solid[:, 1:] != solid[:, :-1]
    faces = []
    for column in range(borders.shape[1]):
        edges = np.flatnonzero(np.diff(borders[:, column].astype(np.int8), prepend=0, append=0))
        faces += [(column + 1, lines[start], lines[end]) for start, end in edges.reshape(-1, 2)]
    return faces
