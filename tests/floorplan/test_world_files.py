"""World files: reading, writing, and errors for malformed files."""

from __future__ import annotations

import re
import textwrap
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wherry.errors import InputError
from wherry.floorplan import world_files
from wherry.floorplan.generation import generate_world, place_boxes
from wherry.floorplan.plan import Cell, Direction, FloorPlan, Wall
from wherry.floorplan.world_files import built_in_worlds, find_world, format_world, load_world, parse_world

TINY = textwrap.dedent(re.findall(r"::\n\n(.*?\+\n)\n``", world_files.__doc__ or "", re.DOTALL)[0])  # the example


def test_example_of_the_documentation() -> None:
    plan = parse_world(TINY, source="tiny.txt")
    assert plan == FloorPlan(
        name="tiny",
        width=3,
        height=2,
        walls=frozenset({Wall(Cell(1, 1), north=False), Wall(Cell(1, 0), north=True)}),
        obstacles=frozenset({Cell(2, 0)}),
        warehouse=frozenset({Cell(0, 0)}),
        start=Cell(0, 1),
        heading=Direction.EAST,
        boxes=(Cell(2, 1),),
    )
    assert format_world(plan) == TINY


@pytest.mark.parametrize("name", built_in_worlds())
def test_built_in_worlds_are_written_back_as_they_are(name: str) -> None:
    text = (resources.files("wherry") / "worlds" / f"{name}.txt").read_text(encoding="utf-8")
    plan = find_world(name)
    assert format_world(plan) == text
    assert plan.name == name


@pytest.mark.parametrize("name", built_in_worlds())
@pytest.mark.parametrize("seed", range(10))
def test_all_boxes_of_built_in_worlds_can_be_delivered(name: str, seed: int) -> None:
    plan = find_world(name)
    assert plan.is_connected()
    if not plan.boxes:
        plan = place_boxes(plan, plan.box_count, np.random.default_rng(seed))
    assert plan.reachable_boxes() == plan.boxes


def test_default_world_is_a_building_of_ten_by_ten_metres() -> None:
    plan = find_world("rooms")
    assert (plan.width, plan.height, plan.cell_size) == (17, 17, 0.6)
    assert len(plan.warehouse) == 4
    assert len(plan.obstacles) >= 10


def test_taxi_worlds_are_the_published_ones() -> None:
    taxi, taxi10 = find_world("taxi"), find_world("taxi10")
    assert taxi.marks == {"R": Cell(0, 4), "G": Cell(4, 4), "Y": Cell(0, 0), "B": Cell(3, 0)}
    assert {wall.cell for wall in taxi.walls} == {Cell(*xy) for xy in ((0, 0), (0, 1), (1, 3), (1, 4), (2, 0), (2, 1))}
    cells = {"Y": (0, 1), "R": (0, 9), "G": (5, 9), "B": (4, 0), "W": (3, 6), "M": (6, 5), "C": (8, 9), "P": (9, 0)}
    assert taxi10.marks == {mark: Cell(*xy) for mark, xy in cells.items()}
    runs = {0: range(4), 2: range(6, 10), 3: range(4), 5: range(4, 8), 7: (*range(4), *range(6, 10))}
    assert {wall.cell for wall in taxi10.walls} == {Cell(x, y) for x, ys in runs.items() for y in ys}
    assert not any(wall.north for wall in taxi.walls | taxi10.walls)


@given(seed=st.integers(0, 10_000), width=st.integers(4, 20), height=st.integers(4, 20), boxes=st.integers(0, 2))
def test_written_world_reads_back_as_the_same_plan(seed: int, width: int, height: int, boxes: int) -> None:
    rng = np.random.default_rng(seed)
    plan = generate_world(width, height, rng, name="a plan", box_count=int(rng.integers(10)))
    if boxes:
        plan = place_boxes(plan, boxes, rng)
    text = format_world(plan)
    assert parse_world(text, source="text") == plan
    assert format_world(parse_world(text, source="text")) == text


def test_comments_windows_line_ends_and_trailing_blanks_are_ignored() -> None:
    text = "# a comment\n\n" + TINY.replace("\n", "  \r\n") + "\n\n"
    assert parse_world(text, source="tiny.txt") == parse_world(TINY, source="tiny.txt")


