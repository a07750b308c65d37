"""The drawing of a world file: a floor plan as text, three characters wide and one line high for each cell.

The documentation of `wherry.floorplan.world_files` contains an example.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from string import ascii_uppercase

from wherry.errors import InputError
from wherry.floorplan.plan import Cell, Direction, FloorPlan, Wall

CELL_COLUMNS = 4  # characters from one cell's wall to the next
CELL_ROWS = 2  # lines from one cell's wall to the next

SYMBOL_MEANINGS = {"#": "an obstacle", "w": "the warehouse", "o": "a box", **dict.fromkeys(">^<v", "the robot")}
HEADING_SYMBOLS = {">": Direction.EAST, "^": Direction.NORTH, "<": Direction.WEST, "v": Direction.SOUTH}


def draw_plan(plan: FloorPlan, symbols: Callable[[Cell], str]) -> str:
    """Draw a plan as text: its walls, and symbols in its cells.

    Args:
        plan: The plan.
        symbols: Returns at most three characters for a cell.
    """
    lines = []
    for y in reversed(range(plan.height)):
        row = [Cell(x, y) for x in range(plan.width)]
        lines.append("+" + "".join(("---" if _has_wall(plan, cell, Direction.NORTH) else "   ") + "+" for cell in row))
        edges = ("|" if _has_wall(plan, cell, Direction.EAST) else " " for cell in row)
        cells = (symbols(cell).center(CELL_COLUMNS - 1) for cell in row)
        lines.append("|" + "".join(cell + edge for cell, edge in zip(cells, edges, strict=True)))
    lines.append("+" + "---+" * plan.width)
    return "\n".join(lines) + "\n"


def _has_wall(plan: FloorPlan, cell: Cell, direction: Direction) -> bool:
    """Whether a wall or the plan's outer edge is on a cell's edge in a direction."""
    return Wall.between(cell, direction) in plan.walls or not plan.contains(cell.neighbour(direction))


def cell_symbols(plan: FloorPlan, cell: Cell) -> str:
    """The characters that stand for the contents of a cell, at most three."""
    if cell in plan.obstacles:
        return "###"
    symbols = (
        next(arrow for arrow, heading in HEADING_SYMBOLS.items() if heading is plan.heading)
        if cell == plan.start
        else ""
    )
    symbols += "w" if cell in plan.warehouse else ""
    symbols += "o" if cell in plan.boxes else ""
    symbols += "".join(mark for mark, marked in plan.marks.items() if marked == cell)
    return symbols


def _meaning(symbol: str) -> str:
    """What a character of a drawing stands for; empty if it has no meaning."""
    return SYMBOL_MEANINGS.get(symbol, f"the mark {symbol}" if symbol in ascii_uppercase else "")


@dataclass(frozen=True)
class WorldDrawing:
    """The drawing of a world file, as it was read.

    Attributes:
        source: Name of the file in error messages.
        lines_above: Number of lines above the drawing.
        lines: [2 * height + 1] lines from the top; each has 4 * width + 1 characters if `check_frame` has passed.
    """

    source: str
    lines_above: int
    lines: tuple[str, ...]

    @property
    def width(self) -> int:
        """Number of columns of cells."""
        return len(self.lines[0]) // CELL_COLUMNS

    @property
    def height(self) -> int:
        """Number of rows of cells."""
        return len(self.lines) // CELL_ROWS

    def check_frame(self) -> None:
        """Raise an error unless the drawing is a rectangle of whole cells with a + wherever cells meet."""
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
        """The cells that contain each character, row by row from the bottom."""
        contents: dict[str, list[Cell]] = {}
        for y in range(self.height):
            for x in range(self.width):
                row, column = self._position(Cell(x, y))
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
                    if self._has_wall(cell, direction) and self._contains(cell.neighbour(direction)):
                        walls.add(Wall.between(cell, direction))
        return frozenset(walls)

    def _contains(self, cell: Cell) -> bool:
        """Whether a cell lies on the drawing."""
        return 0 <= cell.x < self.width and 0 <= cell.y < self.height

    def _position(self, cell: Cell) -> tuple[int, int]:
        """Row and column of a cell's first character."""
        return (self.height - 1 - cell.y) * CELL_ROWS + 1, cell.x * CELL_COLUMNS + 1

    def _check_symbols(self, symbols: str, row: int, column: int, earlier: Mapping[str, list[Cell]]) -> None:
        """Raise an error if symbols cannot be in a cell, given the symbols of earlier cells."""
        if "#" in symbols and symbols != "###":
            inside = next((_meaning(symbol) for symbol in symbols if symbol not in "# "), "")
            raise self._error(row, column, f"{inside} inside an obstacle" if inside else "an obstacle must be ###")
        for offset, symbol in enumerate(symbols):
            if symbol in "# ":
                continue
            problem = ""
            if not _meaning(symbol):
                problem = f"{symbol!r} means nothing; a cell holds ###, w, o, one of > ^ < v, or a capital letter"
            elif symbol in symbols[:offset]:
                problem = f"{_meaning(symbol)} stands twice in the same cell"
            elif symbol in HEADING_SYMBOLS and HEADING_SYMBOLS.keys() & {*earlier, *symbols[:offset]}:
                problem = "a second robot"
            elif symbol in ascii_uppercase and symbol in earlier:
                problem = f"{_meaning(symbol)} is in two cells"
            if problem:
                raise self._error(row, column + offset, problem)

    def _has_wall(self, cell: Cell, direction: Direction) -> bool:
        """Whether a wall is drawn on a cell's edge; raise an error for a partial wall or a gap in the outer edge."""
        row, column = self._position(cell)
        row -= direction.dy
        column += {Direction.EAST: CELL_COLUMNS - 1, Direction.WEST: -1}.get(direction, 0)
        wall = "|" if direction.dx else "---"
        found = self.lines[row][column : column + len(wall)]
        if found == wall:
            return True
        if found.strip():
            offset, symbol = next((i, symbol) for i, symbol in enumerate(found) if symbol != wall[i])
            meaning = _meaning(symbol)
            reason = f"{meaning} inside a wall" if meaning else f"must be {wall} or nothing, not {found!r}"
            raise self._error(row, column + offset, reason)
        if not self._contains(cell.neighbour(direction)):
            raise self._error(row, column, f"must be {wall}, as the outer edge is walled")
        return False

    def _error(self, row: int, column: int, reason: str) -> InputError:
        """An error that names line and column of a character of the drawing."""
        return InputError(self.source, f"line {self.lines_above + row + 1}, column {column + 1}", reason)
