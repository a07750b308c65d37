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

``---`` and ``|`` are walls between cells, ``###`` an obstacle that fills its cell, ``w`` a cell of the warehouse, ``o``
a box, one of ``> ^ < v`` the robot and where it looks, and a capital letter names a cell (Taxi's R, G, Y and B). The
field ``boxes`` says how many boxes to put at random places where none are drawn. Lines that begin with ``#`` above the
drawing are comments.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from importlib import resources
from pathlib import Path
from string import ascii_uppercase
from typing import Self

import numpy as np

from wherry.errors import InputError
from wherry.files import read_text

FORMAT_VERSION = 1
LARGEST_FILE = 4_000_000  # bytes; a plan of 1,000 × 500 cells fits
CELL_COLUMNS = 4  # characters from one cell's wall to the next one's
CELL_ROWS = 2  # lines likewise
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


FIELDS: Mapping[str, Callable[[str], object]] = {"wherry-world": str, "name": str, "cell": float, "boxes": int}
THINGS = {"#": "an obstacle", "w": "the warehouse", "o": "a box", **dict.fromkeys(">^<v", "the robot")}
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


def place_boxes(plan: FloorPlan, count: int, rng: np.random.Generator) -> FloorPlan:
    """Put boxes on random cells: none in the warehouse, at the start, next to each other, or in the only way.

    Args:
        plan: A plan with a robot; boxes drawn on it are dropped.
        count: How many.
        rng: Where the randomness comes from.

    Raises:
        InputError: The count is negative, or there is no room for so many.
    """
    if count < 0:
        raise InputError(plan.name, "boxes", f"must be 0 or more, not {count}")
    if plan.start is None:
        raise InputError(plan.name, "drawing", "has no robot (one of > ^ < v)")
    taken = set(plan.warehouse) | {plan.start}
    candidates = sorted(set(plan.distances(plan.start)) - taken)
    chosen: set[Cell] = set()
    for index in rng.permutation(len(candidates)):
        if len(chosen) == count:
            break
        cell = candidates[index]
        if not chosen & set(_around(cell)) and plan.is_passable(chosen | {cell}):
            chosen.add(cell)
    if len(chosen) < count:
        raise InputError(plan.name, "boxes", f"there is room for {len(chosen)} boxes, not for {count}")
    return plan.with_boxes(sorted(chosen, key=lambda cell: (cell.y, cell.x)))


def _around(cell: Cell) -> list[Cell]:
    """The eight cells around one."""
    return [Cell(cell.x + dx, cell.y + dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1) if dx or dy]


def generate_world(
    width: int,
    height: int,
    rng: np.random.Generator,
    *,
    name: str = "generated",
    box_count: int = DEFAULT_BOX_COUNT,
    smallest_room: int = 3,
    obstacle_share: float = 0.03,
) -> FloorPlan:
    """Draw up random rooms with doorways, obstacles, a warehouse and a robot; all open cells are connected.

    A wall with a doorway cuts the plan in two, and so on for each part (recursive division), until the parts are rooms.

    Args:
        width: Cells.
        height: Cells.
        rng: Where the randomness comes from.
        name: What to call the world.
        box_count: How many boxes are to be placed.
        smallest_room: Cells along a room's shorter side, at least.
        obstacle_share: How much of the floor to fill.

    Raises:
        InputError: The sizes or counts make no sense.
    """
    if not 0 <= obstacle_share <= 0.2:
        raise InputError(name, "obstacle share", f"must be 0 to 0.2, not {obstacle_share}")
    if smallest_room < 1 or width < 3 or height < 3:
        raise InputError(name, "size", "must be at least 3 × 3 cells, with rooms of one cell or more")
    walls = frozenset(_divide(_Rectangle(0, 0, width, height), smallest_room, rng))
    corner = Cell(int(rng.choice([0, width - 2])), int(rng.choice([0, height - 2])))
    warehouse = frozenset(Cell(corner.x + dx, corner.y + dy) for dx in range(2) for dy in range(2))
    floor = FloorPlan(
        name, width, height, walls=walls - _inner_walls(warehouse), warehouse=warehouse, box_count=box_count
    )
    cells = [cell for cell in floor.cells() if cell not in warehouse]
    shuffled = [cells[index] for index in rng.permutation(len(cells))]
    start, heading = shuffled.pop(), list(Direction)[rng.integers(len(Direction))]
    obstacles: set[Cell] = set()
    for cell in shuffled:
        if len(obstacles) < round(obstacle_share * len(cells)) and not obstacles & set(_around(cell)):
            obstacles |= {cell} if _can_be_filled(floor, cell) else set()
    return replace(floor, start=start, heading=heading, obstacles=frozenset(obstacles))


def _can_be_filled(plan: FloorPlan, cell: Cell) -> bool:
    """Whether the ways through a cell can go round it through the eight cells around it."""
    ways = [cell.towards(direction) for direction in Direction if not plan.blocked(cell, direction)]
    around = set(_around(cell))
    return set(ways) <= plan.reach(ways[:1], lambda _, neighbour: neighbour in around)


@dataclass(frozen=True, slots=True)
class _Rectangle:
    """Cells from ``left`` and ``bottom`` on."""

    left: int
    bottom: int
    width: int
    height: int


def _divide(area: _Rectangle, smallest: int, rng: np.random.Generator) -> Iterator[Wall]:
    """The walls that cut an area into rooms, each with a doorway of one or two cells."""
    if max(area.width, area.height) < 2 * smallest + 1:
        return
    upright = area.width > area.height if area.width != area.height else bool(rng.integers(2))
    side, length = (area.width, area.height) if upright else (area.height, area.width)
    cut = int(rng.integers(smallest, side - smallest + 1))
    door_width = min(length, int(rng.integers(1, 3)))
    door = int(rng.integers(length - door_width + 1))
    for step in range(length):
        if not door <= step < door + door_width:
            dx, dy = (cut - 1, step) if upright else (step, cut - 1)
            yield Wall(Cell(area.left + dx, area.bottom + dy), north=not upright)
    if upright:
        parts = replace(area, width=cut), replace(area, left=area.left + cut, width=area.width - cut)
    else:
        parts = replace(area, height=cut), replace(area, bottom=area.bottom + cut, height=area.height - cut)
    for part in parts:
        yield from _divide(part, smallest, rng)


def _inner_walls(cells: frozenset[Cell]) -> frozenset[Wall]:
    """The edges between neighbouring cells of a set."""
    pairs = ((cell, direction) for cell in cells for direction in (Direction.NORTH, Direction.EAST))
    return frozenset(Wall.between(cell, direction) for cell, direction in pairs if cell.towards(direction) in cells)


def built_in_worlds() -> tuple[str, ...]:
    """The names of the worlds that come with wherry."""
    folder = resources.files("wherry") / "worlds"
    return tuple(sorted(entry.name.removesuffix(".txt") for entry in folder.iterdir() if entry.name.endswith(".txt")))


def find_world(name_or_path: str | Path) -> FloorPlan:
    """Read a world that comes with wherry, by its name, or a world file, by its path.

    Raises:
        InputError: There is no such world or file, or the file is not a world.
    """
    names = built_in_worlds()
    if str(name_or_path) in names:
        text = (resources.files("wherry") / "worlds" / f"{name_or_path}.txt").read_text(encoding="utf-8")
        return parse_world(text, source=f"{name_or_path}.txt")
    if not Path(name_or_path).exists():
        raise InputError(name_or_path, "", f"is neither a file nor one of the worlds {', '.join(names)}")
    return load_world(name_or_path)


def load_world(path: str | Path) -> FloorPlan:
    """Read a world file.

    Raises:
        InputError: The file cannot be read, or is not a world.
    """
    return parse_world(read_text(path, limit=LARGEST_FILE), source=str(path))


def parse_world(text: str, source: str) -> FloorPlan:
    """Read a world from its text; the module's docstring shows one.

    Args:
        text: Fields, an empty line, the drawing.
        source: What to call it in errors.

    Raises:
        InputError: The text is not a world; the error names the field, or the drawing's line and column.
    """
    lines = [line.rstrip() for line in text.rstrip().splitlines()]
    first = next((number for number, line in enumerate(lines) if line.startswith("+")), len(lines))
    fields = _read_fields(lines[:first], source)
    drawing = _Drawing(source, first, tuple(lines[first:]))
    drawing.check_frame()
    contents = drawing.contents()
    robots = contents.keys() & ARROWS.keys()
    if not robots:
        raise InputError(source, "drawing", "has no robot (one of > ^ < v)")
    if "w" not in contents:
        raise InputError(source, "drawing", "has no warehouse (w)")
    arrow = robots.pop()
    try:
        return FloorPlan(
            name=fields["name"],
            width=drawing.width,
            height=drawing.height,
            cell_size=float(fields.get("cell", DEFAULT_CELL_SIZE)),
            walls=drawing.walls(),
            obstacles=frozenset(contents.get("#", ())),
            warehouse=frozenset(contents["w"]),
            start=contents[arrow][0],
            heading=ARROWS[arrow],
            boxes=tuple(contents.get("o", ())),
            box_count=int(fields.get("boxes", DEFAULT_BOX_COUNT)),
            marks={mark: cells[0] for mark, cells in sorted(contents.items()) if mark in ascii_uppercase},
        )
    except InputError as error:
        raise InputError(source, error.field, error.reason) from None


def format_world(plan: FloorPlan) -> str:
    """Write a world as text that `parse_world` reads back as the same plan, its boxes row by row from the bottom.

    Raises:
        InputError: The plan has no robot or no warehouse.
    """
    if plan.start is None or not plan.warehouse:
        raise InputError(plan.name, "drawing", f"has no {'robot' if plan.start is None else 'warehouse'}")
    fields = {"wherry-world": str(FORMAT_VERSION), "name": plan.name, "cell": repr(plan.cell_size)}
    if not plan.boxes or plan.box_count != DEFAULT_BOX_COUNT:
        fields["boxes"] = str(plan.box_count)
    lines = [f"{key}: {value}" for key, value in fields.items()] + [""]
    return "\n".join([*lines, drawing(plan, lambda cell: _symbols(plan, cell))])


def drawing(plan: FloorPlan, symbols: Callable[[Cell], str]) -> str:
    """Draw a plan's walls as text, and in every cell what stands in it.

    Args:
        plan: The plan.
        symbols: At most three characters for a cell.
    """
    lines = []
    for y in reversed(range(plan.height)):
        row = [Cell(x, y) for x in range(plan.width)]
        lines.append("+" + "".join(("---" if _walled(plan, cell, Direction.NORTH) else "   ") + "+" for cell in row))
        edges = ("|" if _walled(plan, cell, Direction.EAST) else " " for cell in row)
        cells = (symbols(cell).center(CELL_COLUMNS - 1) for cell in row)
        lines.append("|" + "".join(cell + edge for cell, edge in zip(cells, edges, strict=True)))
    lines.append("+" + "---+" * plan.width)
    return "\n".join(lines) + "\n"


def _walled(plan: FloorPlan, cell: Cell, direction: Direction) -> bool:
    """Whether a wall or the plan's edge stands on a cell's edge."""
    return Wall.between(cell, direction) in plan.walls or not plan.contains(cell.towards(direction))


def _symbols(plan: FloorPlan, cell: Cell) -> str:
    """The three characters of a cell."""
    if cell in plan.obstacles:
        return "###"
    symbols = next(arrow for arrow, heading in ARROWS.items() if heading is plan.heading) if cell == plan.start else ""
    symbols += "w" if cell in plan.warehouse else ""
    symbols += "o" if cell in plan.boxes else ""
    symbols += "".join(mark for mark, marked in plan.marks.items() if marked == cell)
    return symbols


def _read_fields(lines: list[str], source: str) -> dict[str, str]:
    """Read the ``key: value`` lines above the drawing, checking the keys, the version and that numbers are numbers."""
    fields: dict[str, str] = {}
    for number, line in enumerate(lines, start=1):
        if not line or line.startswith("#"):
            continue
        key, colon, value = line.partition(":")
        if not colon or key not in FIELDS:
            raise InputError(source, f"line {number}", f"is none of the fields {', '.join(FIELDS)} (as in name: attic)")
        if key in fields:
            raise InputError(source, f"line {number}", f"gives {key} a second time")
        try:
            FIELDS[key](value)
        except ValueError:
            kind = "a whole number" if FIELDS[key] is int else "a number"
            raise InputError(source, key, f"must be {kind}, not {value.strip()[:40]!r}") from None
        fields[key] = value.strip()
    if fields.get("wherry-world") != str(FORMAT_VERSION):
        found = f"is {fields['wherry-world'][:40]!r}" if "wherry-world" in fields else "is missing"
        raise InputError(source, "wherry-world", f"{found}; this version reads wherry-world: {FORMAT_VERSION}")
    if "name" not in fields:
        raise InputError(source, "name", "is missing")
    return fields


def _named(symbol: str) -> str:
    """What a character of a drawing stands for, or nothing."""
    return THINGS.get(symbol, f"the mark {symbol}" if symbol in ascii_uppercase else "")


@dataclass(frozen=True)
class _Drawing:
    """The lower part of a world file.

    Attributes:
        source: What to call the file in errors.
        first: Lines above the drawing.
        lines: [2 * height + 1], from the top; each 4 * width + 1 characters once `check_frame` has passed.
    """

    source: str
    first: int
    lines: tuple[str, ...]

    @property
    def width(self) -> int:
        """Cells from left to right."""
        return len(self.lines[0]) // CELL_COLUMNS

    @property
    def height(self) -> int:
        """Cells from bottom to top."""
        return len(self.lines) // CELL_ROWS

    def check_frame(self) -> None:
        """Refuse a drawing that is not a rectangle of whole cells with a + wherever cells meet."""
        if not self.lines:
            raise InputError(self.source, "drawing", "is missing; it begins with a line such as +---+---+")
        length = len(self.lines[0])
        if length % CELL_COLUMNS != 1 or self.width < 1:
            raise self._error(0, length - 1, f"the line must be {CELL_COLUMNS} characters for each cell and a last +")
        if len(self.lines) % CELL_ROWS != 1 or self.height < 1:
            raise self._error(len(self.lines) - 1, 0, "the drawing must end with a line of walls under the last cells")
        for row, line in enumerate(self.lines):
            if len(line) != length:
                raise self._error(
                    row, min(len(line), length), f"the line has {len(line)} characters, not {length} as the first"
                )
            posts = line[::CELL_COLUMNS] if row % CELL_ROWS == 0 else ""
            for post, character in enumerate(posts):
                if character != "+":
                    raise self._error(row, post * CELL_COLUMNS, f"must be + where cells meet, not {character!r}")

    def contents(self) -> dict[str, list[Cell]]:
        """Which cells hold each character, row by row from the bottom."""
        contents: dict[str, list[Cell]] = {}
        for y in range(self.height):
            for x in range(self.width):
                row, column = self._place(Cell(x, y))
                symbols = self.lines[row][column : column + CELL_COLUMNS - 1]
                self._check_symbols(symbols, row, column, contents)
                for symbol in set(symbols) - {" "}:
                    contents.setdefault(symbol, []).append(Cell(x, y))
        return contents

    def walls(self) -> frozenset[Wall]:
        """The inner walls."""
        walls = set()
        for y in range(self.height):
            for x in range(self.width):
                for direction in Direction:
                    cell = Cell(x, y)
                    if self._wall(cell, direction) and self._inside(cell.towards(direction)):
                        walls.add(Wall.between(cell, direction))
        return frozenset(walls)

    def _inside(self, cell: Cell) -> bool:
        """Whether the cell lies on the drawing."""
        return 0 <= cell.x < self.width and 0 <= cell.y < self.height

    def _place(self, cell: Cell) -> tuple[int, int]:
        """Row and column of a cell's first character."""
        return (self.height - 1 - cell.y) * CELL_ROWS + 1, cell.x * CELL_COLUMNS + 1

    def _check_symbols(self, symbols: str, row: int, column: int, before: Mapping[str, list[Cell]]) -> None:
        """Refuse what cannot stand in a cell, given what stands in the cells before."""
        if "#" in symbols and symbols != "###":
            inside = next((_named(symbol) for symbol in symbols if symbol not in "# "), "")
            raise self._error(row, column, f"{inside} inside an obstacle" if inside else "an obstacle must be ###")
        for offset, symbol in enumerate(symbols):
            if symbol in "# ":
                continue
            problem = ""
            if not _named(symbol):
                problem = f"{symbol!r} means nothing; a cell holds ###, w, o, one of > ^ < v, or a capital letter"
            elif symbol in symbols[:offset]:
                problem = f"{_named(symbol)} stands twice in the same cell"
            elif symbol in ARROWS and any(arrow in before or arrow in symbols[:offset] for arrow in ARROWS):
                problem = "a second robot"
            elif symbol in ascii_uppercase and symbol in before:
                problem = f"{_named(symbol)} is in two cells"
            if problem:
                raise self._error(row, column + offset, problem)

    def _wall(self, cell: Cell, direction: Direction) -> bool:
        """Whether a wall is drawn on a cell's edge; refuses half walls and gaps in the outer edge."""
        row, column = self._place(cell)
        row -= direction.dy
        column += {Direction.EAST: CELL_COLUMNS - 1, Direction.WEST: -1}.get(direction, 0)
        wall = "|" if direction.dx else "---"
        found = self.lines[row][column : column + len(wall)]
        if found == wall:
            return True
        if found.strip():
            offset, symbol = next((i, symbol) for i, symbol in enumerate(found) if symbol != wall[i])
            thing = _named(symbol)
            reason = f"{thing} inside a wall" if thing else f"must be {wall} or nothing, not {found!r}"
            raise self._error(row, column + offset, reason)
        if not self._inside(cell.towards(direction)):
            raise self._error(row, column, f"must be {wall}, as the outer edge is walled")
        return False

    def _error(self, row: int, column: int, reason: str) -> InputError:
        """An error that points at a character of the drawing."""
        return InputError(self.source, f"line {self.first + row + 1}, column {column + 1}", reason)
