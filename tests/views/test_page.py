"""The page in Chromium: drawing, panels, playback and controls.

Screenshots of both themes and sizes are written to build/screenshots.
"""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from playwright import sync_api as playwright

from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry.trace.codec import Encoder
from wherry.trace.recordings import TRACE_FILE_NAME, TraceRecorder
from wherry.trace.records import MapUpdate, Narration, Phase, Record, RobotSnapshot, RunStarted
from wherry.views.web.broadcast import TraceBroadcast
from wherry.views.web.page import player_page
from wherry.views.web.server import serve_run
from wherry_testing.browsing import DESK, PHONE, SCREENSHOTS, faint_texts, until
from wherry_testing.runs import BOX, LASER, TERMS, room, short_run, snapshot_at, taxi_ride


@pytest.fixture(scope="session")
def delivery_url(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The page as a file with a delivery in it."""
    encoder = Encoder()
    frames = b"".join(encoder.encode(record) for record in short_run())
    path = tmp_path_factory.mktemp("page") / "page.html"
    path.write_text(player_page("A run", {"source": "file"}, frames), encoding="utf-8")
    return path.as_uri()


@pytest.fixture(scope="session")
def taxi_url(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The page as a file with a learner on a grid in it."""
    encoder = Encoder()
    frames = b"".join(encoder.encode(record) for record in taxi_ride())
    path = tmp_path_factory.mktemp("taxi") / "page.html"
    path.write_text(player_page("A ride", {"source": "file"}, frames), encoding="utf-8")
    return path.as_uri()


def opened(page: playwright.Page, url: str, *, at: float, theme: str = "light") -> None:
    page.goto(f"{url}?theme={theme}")
    until(page, "trace.begin !== null && trace.over")
    go_to(page, at)


def go_to(page: playwright.Page, moment: float) -> None:
    page.evaluate("time => { player.playing = false; player.seek(time) }", moment)
    settle(page)


def settle(page: playwright.Page) -> None:
    """Wait until two frames are drawn."""
    page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")


def colour_at(page: playwright.Page, x: float, y: float) -> tuple[int, int, int]:
    """Colour of the canvas at a point of the map, m."""
    pixel = page.evaluate(
        """([x, y]) => {
            const [px, py] = scene.project(x, y);
            const [left, top] = [px, py].map((pixels) => Math.floor(pixels * scene.ratio));
            return [...scene.context.getImageData(left, top, 1, 1).data];
        }""",
        [x, y],
    )
    return tuple(pixel[:3])


def is_near(colour: tuple[int, int, int], expected: str, tolerance: int = 40) -> bool:
    parts = [int(expected[at : at + 2], 16) for at in (1, 3, 5)]
    return all(abs(part - other) <= tolerance for part, other in zip(colour, parts, strict=True))


BLUE, RED, BROWN, WHITE, DARK, GREEN = "#1f6feb", "#d1242f", "#a0622d", "#ffffff", "#2a323d", "#12813f"


def test_every_layer_is_drawn_at_its_position(page: playwright.Page, delivery_url: str) -> None:
    opened(page, delivery_url, at=4.2)
    for x, y in LASER:
        assert is_near(colour_at(page, x, y), BLUE)
    assert is_near(colour_at(page, *BOX), BROWN)
    assert is_near(colour_at(page, 1.2, 0.0), GREEN)  # the path ahead
    assert is_near(colour_at(page, 3.0, -0.6), WHITE)  # free
    assert is_near(colour_at(page, 1.05, 2.95), DARK)  # the wall in the north
    cloud = [colour_at(page, 0.52, y) for y in (-0.85, -0.75, -0.65, -0.55)]
    assert all(red > 1.3 * blue and red > 1.3 * green for red, green, blue in cloud)
    page.evaluate("scene.hidden.add('laser'); scene.hidden.add('particles')")
    settle(page)
    assert not any(is_near(colour_at(page, x, y), BLUE) for x, y in LASER)
    assert is_near(colour_at(page, 0.52, -0.75), WHITE)


def test_the_map_follows_the_playback_time(page: playwright.Page, delivery_url: str) -> None:
    opened(page, delivery_url, at=4.2)
    assert is_near(colour_at(page, 3.0, -0.6), WHITE)
    go_to(page, 1.0)  # only the first three metres are known
    assert page.evaluate("scene.map.percentAt(3.0, -0.6)") is None
    assert page.evaluate("scene.map.percentAt(1.0, -0.6)") == 0
    go_to(page, 3.0)
    assert page.evaluate("scene.map.percentAt(3.0, -0.6)") == 0


def test_the_robot_is_interpolated_between_two_records(page: playwright.Page, delivery_url: str) -> None:
    opened(page, delivery_url, at=0.5)
    assert page.evaluate("scene.instant.pose[0]") == pytest.approx(0.125, abs=1e-6)


def test_conditions_rules_and_progress_are_shown(page: playwright.Page, delivery_url: str) -> None:
    opened(page, delivery_url, at=5.0)
    assert page.locator("#bits li").count() == len(TERMS)
    assert page.locator("#bits li.on").all_inner_texts() == ["1\ntouch_E(wall)"]
    assert "if not touch_N(wall) and not" in page.inner_text("#rules")
    assert "0000000" in page.inner_text("#rules")
    assert "no effect in 2" in page.inner_text("#rules")
    assert page.inner_text("#unknown") == "3"
    go_to(page, 7.5)
    assert "0******" in page.inner_text("#rules")
    assert page.inner_text("#unknown") == "1"
    assert page.inner_text("#delivered") == "0 of 1"
    assert page.inner_text("#action") == "PICKUP"
    go_to(page, 8.2)
    assert page.locator("#bits li.on").count() == 2
    go_to(page, 10.0)
    assert page.inner_text("#delivered") == "1 of 1"
    assert page.inner_text("#why") == "Everything is delivered."
    go_to(page, 0.0)
    assert page.locator("#progress").is_hidden()
    assert page.text_content("#exploring h2") == "Explored 50 %"


def test_the_log_lists_events_and_seeks_on_click(page: playwright.Page, delivery_url: str) -> None:
    opened(page, delivery_url, at=0.0)
    log = page.locator("#log li")
    assert log.count() == 3 + 4 + 2 + 2  # narrations, actions, rules, mapping progress
    assert page.locator("#log .said").all_inner_texts()[1:3] == ["0:00\nMapped 40 %.", "0:02\nMapped 80 %."]
    assert log.filter(has_text=re.compile(r"N: robot\.y \+= 1 if no term holds$")).count() == 1
    narrower = log.filter(has_text=re.compile(r"N: robot\.y \+= 1 if not touch_N\(wall\)$"))
    assert narrower.get_attribute("title") == "0******, was 0000000: if not touch_N(robot, wall)"
    assert page.locator("#log li.later").count() == 9
    log.filter(has_text="PICKUP").click()
    settle(page)
    assert page.evaluate("player.time") == 8.0
    assert page.inner_text("#log li.here").endswith("PICKUP · touch_E(wall)")
    assert page.get_attribute("#log li.here", "title") == (
        "Condition 0010000: not touch_N(robot, wall) and not touch_S(robot, wall) and touch_E(robot, wall)"
        " and not touch_W(robot, wall) and not on(robot, box) and not on(robot, warehouse) and not box.in_bot"
    )


def test_of_log_lines_with_equal_times_the_clicked_one_is_marked(page: playwright.Page, delivery_url: str) -> None:
    opened(page, delivery_url, at=0.0)
    for words in ("DROPOFF", "Everything is delivered."):
        page.locator("#log li").filter(has_text=words).click()
        settle(page)
        assert words in page.inner_text("#log li.here")
        assert page.evaluate("player.time") == 10.0


def test_the_log_shows_six_lines_and_the_whole_current_one(page: playwright.Page, delivery_url: str) -> None:
    opened(page, delivery_url, at=7.5)
    assert page.evaluate("document.getElementById('log').clientHeight") >= 6 * 22
    inside = page.evaluate(
        """() => {
            const place = (name) => document.querySelector(name).getBoundingClientRect();
            const [list, line] = [place('#log'), place('#log li.here')];
            return list.top <= line.top + 1 && line.bottom <= list.bottom + 1;
        }"""
    )
    assert inside


def test_the_phase_is_that_of_the_current_action(page: playwright.Page, delivery_url: str) -> None:
    opened(page, delivery_url, at=3.9)
    phases = []
    for moment in (3.9, 4.5, 6.9, 7.5, 9.9, 10.0):
        go_to(page, moment)
        phases.append(page.inner_text("#phase"))
    assert phases == ["Explores", "Learns", "Learns", "Delivers", "Delivers", "Done"]
    assert page.evaluate("trace.phases().map(({ time }) => time)") == [0.0, 4.0, 7.0, 10.0]
    assert page.locator("#phases i").count() == 4


def test_arrow_keys_step_while_the_timeline_has_the_focus(page: playwright.Page, delivery_url: str) -> None:
    opened(page, delivery_url, at=4.5)
    page.locator("#seek").focus()
    for key, moment in (("ArrowRight", 5.0), ("ArrowRight", 7.0), ("ArrowLeft", 5.0)):
        page.keyboard.press(key)
        settle(page)
        assert page.evaluate("[player.time, Number(document.getElementById('seek').value)]") == [moment, moment]
    page.keyboard.press("Space")
    assert page.evaluate("player.playing") is True


def test_arrow_keys_select_log_lines(page: playwright.Page, delivery_url: str) -> None:
    opened(page, delivery_url, at=5.0)
    page.locator("#log").focus()
    lines = page.locator("#log li").all_inner_texts()
    here = lines.index(page.inner_text("#log li.here"))
    for key, line in (("ArrowDown", here + 1), ("ArrowDown", here + 2), ("ArrowUp", here + 1)):
        page.keyboard.press(key)
        settle(page)
        assert page.inner_text("#log li.here") == lines[line]


def legend(page: playwright.Page) -> list[str]:
    return page.locator("#legend label:visible, #legend p:visible").all_inner_texts()


def test_the_legend_lists_all_drawn_symbols(page: playwright.Page, delivery_url: str, taxi_url: str) -> None:
    opened(page, delivery_url, at=10.0)
    layers = [
        "Laser",
        "Particles",
        "Path",
        "Plan (cells)",
        "Path driven",
        "Boxes",
        "Warehouse",
        "Cells",
    ]
    drawn = ["Robot, fork ahead", "Wall", "Free", "Unknown"]
    assert legend(page) == [*layers, *drawn, "Explores", "Learns", "Delivers", "Done", "Box delivered"]
    opened(page, taxi_url, at=3.0)
    assert legend(page) == ["Cells", "Destination", "Passenger", "Taxi", "Wall", "Learns", "Uses its rules"]


def test_objects_of_a_grid_are_drawn_by_their_class(page: playwright.Page, taxi_url: str) -> None:
    opened(page, taxi_url, at=1.0)
    assert is_near(colour_at(page, 1.5, 1.5), "#222a35")  # the taxi
    assert is_near(colour_at(page, 0.5, 0.5), BROWN)  # the passenger
    assert is_near(colour_at(page, 3.5, 2.5), "#f5e2b8")  # the destination
    go_to(page, 2.0)
    assert is_near(colour_at(page, 2.5, 1.5), BROWN)  # in the taxi, although its own x and y are unchanged
    assert is_near(colour_at(page, 2.25, 1.5), "#222a35")
    assert is_near(colour_at(page, 0.5, 0.5), WHITE)


def test_experiments_differ_from_actions_that_lead_to_one(page: playwright.Page, taxi_url: str) -> None:
    opened(page, taxi_url, at=1.2)
    for moment, words in (
        (1.2, "An experiment: "),
        (1.7, "On the way to an experiment: "),
        (2.5, "Part of its plan: "),
    ):
        go_to(page, moment)
        assert page.inner_text("#why").startswith(words)
    acted = page.locator("#log .act span").all_inner_texts()
    tags = {"E": [" · experiment", " · to an experiment", ""], "N": [" · experiment"]}
    for action, expected in tags.items():
        lines = [line for line in acted if line[0] == action]
        assert lines == [f"{action} · no term holds{tag}" for tag in expected]


def test_the_help_dialog_explains_panels_and_keys(page: playwright.Page, delivery_url: str) -> None:
    opened(page, delivery_url, at=4.5)
    page.get_by_role("button", name="Explanations and keys").click()
    explained = page.locator("#help dt").all_inner_texts()
    assert {"Condition", "Learnt rules", "Unknown pairs", "Delivered", "Log"} <= set(explained)
    page.keyboard.press("Space")  # activates the focused button, which closes the dialog
    until(page, "!document.getElementById('help').open")
    assert page.evaluate("player.playing") is False
    page.keyboard.press("?")
    assert page.locator("#help").is_visible()
    page.keyboard.press("f")
    assert page.evaluate("scene.mode") == "fit"
    page.keyboard.press("Escape")
    assert page.locator("#help").is_hidden()


def test_the_estimated_pose_of_a_log_is_shown(page: playwright.Page, tmp_path: Path) -> None:
    encoder = Encoder()
    cloud = np.array([[1.3, 0.0, 0.0], [0.7, 0.0, 0.0], [1.0, 0.4, 0.0], [1.0, -0.4, 0.0]], np.float32)
    records: list[Record] = [
        RunStarted("localize", "walk.log"),
        MapUpdate(0.0, room(30), 1.0, 0.0),
        replace(snapshot_at(0.0, 1.0), particles=cloud),
    ]
    path = tmp_path / "page.html"
    frames = b"".join(encoder.encode(record) for record in records)
    path.write_text(player_page("A walk", {"source": "file"}, frames), encoding="utf-8")
    opened(page, path.as_uri(), at=0.0)
    shown = dict(zip(*(page.locator(f"#estimated {tag}").all_inner_texts() for tag in ("dt", "dd")), strict=True))
    assert shown == {
        "x": "1.00 m",
        "y": "0.00 m",
        "heading": "0°",
        "particles": "4",
        "particle spread (rms)": "0.35 m",  # √((0.3² + 0.3² + 0.4² + 0.4²) ÷ 4)
    }
    assert legend(page) == ["Laser", "Particles", "Path driven", "Robot", "Wall", "Free", "Unknown"]


def test_an_unknown_term_is_not_shown_as_false(page: playwright.Page, delivery_url: str) -> None:
    opened(page, delivery_url, at=3.0)
    assert page.get_attribute("#bits li >> nth=2", "aria-label") == "touch_E(robot, wall): unknown"
    go_to(page, 5.0)
    assert page.get_attribute("#bits li >> nth=2", "aria-label") == "touch_E(robot, wall): holds"


def test_a_mapped_log_shows_the_whole_map_and_path(page: playwright.Page, tmp_path: Path) -> None:
    encoder = Encoder()
    records: list[Record] = [
        RunStarted("map", "walk.log"),
        Narration(0.0, Phase.MAP, "I make a map."),
        *(snapshot_at(10.0 * step, 0.05 * step) for step in range(21)),
        MapUpdate(100.0, room(30), 0.5, 0.0),
        snapshot_at(210.0, 9.0),
    ]
    path = tmp_path / "page.html"
    frames = b"".join(encoder.encode(record) for record in records)
    path.write_text(player_page("A map", {"source": "file"}, frames), encoding="utf-8")
    opened(page, path.as_uri(), at=50.0)
    shows = """([x, y]) => {
        const [px, py] = scene.project(x, y);
        return px > 0 && px < scene.width && py > 0 && py < scene.height;
    }"""
    assert all(page.evaluate(shows, list(point)) for point in LASER)  # no map yet
    go_to(page, 210.0)
    assert all(page.evaluate(shows, point) for point in ([-1.0, -1.0], [-1.0, 2.9], [9.0, 0.0]))
    assert is_near(colour_at(page, 1.5, -0.6), WHITE)
    purple = colour_at(page, 0.05, 0.0)
    assert purple[2] > purple[0] > purple[1]  # the path driven, from its start
    assert page.locator("#layers label:visible").all_inner_texts() == ["Laser", "Path driven"]
    assert page.inner_text("#phase") == "Maps"
    assert "Mapped 40 % of the log." in page.inner_text("#log")


def test_the_current_leg_of_a_plan_is_highlighted(page: playwright.Page, delivery_url: str) -> None:
    opened(page, delivery_url, at=5.0)
    ends = "plan => legEnd(Float32Array.from(plan)) / 2"
    assert page.evaluate(ends, [0, 0, 0, 1, 0, 1, 0, 0]) == 1  # up, PICKUP, back
    assert page.evaluate(ends, [0, 0, 0, 0, 0, 1, 0, 1, 0, 0]) == 2  # PICKUP at once, up, DROPOFF
    assert page.evaluate(ends, [0, 0, 0, 1, 0, 2]) == 2
    ahead = "([x, y]) => [...aheadOf([x, y, 0], Float32Array.of(0, 0, 0, 1, 1, 1))]"
    assert page.evaluate(ahead, [0.125, 0.5]) == [0.125, 0.5, 0, 1, 1, 1]
    assert page.evaluate(ahead, [0.5, 0.5]) == [0, 0, 0, 1, 1, 1]  # the robot is not on the segment


def test_play_pause_step_and_scrub(page: playwright.Page, delivery_url: str) -> None:
    opened(page, delivery_url, at=0.0)
    page.select_option("#speed", "5")
    page.get_by_role("button", name="Play", exact=True).click()
    until(page, "player.time > 1")
    page.get_by_role("button", name="Pause", exact=True).click()
    stopped = page.evaluate("player.time")
    page.wait_for_timeout(150)
    assert page.evaluate("player.time") == stopped < 10
    go_to(page, 4.5)
    times = []
    for name in ("One step forward", "One step forward", "One step back"):
        page.get_by_role("button", name=name).click()
        times.append(page.evaluate("player.time"))
    assert times == [5.0, 7.0, 5.0]
    page.locator("#seek").fill("8.5")
    settle(page)
    assert page.evaluate("player.time") == 8.5
    assert page.inner_text("#clock") == "0:08 / 0:10"


def test_playback_at_speed_1_is_real_time(page: playwright.Page, delivery_url: str) -> None:
    opened(page, delivery_url, at=0.0)
    page.select_option("#speed", "1")
    before = page.evaluate("player.toggle(), performance.now()")
    page.wait_for_timeout(1000)
    now, shown = page.evaluate("[performance.now(), player.time]")
    assert shown == pytest.approx((now - before) / 1000, abs=0.3)


def test_keys_control_playback_and_view(page: playwright.Page, delivery_url: str) -> None:
    opened(page, delivery_url, at=4.5)
    press = page.keyboard.press
    press("ArrowRight")
    assert page.evaluate("player.time") == 5.0
    press("ArrowLeft")
    assert page.evaluate("player.time") == 4.0
    scale = page.evaluate("scene.scale")
    press("+")
    assert page.evaluate("scene.scale") > scale
    press("f")
    settle(page)
    assert page.evaluate("[scene.mode, scene.centre[0]]") == ["follow", 0.5]
    press("0")
    assert page.evaluate("scene.mode") == "fit"
    press("t")
    assert page.evaluate("document.documentElement.dataset.theme") == "dark"
    press("Space")
    assert page.evaluate("player.playing") is True
    page.locator("#canvas").focus()
    centre = page.evaluate("scene.centre[0]")
    press("ArrowLeft")
    assert page.evaluate("scene.centre[0]") < centre


def test_the_mouse_zooms_at_the_pointer_and_drags(page: playwright.Page, delivery_url: str) -> None:
    opened(page, delivery_url, at=4.2)
    place = page.evaluate("scene.unproject(300, 200)")
    left, top = page.evaluate("[scene.canvas.getBoundingClientRect().left, scene.canvas.getBoundingClientRect().top]")
    page.mouse.move(left + 300, top + 200)
    page.mouse.wheel(0, -300)
    until(page, "scene.mode === 'free'")
    assert page.evaluate("scene.unproject(300, 200)") == pytest.approx(place)
    page.mouse.down()
    page.mouse.move(left + 340, top + 220, steps=4)
    page.mouse.up()
    assert page.evaluate("scene.unproject(340, 220)") == pytest.approx(place)


def click_at(page: playwright.Page, x: float, y: float) -> str:
    """Click on a point of the map, m; the text of the inspector."""
    place = page.evaluate(
        "([x, y]) => { const [px, py] = scene.project(x, y), box = scene.canvas.getBoundingClientRect();"
        " return [box.left + px, box.top + py] }",
        [x, y],
    )
    page.mouse.click(*place)
    settle(page)
    return page.inner_text("#inspector")


def test_a_click_on_an_object_shows_its_attributes(page: playwright.Page, delivery_url: str) -> None:
    opened(page, delivery_url, at=5.2)
    box = click_at(page, *BOX)
    assert re.search(
        r"Box box1.*box\.x\s+5\s+box\.y\s+4\s+box\.in_bot\s+false\s+map\s+2\.50 m, 1\.50 m", box, re.DOTALL
    )
    robot = click_at(page, 0.5, 0.0)
    assert re.search(r"Robot.*robot\.x\s+2.*latch\s+empty.*particles\s+50", robot, re.DOTALL)
    assert "warehouse.x\n6" in click_at(page, 2.9, -0.1)
    assert re.search(r"P\(occupied\)\s+0 %", click_at(page, 1.5, -0.6))
    page.keyboard.press("Escape")
    settle(page)
    assert page.locator("#inspector").is_hidden()
    titles = []
    for _ in range(4):
        page.keyboard.press("o")
        settle(page)
        titles.append(page.inner_text("#inspector header span"))
    assert titles == ["Robot", "Box box1", "Warehouse", "Robot"]


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize(("size", "name"), [(DESK, "desk"), (PHONE, "phone")])
def test_the_page_fits_both_sizes_in_both_themes(
    page: playwright.Page, delivery_url: str, size: dict[str, int], name: str, theme: str
) -> None:
    page.set_viewport_size(size)  # type: ignore[arg-type]
    opened(page, delivery_url, at=7.5, theme=theme)
    SCREENSHOTS.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=SCREENSHOTS / f"{name}-{theme}.png")
    assert page.evaluate("document.documentElement.scrollWidth") <= size["width"]
    for button in page.locator("button:visible, select:visible, input[type=range]:visible").all():
        box = button.bounding_box()
        assert box is not None
        assert 0 <= box["x"] <= box["x"] + box["width"] <= size["width"]
        assert min(box["width"], box["height"]) >= 24  # WCAG 2.5.8


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_all_text_has_enough_contrast(page: playwright.Page, delivery_url: str, taxi_url: str, theme: str) -> None:
    page.emulate_media(reduced_motion="reduce")
    for url, frame_times in ((delivery_url, (1.0, 7.5, 10.0)), (taxi_url, (2.5,))):
        for moment in frame_times:
            opened(page, url, at=moment, theme=theme)
            assert faint_texts(page) == []
            assert page.evaluate("document.getAnimations().length") == 0
    page.keyboard.press("?")
    assert faint_texts(page) == []