def _changed(old: str, new: str) -> str:
    """The example with one replacement."""
    assert TINY.count(old) == 1
    return TINY.replace(old, new)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "wherry-world: is missing; this version reads wherry-world: 1"),
        ("hello", "line 1: is none of the fields wherry-world, name, cell, boxes (as in name: attic)"),
        (_changed("world: 1", "world: 2"), "wherry-world: is '2'; this version reads wherry-world: 1"),
        (_changed("name: tiny\n", ""), "name: is missing"),
        (_changed("name: tiny", "name:"), "name: must be 1 to 60 characters on one line"),
        (_changed("name: tiny", "nam: tiny"), "line 2: is none of the fields wherry-world, name, cell, boxes "),
        (_changed("name: tiny", "name: tiny\nname: tiny"), "line 3: repeats the field name"),
        (_changed("cell: 0.6", "cell: big"), "cell: must be a number, not 'big'"),
        (_changed("cell: 0.6", "cell: nan"), "cell: must be 0.5 to 5.0 m, not nan"),
        (_changed("cell: 0.6", "cell: 1e9"), "cell: must be 0.5 to 5.0 m, not 1e+09"),
        (_changed("cell: 0.6", "boxes: -1"), "boxes: must be 0 to 1,000, not -1"),
        (_changed("cell: 0.6", "boxes: 2.5"), "boxes: must be a whole number, not '2.5'"),
        (_changed("cell: 0.6", "boxes: " + "9" * 5000), "boxes: must be a whole number, not '9"),
        (TINY[: TINY.index("+")], "drawing: is missing; it begins with a line such as +---+---+"),
        (_changed("| >  ", "|    "), "drawing: has no robot (one of > ^ < v)"),
        (_changed(" w ", "   "), "drawing: has no warehouse (w)"),
        (_changed(" o ", " v "), "line 6, column 11: a second robot"),
        (_changed(" o ", "o o"), "line 6, column 12: a box stands twice in the same cell"),
        (_changed(" o ", "o##"), "line 6, column 10: a box inside an obstacle"),
        (_changed("| > ", "|#> "), "line 6, column 2: the robot inside an obstacle"),
        (_changed("###", " # "), "line 8, column 10: an obstacle must be ###"),
        (_changed(" o ", " x "), "line 6, column 11: 'x' means nothing; a cell holds "),
        (_changed(" o ", " é "), "line 6, column 11: 'é' means nothing; a cell holds "),
        (_changed("| o |", "|   o"), "line 6, column 13: a box inside a wall"),
        (_changed("+   +---+", "+ o +---+"), "line 7, column 2: must be --- or nothing, not ' o '"),
        (_changed("+   +---+", "+   +-- +"), "line 7, column 8: must be --- or nothing, not '-- '"),
        (_changed("+   +---+", "+   *---+"), "line 7, column 5: must be + where cells meet, not '*'"),
        (_changed(" o |\n", " o  \n"), "line 6, column 12: the line has 11 characters, not 13 as the first"),
        (_changed("| w ", "  w "), "line 8, column 1: must be |, as the outer edge is walled"),
        (TINY[:-14], "line 8, column 1: the drawing must end with a line of walls under the last cells"),
        (
            TINY.replace("---+\n", "--+\n"),
            "line 5, column 12: the line must be 4 characters for each cell and a last +",
        ),
    ],
)
def test_malformed_world_is_refused_with_its_position_and_reason(text: str, message: str) -> None:
    with pytest.raises(InputError) as error:
        parse_world(text, source="world.txt")
    assert str(error.value).startswith(f"world.txt: {message}")
    assert "\n" not in str(error.value)


@given(st.text(alphabet="+-| #wo><^vRGB\n:0123456789namecellboxwherry", max_size=200))
def test_any_text_is_a_world_or_an_input_error(text: str) -> None:
    for candidate in (text, "wherry-world: 1\nname: x\n\n" + text):
        try:
            parse_world(candidate, source="text")
        except InputError as error:
            assert error.source == "text"  # noqa: PT017


@given(st.integers(0, len(TINY) - 1), st.characters(codec="utf-8"))
def test_a_world_with_one_wrong_character_is_a_world_or_an_input_error(position: int, character: str) -> None:
    try:
        parse_world(TINY[:position] + character + TINY[position + 1 :], source="text")
    except InputError as error:
        assert error.source == "text"  # noqa: PT017


def test_worlds_are_found_by_name_and_by_path(tmp_path: Path) -> None:
    path = tmp_path / "tiny.txt"
    path.write_text(TINY, encoding="utf-8")
    assert find_world(path) == load_world(str(path)) == parse_world(TINY, source="tiny.txt")
    assert find_world("taxi").name == "taxi"


def test_error_for_an_unknown_world_lists_the_built_in_ones(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="attic: is neither a file nor one of the worlds offices, rooms, small, taxi"):
        find_world("attic")
    with pytest.raises(InputError, match="Is a directory"):
        find_world(tmp_path)


def test_binary_and_huge_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "world.txt"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not UTF-8"):
        find_world(path)
    path.write_bytes(b" " * 4_000_001)
    with pytest.raises(InputError, match="larger than"):
        find_world(path)


def test_plan_without_robot_or_warehouse_cannot_be_written() -> None:
    with pytest.raises(InputError, match="has no robot"):
        format_world(FloorPlan("plan", 2, 2))
    with pytest.raises(InputError, match="has no warehouse"):
        format_world(FloorPlan("plan", 2, 2, start=Cell(0, 0)))
