"""Floor plans drawn as text: cells, walls between them, obstacles, warehouse, boxes (paper, Fig. 1).

Both halves build on them: the symbolic half takes the cells as they are, the simulator builds them in metres.
A world file is a few fields, an empty line, and a drawing in which a cell is three characters wide and a line high::

    wherry-world: 1
    name: tiny
    cell: 0.6

    +---+---+---+
    | >     | o |
    +   +---+   +
    | w      ###|
    +---+---+---+

``---`` and ``|`` are walls between cells, ``###`` an obstacle that fills its cell, ``w`` a cell of the warehouse, ``o`` a
box, one of ``> ^ < v`` the robot and where it looks, and a capital letter names a cell (Taxi's R, G, Y and B).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from pathlib import Path
from types import MappingProxyType
from typing import Self

import numpy as np

from wherry.errors import InputError
from wherry.files import read_text

FORMAT_VERSION = 1
LARGEST_FILE = 4_000_000  # bytes; a plan of 1,000 × 500 cells fits
CELL_COLUMNS = 4  # characters from one cell's wall to the next one's
CELL_ROWS = 2  # lines likewise


@dataclass(frozen=True, slots=True, order=True)
class Cell:
    """A square of the grid.

    Attributes:
        x: Columns from the left edge.
        y: Rows from the bottom edge.
    """

    x: int
    y: int

    def towards(self, direction: Direction) -> Cell:
        """The next cell in a direction."""
        return Cell(self.x + direction.dx, self.y + direction.dy)


class Direction(Enum):
    """The four ways out of a cell, named as on a plan with north at the top."""

    NORTH = (0, 1)
    SOUTH = (0, -1)
    EAST = (1, 0)
    WEST = (-1, 0)

    @property
    def dx(self) -> int:
        """Columns."""
        return self.value[0]

    @property
    def dy(self) -> int:
        """Rows."""
        return self.value[1]

    @property
    def opposite(self) -> Direction:
        """The way back."""
        return Direction((-self.dx, -self.dy))


ARROWS = {">": Direction.EAST, "^": Direction.NORTH, "<": Direction.WEST, "v": Direction.SOUTH}


@dataclass(frozen=True, slots=True, order=True)
class Wall:
    """A wall on one edge of a cell; every inner edge has one name, that of the cell to its south or west.

    Attributes:
        cell: The cell.
        north: Whether it stands on the cell's north edge; otherwise on its east edge.
    """

    cell: Cell
    north: bool

    @classmethod
    def between(cls, cell: Cell, direction: Direction) -> Self:
        """The wall that stops a step from a cell in a direction."""
        if direction in {Direction.NORTH, Direction.EAST}:
            return cls(cell, direction is Direction.NORTH)
        return cls(cell.towards(direction), direction is Direction.SOUTH)


@dataclass(frozen=True)
class FloorPlan:
    """A building as cells.

    Attributes:
        name: What people call it.
        width: Columns.
        height: Rows.
        cell_size: m, a cell's side.
        walls: Inner walls between cells; the plan's outer edge is always walled.
        obstacles: Cells that are filled.
        warehouse: Cells where boxes are to go.
        start: The robot's first cell, if the plan has a robot.
        heading: Where it looks at first.
        boxes: Cells with a box.
        box_count: How many boxes to put at random places where none are drawn.
        marks: Cells with a name.
    """

    name: str
    width: int
    height: int
    cell_size: float = 0.6
    walls: frozenset[Wall] = frozenset()
    obstacles: frozenset[Cell] = frozenset()
    warehouse: frozenset[Cell] = frozenset()
    start: Cell | None = None
    heading: Direction = Direction.EAST
    boxes: tuple[Cell, ...] = ()
    box_count: int = 4
    marks: Mapping[str, Cell] = field(default_factory=lambda: MappingProxyType({}))

    def contains(self, cell: Cell) -> bool:
        """Whether the cell lies on the plan."""
        return 0 <= cell.x < self.width and 0 <= cell.y < self.height

    def is_open(self, cell: Cell) -> bool:
        """Whether the cell lies on the plan and is not filled."""
        return self.contains(cell) and cell not in self.obstacles

    def blocked(self, cell: Cell, direction: Direction) -> bool:
        """Whether the plan's edge, a wall or an obstacle stops a step from a cell in a direction."""
        return not self.is_open(cell.towards(direction)) or Wall.between(cell, direction) in self.walls

    def cells(self) -> Iterator[Cell]:
        """All open cells, row by row from the bottom."""
        every = (Cell(x, y) for y in range(self.height) for x in range(self.width))
        return (cell for cell in every if cell not in self.obstacles)

    def distances(self, origin: Cell, avoid: Iterable[Cell] = ()) -> dict[Cell, int]:
        """Steps from ``origin`` to every cell that can be reached without entering the cells to avoid."""
        avoided = frozenset(avoid)
        steps = {origin: 0}
        queue = deque([origin])
        while queue:
            cell = queue.popleft()
            for direction in Direction:
                neighbour = cell.towards(direction)
                if neighbour not in steps and neighbour not in avoided and not self.blocked(cell, direction):
                    steps[neighbour] = steps[cell] + 1
                    queue.append(neighbour)
        return steps

    def with_boxes(self, boxes: Iterable[Cell]) -> FloorPlan:
        """The same plan with other boxes."""
        return replace(self, boxes=tuple(boxes))


def place_boxes(plan: FloorPlan, count: int, rng: np.random.Generator) -> FloorPlan:
    """Put boxes on random reachable cells: none in the warehouse, at the start, or next to each other.

    Args:
        plan: A plan with a robot; boxes drawn on it are dropped.
        count: How many.
        rng: Where the randomness comes from.

    Raises:
        InputError: There is no room for so many.
    """
    if plan.start is None:
        raise InputError(plan.name, "drawing", "has no robot (one of > ^ < v)")
    taken = set(plan.warehouse) | {plan.start}
    candidates = sorted(set(plan.distances(plan.start)) - taken)
    chosen: list[Cell] = []
    for index in rng.permutation(len(candidates)):
        if len(chosen) == count:
            break
        cell = candidates[index]
        if all(max(abs(cell.x - other.x), abs(cell.y - other.y)) > 1 for other in chosen) and _can_spare(
            plan, (*chosen, cell)
        ):
            chosen.append(cell)
    if len(chosen) < count:
        raise InputError(plan.name, "boxes", f"there is room for {len(chosen)} boxes, not for {count}")
    return plan.with_boxes(chosen)


def _can_spare(plan: FloorPlan, boxes: tuple[Cell, ...]) -> bool:
    """Whether a loaded robot, which cannot pass a box, still gets from every box to the warehouse and to its start."""
    assert plan.start is not None
    for box in boxes:
        reached = plan.distances(box, avoid=set(boxes) - {box})
        if plan.start not in reached or not any(cell in reached for cell in plan.warehouse):
            return False
    return True


def load_world(path: str | Path) -> FloorPlan:
    """Read a world file.

    Raises:
        InputError: The file cannot be read, or is not a world.
    """
    return parse_world(read_text(path, limit=LARGEST_FILE), source=str(path))


def parse_world(text: str, source: str) -> FloorPlan:
    """Read a world from its text; the module's docstring shows one.

    Args:
        text: Fields, an empty line, the drawing. Lines that begin with # before the drawing are comments.
        source: What to call it in errors.

    Raises:
        InputError: The text is not a world; the error names the field, or the drawing's line and column.
    """
    raise NotImplementedError