def test_every_control_has_an_accessible_name(page: playwright.Page, delivery_url: str) -> None:
    opened(page, delivery_url, at=5.2)
    unnamed = page.evaluate(
        """() => [...document.querySelectorAll('button, select, input')]
            .filter((item) => !(item.ariaLabel || item.textContent.trim() || item.labels?.length))
            .map((item) => item.id)"""
    )
    assert unnamed == []


def test_text_of_a_trace_is_never_parsed_as_html(page: playwright.Page, tmp_path: Path) -> None:
    evil = "<img src=x onerror=alert(1)></script>"
    records = [record for record in short_run() if not isinstance(record, RobotSnapshot)]
    encoder = Encoder()
    frames = b"".join(
        encoder.encode(replace(item, text=evil) if isinstance(item, Narration) else item) for item in records
    )
    path = tmp_path / "page.html"
    path.write_text(player_page(evil, {"source": "file", "x": evil}, frames), encoding="utf-8")
    opened(page, path.as_uri(), at=1.0)
    assert evil in page.inner_text("#log")
    assert page.locator("img").count() == 0


def test_a_live_run_is_followed_until_its_end(page: playwright.Page, tmp_path: Path) -> None:
    broadcast = TraceBroadcast()
    records = short_run()
    with serve_run(broadcast, "A run", port=0, folder=tmp_path) as server:
        page.goto(server.url)
        assert page.locator("#waiting").is_visible()
        for record in records[:10]:
            broadcast(record)
        until(page, "trace.begin !== null")
        page.get_by_role("button", name="Live").click()
        for record in records[10:]:
            broadcast(record)
        until(page, "player.time === 10")
        assert page.inner_text("#link") == "live"
        assert page.locator("#report").is_hidden()
        (tmp_path / "report.html").write_text("<title>The report</title>")
        broadcast.end()
        until(page, "document.getElementById('link').textContent === 'run over'")
        with page.expect_popup() as report:
            page.get_by_role("link", name="Report").click()
        until(report.value, "document.title === 'The report'")
        report.value.close()
        assert page.evaluate("trace.records.RobotSnapshot.length") == sum(
            isinstance(record, RobotSnapshot) for record in records
        )
        assert page.locator("#notice").is_hidden()


