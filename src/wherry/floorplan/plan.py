"""Floor plans: a building as cells, walls between them, obstacles, warehouse, boxes (paper, Fig. 1).

Both halves build on them: the symbolic half takes the cells as they are, the simulator builds them in metres.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from string import ascii_uppercase
from typing import Self

from wherry.errors import InputError

LONGEST_SIDE = 1_000  # cells
SMALLEST_CELL, LARGEST_CELL = 0.5, 5.0  # m; the robot is 0.4 m wide and drives through doorways of one cell
MOST_BOXES = 1_000
DEFAULT_CELL_SIZE = 0.6  # m
DEFAULT_BOX_COUNT = 4


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

    Making one checks it: everything lies on the plan, nothing stands in an obstacle, no cell has two boxes.

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
        marks: Cells with a name, a capital letter.

    Raises:
        InputError: Two things stand where only one can, one lies outside, or a size or a count makes no sense.
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
        self._check_places()
        if len(set(self.boxes)) < len(self.boxes):
            raise InputError(self.name, "box", "two boxes stand in the same cell")
        if occupied := set(self.boxes) & (self.warehouse | {self.start}):
            place = "where the robot starts" if self.start in occupied else "in the warehouse already"
            raise InputError(self.name, "box", f"a box stands {place}")
        if len(set(self.marks.values())) < len(self.marks) or not set(self.marks) <= set(ascii_uppercase):
            raise InputError(self.name, "mark", "marks are capital letters, one for a cell and one cell for each")

    def _check_sizes(self) -> None:
        """Refuse a name, sizes and counts that make no sense."""
        if not 1 <= len(self.name) <= 60 or self.name != self.name.strip() or not self.name.isprintable():
            raise InputError(self.name, "name", "must be 1 to 60 characters on one line")
        for name, cells in (("width", self.width), ("height", self.height)):
            if not 1 <= cells <= LONGEST_SIDE:
                raise InputError(self.name, name, f"must be 1 to {LONGEST_SIDE:,} cells, not {cells:,}")
        if not SMALLEST_CELL <= self.cell_size <= LARGEST_CELL:
            raise InputError(self.name, "cell", f"must be {SMALLEST_CELL} to {LARGEST_CELL} m, not {self.cell_size:g}")
        if not 0 <= self.box_count <= MOST_BOXES:
            raise InputError(self.name, "boxes", f"must be 0 to {MOST_BOXES:,}, not {self.box_count:,}")

    def _check_places(self) -> None:
        """Refuse things outside the plan and things inside obstacles."""
        robot = [] if self.start is None else [self.start]
        things = {"warehouse": self.warehouse, "box": self.boxes, "mark": self.marks.values(), "robot": robot}
        for thing, cells in {"obstacle": self.obstacles, **things}.items():
            for cell in cells:
                if not self.contains(cell):
                    raise InputError(self.name, thing, f"({cell.x}, {cell.y}) lies outside the plan")
                if thing != "obstacle" and cell in self.obstacles:
                    raise InputError(self.name, thing, f"({cell.x}, {cell.y}) is inside an obstacle")
        for wall in self.walls:
            beyond = wall.cell.towards(Direction.NORTH if wall.north else Direction.EAST)
            if not (self.contains(wall.cell) and self.contains(beyond)):
                raise InputError(self.name, "wall", f"of ({wall.cell.x}, {wall.cell.y}) is not between two cells")

    def centre(self, cell: Cell) -> tuple[float, float]:
        """Centre of a cell, m, from the plan's lower left corner."""
        return (cell.x + 0.5) * self.cell_size, (cell.y + 0.5) * self.cell_size

    def cell_at(self, x: float, y: float) -> Cell:
        """The cell that contains a position, m, from the plan's lower left corner; it may be outside of the plan."""
        return Cell(int(x // self.cell_size), int(y // self.cell_size))

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

    def is_connected(self) -> bool:
        """Whether a way leads from every open cell to every other."""
        cells = set(self.cells())
        return cells == self.reach(list(cells)[:1], lambda cell, neighbour: True)

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

    def is_passable(self, boxes: set[Cell]) -> bool:
        """Whether the robot gets from its start to all boxes and the warehouse without passing through a box."""
        if self.start is None:
            return False
        reached = self.reach({self.start}, lambda cell, neighbour: cell not in boxes)
        return boxes <= reached and not self.warehouse.isdisjoint(reached)

    def reachable_boxes(self) -> tuple[Cell, ...]:
        """The boxes that the robot can deliver, in some order, to the warehouse; none without robot or warehouse.

        A robot with a full fork cannot enter a box's cell; one with an empty fork can, but then its fork is full. So
        boxes may have to go in order, and one in a dead end may wait behind another. Since no delivery ever bars the
        way to a box, taking whatever can be taken now, again and again, finds them all.
        """
        left = set(self.boxes)
        while taken := self._deliverable(left):
            left -= taken
        return tuple(box for box in self.boxes if box not in left)

    def unreachable_boxes(self) -> tuple[Cell, ...]:
        """The boxes that the robot can never deliver."""
        reachable = set(self.reachable_boxes())
        return tuple(box for box in self.boxes if box not in reachable)

    def _deliverable(self, boxes: set[Cell]) -> set[Cell]:
        """The boxes that the robot can deliver while all the others stand where they are."""
        if self.start is None:
            return set()
        empty = self.reach({self.start}, lambda cell, neighbour: not (cell in boxes and neighbour in boxes))
        loaded = self.reach(self.warehouse & empty, lambda cell, neighbour: cell not in boxes)
        return boxes & empty & loaded

    def reach(self, origins: Iterable[Cell], may_step: Callable[[Cell, Cell], bool]) -> set[Cell]:
        """The cells that can be reached from the origins by steps that nothing stops and that are allowed.

        Args:
            origins: Cells to begin from.
            may_step: Whether a step is allowed, given its first cell and its last.
        """
        reached = set(origins)
        frontier = list(reached)
        while frontier:
            cell = frontier.pop()
            for direction in Direction:
                neighbour = cell.towards(direction)
                if neighbour not in reached and not self.blocked(cell, direction) and may_step(cell, neighbour):
                    reached.add(neighbour)
                    frontier.append(neighbour)
        return reached

    def with_boxes(self, boxes: Iterable[Cell]) -> FloorPlan:
        """The same plan with other boxes."""
        return replace(self, boxes=tuple(boxes))
