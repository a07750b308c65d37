"""Floor plans: a building as cells, with walls between them, obstacles, a warehouse and boxes (paper, Fig. 1).

The symbolic half uses the cells as they are; the simulator builds them in metres.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from string import ascii_uppercase
from typing import Self

from wherry.errors import InputError

MAX_SIDE = 1_000  # cells along a plan's side
MIN_CELL_SIZE, MAX_CELL_SIZE = 0.5, 5.0  # m; the robot is 0.4 m wide and drives through doorways of one cell
MAX_BOXES = 1_000  # in one plan
DEFAULT_CELL_SIZE = 0.6  # m
DEFAULT_BOX_COUNT = 4  # boxes at random cells, unless a plan states its number


@dataclass(frozen=True, slots=True, order=True)
class Cell:
    """A square of the grid.

    Attributes:
        x: Columns from the left edge.
        y: Rows from the bottom edge.
    """

    x: int
    y: int

    def neighbour(self, direction: Direction) -> Cell:
        """The adjacent cell in a direction."""
        return Cell(self.x + direction.dx, self.y + direction.dy)


class Direction(Enum):
    """The four directions of a step, named as on a plan with north at the top."""

    NORTH = (0, 1)
    SOUTH = (0, -1)
    EAST = (1, 0)
    WEST = (-1, 0)

    @property
    def dx(self) -> int:
        """Change of the column."""
        return self.value[0]

    @property
    def dy(self) -> int:
        """Change of the row."""
        return self.value[1]

    @property
    def opposite(self) -> Direction:
        """The opposite direction."""
        return Direction((-self.dx, -self.dy))


@dataclass(frozen=True, slots=True, order=True)
class Wall:
    """A wall on the edge between two cells, identified by the southern or western one of them.

    Attributes:
        cell: The cell south of a wall on a north edge, or west of a wall on an east edge.
        north: Whether the wall is on the cell's north edge; otherwise it is on the east edge.
    """

    cell: Cell
    north: bool

    @classmethod
    def between(cls, cell: Cell, direction: Direction) -> Self:
        """The wall on the edge that a step from a cell in a direction would cross."""
        if direction in {Direction.NORTH, Direction.EAST}:
            return cls(cell, direction is Direction.NORTH)
        return cls(cell.neighbour(direction), direction is Direction.SOUTH)


@dataclass(frozen=True)
class FloorPlan:
    """A building as cells.

    Attributes:
        name: Its name.
        width: Number of columns.
        height: Number of rows.
        cell_size: Side of a cell, m.
        walls: Inner walls between cells; the outer edge is always walled.
        obstacles: Cells that an obstacle fills.
        warehouse: Cells to deliver boxes to.
        start: The robot's initial cell; None for a plan without robot.
        heading: The robot's initial heading.
        boxes: Cells that contain a box.
        box_count: Number of boxes to place at random cells if ``boxes`` is empty.
        marks: Named cells by name, a capital letter.

    Raises:
        InputError: Something lies outside the plan or inside an obstacle, a cell is occupied twice, or a size or count
            is out of range.
    """

    name: str
    width: int
    height: int
    cell_size: float = DEFAULT_CELL_SIZE
    walls: frozenset[Wall] = frozenset()
    obstacles: frozenset[Cell] = frozenset()
    warehouse: frozenset[Cell] = frozenset()
    start: Cell | None = None
    heading: Direction = Direction.EAST
    boxes: tuple[Cell, ...] = ()
    box_count: int = DEFAULT_BOX_COUNT
    marks: Mapping[str, Cell] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        self._check_sizes()
        self._check_contents()
        if len(set(self.boxes)) < len(self.boxes):
            raise InputError(self.name, "box", "two boxes stand in the same cell")
        if occupied := set(self.boxes) & (self.warehouse | {self.start}):
            place = "where the robot starts" if self.start in occupied else "in the warehouse already"
            raise InputError(self.name, "box", f"a box stands {place}")
        if len(set(self.marks.values())) < len(self.marks) or not set(self.marks) <= set(ascii_uppercase):
            raise InputError(self.name, "mark", "marks must be capital letters, at most one in a cell")

    def _check_sizes(self) -> None:
        """Raise an error if the name, a size or a count is out of range."""
        if not 1 <= len(self.name) <= 60 or self.name != self.name.strip() or not self.name.isprintable():
            raise InputError(self.name, "name", "must be 1 to 60 characters on one line")
        for name, cells in (("width", self.width), ("height", self.height)):
            if not 1 <= cells <= MAX_SIDE:
                raise InputError(self.name, name, f"must be 1 to {MAX_SIDE:,} cells, not {cells:,}")
        if not MIN_CELL_SIZE <= self.cell_size <= MAX_CELL_SIZE:
            raise InputError(self.name, "cell", f"must be {MIN_CELL_SIZE} to {MAX_CELL_SIZE} m, not {self.cell_size:g}")
        if not 0 <= self.box_count <= MAX_BOXES:
            raise InputError(self.name, "boxes", f"must be 0 to {MAX_BOXES:,}, not {self.box_count:,}")

    def _check_contents(self) -> None:
        """Raise an error if anything lies outside the plan or inside an obstacle."""
        robot = [] if self.start is None else [self.start]
        contents = {"warehouse": self.warehouse, "box": self.boxes, "mark": self.marks.values(), "robot": robot}
        for name, cells in {"obstacle": self.obstacles, **contents}.items():
            for cell in cells:
                if not self.contains(cell):
                    raise InputError(self.name, name, f"({cell.x}, {cell.y}) lies outside the plan")
                if name != "obstacle" and cell in self.obstacles:
                    raise InputError(self.name, name, f"({cell.x}, {cell.y}) is inside an obstacle")
        for wall in self.walls:
            beyond = wall.cell.neighbour(Direction.NORTH if wall.north else Direction.EAST)
            if not (self.contains(wall.cell) and self.contains(beyond)):
                raise InputError(self.name, "wall", f"of ({wall.cell.x}, {wall.cell.y}) is not between two cells")

    def centre(self, cell: Cell) -> tuple[float, float]:
        """Centre (x, y) of a cell, m, from the plan's lower left corner."""
        return (cell.x + 0.5) * self.cell_size, (cell.y + 0.5) * self.cell_size

    def cell_at(self, x: float, y: float) -> Cell:
        """The cell that contains a position, m, from the plan's lower left corner; it may be outside of the plan."""
        return Cell(int(x // self.cell_size), int(y // self.cell_size))

    def contains(self, cell: Cell) -> bool:
        """Whether the cell lies on the plan."""
        return 0 <= cell.x < self.width and 0 <= cell.y < self.height

    def is_open(self, cell: Cell) -> bool:
        """Whether the cell lies on the plan and is not an obstacle."""
        return self.contains(cell) and cell not in self.obstacles

    def is_blocked(self, cell: Cell, direction: Direction) -> bool:
        """Whether the outer edge, a wall or an obstacle blocks a step from a cell in a direction."""
        return not self.is_open(cell.neighbour(direction)) or Wall.between(cell, direction) in self.walls

    def cells(self) -> Iterator[Cell]:
        """All open cells, row by row from the bottom."""
        all_cells = (Cell(x, y) for y in range(self.height) for x in range(self.width))
        return (cell for cell in all_cells if cell not in self.obstacles)

    def is_connected(self) -> bool:
        """Whether every open cell can be reached from every other."""
        cells = set(self.cells())
        return cells == self.reachable_from(list(cells)[:1], lambda cell, neighbour: True)

    def distances(self, origin: Cell, avoid: Iterable[Cell] = ()) -> dict[Cell, int]:
        """Number of steps from a cell to every cell that can be reached without entering the cells in ``avoid``."""
        avoided = frozenset(avoid)
        steps = {origin: 0}
        queue = deque([origin])
        while queue:
            cell = queue.popleft()
            for direction in Direction:
                neighbour = cell.neighbour(direction)
                if neighbour not in steps and neighbour not in avoided and not self.is_blocked(cell, direction):
                    steps[neighbour] = steps[cell] + 1
                    queue.append(neighbour)
        return steps

    def is_passable(self, boxes: set[Cell]) -> bool:
        """Whether the robot can reach all boxes and the warehouse without passing through a box."""
        if self.start is None:
            return False
        reached = self.reachable_from({self.start}, lambda cell, neighbour: cell not in boxes)
        return boxes <= reached and not self.warehouse.isdisjoint(reached)

    def reachable_boxes(self) -> tuple[Cell, ...]:
        """The boxes that the robot can deliver, in a suitable order; none without robot or warehouse.

        A robot with a full fork cannot enter a box's cell, and a box whose cell the robot enters is in the fork. So
        boxes may have to be delivered in order. A delivery never blocks the path to another box; hence repeatedly
        removing all boxes that can be delivered now finds them all.
        """
        remaining = set(self.boxes)
        while deliverable := self._deliverable(remaining):
            remaining -= deliverable
        return tuple(box for box in self.boxes if box not in remaining)

    def unreachable_boxes(self) -> tuple[Cell, ...]:
        """The boxes that the robot can never deliver."""
        reachable = set(self.reachable_boxes())
        return tuple(box for box in self.boxes if box not in reachable)

    def _deliverable(self, boxes: set[Cell]) -> set[Cell]:
        """The boxes that the robot can deliver while all other boxes stay in place."""
        if self.start is None:
            return set()
        reached_empty = self.reachable_from(
            {self.start}, lambda cell, neighbour: not (cell in boxes and neighbour in boxes)
        )
        reached_loaded = self.reachable_from(self.warehouse & reached_empty, lambda cell, neighbour: cell not in boxes)
        return boxes & reached_empty & reached_loaded

    def reachable_from(self, origins: Iterable[Cell], may_step: Callable[[Cell, Cell], bool]) -> set[Cell]:
        """The cells that can be reached by allowed steps that nothing blocks.

        Args:
            origins: The cells to start from.
            may_step: Returns whether a step is allowed, given the cells before and after it.
        """
        reached = set(origins)
        open_list = list(reached)
        while open_list:
            cell = open_list.pop()
            for direction in Direction:
                neighbour = cell.neighbour(direction)
                if neighbour not in reached and not self.is_blocked(cell, direction) and may_step(cell, neighbour):
                    reached.add(neighbour)
                    open_list.append(neighbour)
        return reached

    def with_boxes(self, boxes: Iterable[Cell]) -> FloorPlan:
        """A copy with other boxes."""
        return replace(self, boxes=tuple(boxes))