SERVER_PROGRAM = """
import sys, time
sys.path.insert(0, sys.argv[1])
from wherry_testing.browsing import DESK, PHONE, SCREENSHOTS, until
from wherry_testing.runs import short_run
from wherry.views.web.broadcast import TraceBroadcast
from wherry.views.web.server import serve_run
broadcast = TraceBroadcast()
for record in short_run(): broadcast(record)
with serve_run(broadcast, "A run", port=0) as server:
    print(server.url, flush=True)
    time.sleep(60)
"""


def test_a_killed_server_is_reported_and_the_run_can_be_replayed(page: playwright.Page) -> None:
    command = [sys.executable, "-c", SERVER_PROGRAM, str(Path(__file__).parents[1])]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        page.goto(process.stdout.readline().strip())
        until(page, "trace.end === 10")
        process.send_signal(signal.SIGKILL)
    page.locator("#notice").wait_for(state="visible")
    assert "The server does not answer" in page.inner_text("#notice")
    go_to(page, 4.2)
    assert is_near(colour_at(page, *LASER[0]), BLUE)


def test_a_foreign_page_cannot_open_the_socket(browser: playwright.Browser) -> None:
    with serve_run(TraceBroadcast(), "A run", port=0) as server:
        page = browser.new_page()
        page.route("http://127.0.0.1:1/", lambda route: route.fulfill(body="<p>Elsewhere", content_type="text/html"))
        page.goto("http://127.0.0.1:1/")
        outcome = page.evaluate(
            """address => new Promise(done => {
                const socket = new WebSocket(address);
                socket.onopen = () => done('open');
                socket.onerror = () => done('refused');
            })""",
            server.url.replace("http", "ws") + "socket",
        )
        page.close()
    assert outcome == "refused"


