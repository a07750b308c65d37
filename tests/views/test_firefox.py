"""The pages in Firefox."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from wherry.floorplan.world_files import parse_world
from wherry.trace.codec import Encoder
from wherry.views.web.broadcast import TraceBroadcast
from wherry.views.web.editor import serve_editor
from wherry.views.web.page import player_page
from wherry.views.web.server import serve_run
from wherry_testing.browsing import SCREENSHOTS
from wherry_testing.firefox import PROGRAM, Page, firefox
from wherry_testing.runs import LASER, short_run

pytestmark = pytest.mark.slow

BLUE = [31, 111, 235]
DRAWN = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"


@pytest.fixture(scope="module")
def window(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    if not PROGRAM.exists():
        if os.environ.get("CI") == "true":
            pytest.fail(f"{PROGRAM} is missing")
        pytest.skip(f"no {PROGRAM}")
    with firefox(tmp_path_factory.mktemp("profile")) as window:
        yield window


def colour_at(page: Page, x: float, y: float) -> list[int]:
    page.evaluate(DRAWN)
    colour: list[int] = page.evaluate(
        f"scene.context.getImageData(...scene.project({x}, {y}).map((at) => Math.floor(at * scene.ratio)), 1, 1).data"
    )
    return [colour[f"{at}"] for at in range(3)]  # type: ignore[call-overload]


def test_a_recording_is_drawn_and_replayed(window: Page, tmp_path: Path) -> None:
    encoder = Encoder()
    frames = b"".join(encoder.encode(record) for record in short_run())
    path = tmp_path / "page.html"
    path.write_text(player_page("A run", {"source": "file"}, frames), encoding="utf-8")
    SCREENSHOTS.mkdir(parents=True, exist_ok=True)
    for name, theme, size in (("desk", "light", (1280, 800)), ("phone", "dark", (500, 844))):
        window.goto(f"{path.as_uri()}?theme={theme}", width=size[0], height=size[1])
        window.until("trace.over && trace.begin !== null")
        window.evaluate("(player.playing = false, player.seek(7.5), null)")
        window.evaluate(DRAWN)
        window.screenshot(SCREENSHOTS / f"firefox-{name}.png")
    window.goto(f"{path.as_uri()}?theme=light")
    window.until("trace.over && trace.begin !== null")
    window.evaluate("(player.playing = false, player.seek(4.2), null)")
    for x, y in LASER:
        assert all(abs(part - expected) < 40 for part, expected in zip(colour_at(window, x, y), BLUE, strict=True))
    window.press("\ue014")  # the right arrow
    assert window.evaluate("player.time") == 5.0
    window.press("?")
    assert window.evaluate("document.getElementById('help').open") is True
    window.press("\ue00c")  # Escape
    window.until("!document.getElementById('help').open")
    assert window.errors == []


def test_a_live_run_is_received_until_its_end(window: Page) -> None:
    broadcast = TraceBroadcast()
    with serve_run(broadcast, "A run", port=0) as server:
        window.goto(server.url)
        for record in short_run():
            broadcast(record)
        window.until("trace.end === 10")
        broadcast.end()
        window.until("document.getElementById('link').textContent === 'run over'")
        assert window.evaluate("trace.records.StepTaken.length") == 4
    assert window.errors == []


def test_a_world_is_drawn_and_saved(window: Page, tmp_path: Path) -> None:
    path = tmp_path / "home.txt"
    with serve_editor(path, port=0) as server:
        window.goto(server.url)
        corner = "(({ left, top }) => [left + MARGIN, top + MARGIN])(canvas.getBoundingClientRect())"
        centre_of_cell = f"[4.5, 3.5].map((cells, axis) => {corner}[axis] + cells * side)"
        window.evaluate("(choose('o'), null)")
        window.click(*window.evaluate(centre_of_cell))
        window.until("text.includes(' o ') && checked.drawn === 1")
        window.evaluate("(document.getElementById('save').click(), null)")
        window.until("savedText === text")
        (box,) = parse_world(path.read_text(encoding="utf-8"), str(path)).boxes
        assert (box.x, box.y) == (4, 4)  # the fourth of eight rows from the top
        window.goto("about:blank")
    assert window.errors == []
