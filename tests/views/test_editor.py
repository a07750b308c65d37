"""The world editor in Chromium: drawing, saving and errors."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from playwright import sync_api as playwright

from wherry.errors import InputError
from wherry.floorplan.plan import Cell, Direction, FloorPlan, Wall
from wherry.floorplan.world_files import built_in_worlds, find_world, format_world, load_world, parse_world
from wherry.views.web.editor import check_world, new_plan, serve_editor
from wherry_testing.browsing import DESK, PHONE, SCREENSHOTS, faint_texts, until

PLAN = FloorPlan(
    "attic",
    width=6,
    height=4,
    walls=frozenset({Wall(Cell(2, 0), north=False)}),
    warehouse=frozenset({Cell(5, 0)}),
    start=Cell(0, 3),
    boxes=(Cell(3, 3),),
    heading=Direction.EAST,
)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "attic.txt"
    path.write_text(format_world(PLAN), encoding="utf-8")
    return path


@pytest.fixture
def editor(page: playwright.Page, file: Path) -> Iterator[playwright.Page]:
    with serve_editor(file, port=0) as server:
        page.goto(f"{server.url}?theme=light")
        until(page, "checked.width === 6")
        yield page
        page.goto("about:blank")  # closes the socket before the server stops


def drawing_of(page: playwright.Page) -> tuple[float, float, float]:
    """Left and top of the drawn plan in the window, and side of a cell, px."""
    box = "canvas.getBoundingClientRect()"
    left, top, side = page.evaluate(f"[{box}.left + MARGIN, {box}.top + MARGIN, side]")
    return left, top, side


def click_cell(page: playwright.Page, x: int, y: int, dx: float = 0.0, dy: float = 0.0) -> None:
    """Click in a cell, off its centre by (dx, dy) cells."""
    left, top, side = drawing_of(page)
    page.mouse.click(left + (x + 0.5 + dx) * side, top + (PLAN.height - y - 0.5 - dy) * side)


def choose(page: playwright.Page, name: str) -> None:
    page.locator("#tools label", has_text=name).click()


def saved(page: playwright.Page, file: Path) -> FloorPlan:
    page.get_by_role("button", name="Save").click()
    until(page, "document.getElementById('state').textContent === 'saved'")
    return load_world(file)


def test_drawn_objects_are_saved_to_the_file(editor: playwright.Page, file: Path) -> None:
    click_cell(editor, 1, 1, dx=0.45)  # walls
    click_cell(editor, 4, 2, dy=0.45)
    click_cell(editor, 2, 0, dx=0.45)  # removes the existing wall
    choose(editor, "Obstacle")
    click_cell(editor, 2, 2)
    choose(editor, "Warehouse")
    click_cell(editor, 5, 1)
    choose(editor, "Box")
    click_cell(editor, 4, 0)
    click_cell(editor, 3, 3)  # removes it
    choose(editor, "Robot")
    click_cell(editor, 1, 0)
    click_cell(editor, 1, 0)  # turns it
    expected = replace(
        PLAN,
        walls=frozenset({Wall(Cell(1, 1), north=False), Wall(Cell(4, 2), north=True)}),
        obstacles=frozenset({Cell(2, 2)}),
        warehouse=frozenset({Cell(5, 0), Cell(5, 1)}),
        boxes=(Cell(4, 0),),
        start=Cell(1, 0),
        heading=Direction.NORTH,
    )
    assert saved(editor, file) == expected


def test_a_stroke_draws_a_wall_and_is_one_undo_step(editor: playwright.Page, file: Path) -> None:
    left, top, side = drawing_of(editor)
    editor.mouse.move(left + 0.5 * side, top + 1.9 * side)
    editor.mouse.down()
    editor.mouse.move(left + 3.5 * side, top + 1.9 * side, steps=20)
    editor.mouse.up()
    row = {Wall(Cell(x, 1), north=True) for x in range(4)}
    assert saved(editor, file).walls == PLAN.walls | row
    editor.get_by_role("button", name="Undo").click()
    assert saved(editor, file).walls == PLAN.walls
    editor.get_by_role("button", name="Redo").click()
    assert saved(editor, file).walls == PLAN.walls | row


def test_erasing_removes_walls_and_boxes(editor: playwright.Page, file: Path) -> None:
    choose(editor, "Erase")
    click_cell(editor, 2, 0, dx=0.45)
    click_cell(editor, 3, 3)
    assert saved(editor, file) == replace(PLAN, walls=frozenset(), boxes=())


def test_sizes_and_fields_are_saved(editor: playwright.Page, file: Path) -> None:
    editor.locator("#width").fill("8")
    editor.locator("#width").press("Enter")
    editor.locator("#name").fill("cellar")
    editor.locator("#boxes").fill("7")
    plan = saved(editor, file)
    assert (plan.width, plan.height, plan.name, plan.box_count) == (8, 4, "cellar", 7)
    assert (plan.walls, plan.boxes, plan.start) == (PLAN.walls, PLAN.boxes, PLAN.start)
    assert not plan.is_blocked(Cell(5, 2), Direction.EAST)  # the old outer edge is gone


def test_an_error_is_located_and_prevents_saving(editor: playwright.Page, file: Path) -> None:
    before = file.read_text()
    source = editor.locator("#text")
    source.fill(before.replace(" o ", " q "))
    until(editor, "checked.error !== null")
    assert "'q' means nothing" in editor.inner_text("#verdict")
    with pytest.raises(InputError) as caught:
        parse_world(before.replace(" o ", " q "), "attic.txt")
    assert caught.value.reason in editor.inner_text("#verdict")
    assert editor.evaluate("[checked.line, checked.column]") == [6, 15]
    assert editor.get_by_role("button", name="Save").is_disabled()
    editor.keyboard.press("Control+s")
    editor.wait_for_timeout(200)
    assert file.read_text() == before
    source.fill(before)
    until(editor, "checked.error === null")


def test_objects_removed_by_a_smaller_plan_are_listed_and_restored_by_undo(editor: playwright.Page, file: Path) -> None:
    before = editor.input_value("#text")
    editor.locator("#width").fill("2")
    editor.locator("#width").press("Enter")
    assert re.search(r"The smaller plan removed .*\. Undo restores the larger one\.", editor.inner_text("#hint"))
    editor.get_by_role("button", name="Undo").click()
    assert editor.input_value("#text") == before


def test_tools_show_hints_and_a_saved_world_shows_its_command(editor: playwright.Page, file: Path) -> None:
    choose(editor, "Robot")
    assert "a second click turns it" in editor.inner_text("#hint")
    choose(editor, "Obstacle")
    click_cell(editor, 0, 0)
    saved(editor, file)
    until(editor, "document.getElementById('verdict').textContent.includes('wherry deliver --world')")
    assert str(file) in editor.inner_text("#verdict")


def test_an_unreachable_box_is_reported(editor: playwright.Page) -> None:
    choose(editor, "Obstacle")
    for x, y in ((2, 3), (4, 3), (3, 2)):
        click_cell(editor, x, y)
    until(editor, "checked.unreachable?.length === 1")
    assert "1 of them cannot be reached by the robot" in editor.inner_text("#verdict")


def test_the_keyboard_can_draw(editor: playwright.Page, file: Path) -> None:
    editor.locator("#canvas").focus()
    for key in ("ArrowRight", "ArrowDown", "2", "Space", "ArrowRight", "Shift+ArrowDown"):
        editor.keyboard.press(key)
    editor.keyboard.press("Control+s")
    until(editor, "document.getElementById('state').textContent === 'saved'")
    plan = load_world(file)
    assert plan.obstacles == {Cell(1, 2)}
    assert plan.walls == PLAN.walls | {Wall(Cell(2, 1), north=True)}


@pytest.mark.parametrize(("size", "name"), [(DESK, "desk"), (PHONE, "phone")])
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_the_editor_fits_both_sizes_in_both_themes(
    page: playwright.Page, tmp_path: Path, size: dict[str, int], name: str, theme: str
) -> None:
    path = tmp_path / "rooms.txt"
    path.write_text(format_world(find_world("rooms")), encoding="utf-8")
    page.set_viewport_size(size)  # type: ignore[arg-type]
    with serve_editor(path, port=0) as server:
        page.goto(f"{server.url}?theme={theme}")
        until(page, "checked.width === 17")
        SCREENSHOTS.mkdir(parents=True, exist_ok=True)
        page.screenshot(path=SCREENSHOTS / f"editor-{name}-{theme}.png")
        assert page.evaluate("document.documentElement.scrollWidth") <= size["width"]
        assert page.evaluate("canvas.getBoundingClientRect().width <= canvas.parentElement.clientWidth")
        assert faint_texts(page) == []
        page.goto("about:blank")


def test_a_new_file_starts_with_a_valid_world(page: playwright.Page, tmp_path: Path) -> None:
    path = tmp_path / "new.txt"
    with serve_editor(path, port=0) as server:
        page.goto(server.url)
        until(page, "checked.width === 10")
        assert not path.exists()
        assert saved(page, path) == new_plan("new")
        page.goto("about:blank")


def test_a_file_that_is_no_world_is_rejected(tmp_path: Path) -> None:
    path = tmp_path / "x.txt"
    path.write_text("hello")
    with pytest.raises(InputError, match=r"x\.txt"), serve_editor(path, port=0):
        pass


@pytest.mark.parametrize("name", built_in_worlds())
def test_every_built_in_world_passes_the_check(name: str) -> None:
    found = check_world(format_world(find_world(name)), name)
    assert (found["error"], found["unreachable"], found["connected"]) == (None, [], True)
