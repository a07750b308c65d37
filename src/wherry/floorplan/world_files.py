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
a box, one of ``> ^ < v`` the robot and its heading, and a capital letter names a cell (Taxi's R, G, Y and B). The field
``boxes`` is the number of boxes at random cells in a world whose drawing has none. Lines above the drawing that begin
with ``#`` are comments.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import resources
from pathlib import Path
from string import ascii_uppercase

from wherry.errors import InputError
from wherry.files import read_text
from wherry.floorplan.drawing import HEADING_SYMBOLS, WorldDrawing, cell_symbols, draw_plan
from wherry.floorplan.plan import DEFAULT_BOX_COUNT, DEFAULT_CELL_SIZE, FloorPlan

FORMAT_VERSION = 1
MAX_FILE_SIZE = 4_000_000  # bytes; a plan of 1,000 × 500 cells fits

FIELDS: Mapping[str, Callable[[str], object]] = {"wherry-world": str, "name": str, "cell": float, "boxes": int}


def built_in_worlds() -> tuple[str, ...]:
    """The names of the built-in worlds."""
    folder = resources.files("wherry") / "worlds"
    return tuple(sorted(entry.name.removesuffix(".txt") for entry in folder.iterdir() if entry.name.endswith(".txt")))


def find_world(name_or_path: str | Path) -> FloorPlan:
    """Read a built-in world, given its name, or a world file, given its path.

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
    return parse_world(read_text(path, max_bytes=MAX_FILE_SIZE), source=str(path))


def parse_world(text: str, source: str) -> FloorPlan:
    """Parse the text of a world file; the module's docstring contains an example.

    Args:
        text: Fields, an empty line, the drawing.
        source: Name of the text in error messages.

    Raises:
        InputError: The text is not a world; the error names the field, or the drawing's line and column.
    """
    lines = [line.rstrip() for line in text.rstrip().splitlines()]
    lines_above = next((number for number, line in enumerate(lines) if line.startswith("+")), len(lines))
    fields = _read_fields(lines[:lines_above], source)
    drawing = WorldDrawing(source, lines_above, tuple(lines[lines_above:]))
    drawing.check_frame()
    contents = drawing.contents()
    robots = contents.keys() & HEADING_SYMBOLS.keys()
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
            heading=HEADING_SYMBOLS[arrow],
            boxes=tuple(contents.get("o", ())),
            box_count=int(fields.get("boxes", DEFAULT_BOX_COUNT)),
            marks={mark: cells[0] for mark, cells in sorted(contents.items()) if mark in ascii_uppercase},
        )
    except InputError as error:
        raise InputError(source, error.field, error.reason) from None


def format_world(plan: FloorPlan) -> str:
    """Write a plan as the text of a world file; `parse_world` reads it, with the boxes row by row from the bottom.

    Raises:
        InputError: The plan has no robot or no warehouse.
    """
    if plan.start is None or not plan.warehouse:
        raise InputError(plan.name, "drawing", f"has no {'robot' if plan.start is None else 'warehouse'}")
    fields = {"wherry-world": str(FORMAT_VERSION), "name": plan.name, "cell": repr(plan.cell_size)}
    if not plan.boxes or plan.box_count != DEFAULT_BOX_COUNT:
        fields["boxes"] = str(plan.box_count)
    lines = [f"{key}: {value}" for key, value in fields.items()] + [""]
    return "\n".join([*lines, draw_plan(plan, lambda cell: cell_symbols(plan, cell))])


def _read_fields(lines: list[str], source: str) -> dict[str, str]:
    """Read the ``key: value`` lines above the drawing; check keys, version and numbers."""
    fields: dict[str, str] = {}
    for number, line in enumerate(lines, start=1):
        if not line or line.startswith("#"):
            continue
        key, colon, value = line.partition(":")
        if not colon or key not in FIELDS:
            raise InputError(source, f"line {number}", f"is none of the fields {', '.join(FIELDS)} (as in name: attic)")
        if key in fields:
            raise InputError(source, f"line {number}", f"repeats the field {key}")
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
