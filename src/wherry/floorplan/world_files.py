"""World files: floor plans drawn as text.

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

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from string import ascii_uppercase

from wherry.errors import InputError
from wherry.files import read_text
from wherry.floorplan.plan import DEFAULT_BOX_COUNT, DEFAULT_CELL_SIZE, Cell, Direction, FloorPlan, Wall

FORMAT_VERSION = 1
LARGEST_FILE = 4_000_000  # bytes; a plan of 1,000 × 500 cells fits
CELL_COLUMNS = 4  # characters from one cell's wall to the next one's
CELL_ROWS = 2  # lines likewise

FIELDS: Mapping[str, Callable[[str], object]] = {"wherry-world": str, "name": str, "cell": float, "boxes": int}
THINGS = {"#": "an obstacle", "w": "the warehouse", "o": "a box", **dict.fromkeys(">^<v", "the robot")}
ARROWS = {">": Direction.EAST, "^": Direction.NORTH, "<": Direction.WEST, "v": Direction.SOUTH}


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