def large_run() -> bytes:
    """Frames of a run of 20 s: a changing map of 100 × 100 m, 2,000 particles and 360 beams."""
    probability = np.full((2000, 2000), 0.02, np.float32)
    probability[::60], probability[:, ::80] = 0.95, 0.95
    encoder, rng = Encoder(), np.random.default_rng(0)
    frames = [encoder.encode(RunStarted("deliver", "big", terms=TERMS))]
    ring = np.linspace(0.0, 2 * np.pi, 360)
    points = 8.0 * np.column_stack([np.cos(ring), np.sin(ring)]).astype(np.float32)
    for step in range(100):
        if step % 10 == 0:
            probability[10 * step : 10 * step + 150, 900:1050] = rng.random((150, 150))
            frames.append(
                encoder.encode(MapUpdate(0.2 * step, OccupancyGrid(probability, 0.05, Pose(-50, -50)), 1.0, 0.0))
            )
        cloud = rng.normal(0.0, 10.0, (2000, 3)).astype(np.float32)
        frames.append(encoder.encode(replace(snapshot_at(0.2 * step, 0.05 * step), particles=cloud, points=points)))
    return b"".join(frames)


@pytest.mark.realtime
def test_a_large_map_with_two_thousand_particles_is_drawn_at_30_hz(page: playwright.Page, tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    path.write_text(player_page("big", {"source": "file"}, large_run()), encoding="utf-8")
    opened(page, path.as_uri(), at=0.0)
    page.evaluate("player.setSpeed(10); player.toggle()")
    shown = page.evaluate(
        """new Promise((done) => {
            const frame_times = [], times = [];
            const look = (now) => {
                frame_times.push(now);
                times.push(scene.instant.time);
                scene.context.getImageData(0, 0, 1, 1); // waits until the frame is drawn
                if (player.playing) requestAnimationFrame(look);
                else done({ frame_times, pictures: new Set(times).size });
            };
            requestAnimationFrame(look);
        })"""
    )
    frame_times = np.array(shown["frame_times"]) / 1000.0  # s
    rate = (len(frame_times) - 1) / (frame_times[-1] - frame_times[0])
    SCREENSHOTS.mkdir(parents=True, exist_ok=True)
    rate_text = (
        f"100 × 100 m, 2,000 particles: {rate:.1f} frames/s, the longest {1000 * np.diff(frame_times).max():.0f} ms"
    )
    (SCREENSHOTS / "smoothness.txt").write_text(f"{rate_text}\n", encoding="utf-8")
    assert shown["pictures"] > 0.9 * len(frame_times)  # each frame shows another time
    assert rate >= 30.0, rate_text


def test_a_recording_becomes_a_self_contained_file(page: playwright.Page, tmp_path: Path) -> None:
    with TraceRecorder(tmp_path / TRACE_FILE_NAME) as recorder:
        for record in short_run():
            recorder(record)
    out = tmp_path / "page.html"
    subprocess.run(
        [sys.executable, "-m", "wherry", "view", tmp_path, "--out", out], check=True, stdout=subprocess.DEVNULL
    )
    requests: list[str] = []
    page.on("request", lambda request: requests.append(request.url.split(":")[0]))
    opened(page, out.as_uri(), at=4.2)
    assert set(requests) <= {"file", "data"}
    assert is_near(colour_at(page, *LASER[0]), BLUE)


@pytest.mark.slow
def test_a_command_with_view_ends_when_its_page_is_closed(page: playwright.Page) -> None:
    command = [sys.executable, "-m", "wherry", "learn", "taxi", "--repetitions", "1", "--view", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        address = next(found for line in process.stdout if (found := re.search(r"http://\S+", line)))
        page.goto(address.group())
        page.wait_for_timeout(100)
        deadline = time.monotonic() + 60.0
        while not page.evaluate("trace.over"):
            assert time.monotonic() < deadline
            page.wait_for_timeout(100)
        assert page.evaluate("trace.records.RunStarted[0].subject") == "Taxi 5×5"
        assert page.evaluate("trace.records.LearntModel.at(-1).rules.length") >= 6
        page.goto("about:blank")
        assert process.wait(timeout=20) == 0
