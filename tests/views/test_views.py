"""What people look at: the drawing has everything where it is, the page stands alone, the terminal keeps to lines."""

from __future__ import annotations

import base64
import io
import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image
from rich.console import Console

from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry.trace.records import MapUpdate, Narration, Phase, Record, RobotSnapshot, RunStarted, StepTaken
from wherry.views.report import DeliveryReport, ReportPicture, render_report
from wherry.views.snapshot_svg import MARGIN, MAX_PARTICLES, MapBackground, draw_snapshot
from wherry.views.terminal import DeliveryProgress, print_rules, print_table
from wherry_testing.runs import TERMS

SVG = "{http://www.w3.org/2000/svg}"
NO_POINTS = np.empty((0, 2))


def grid() -> OccupancyGrid:
    """2 × 1 m from (−1, 0.5): free, its lowest row occupied, its last column unknown."""
    probability = np.zeros((10, 20), np.float32)
    probability[0], probability[:, -1] = 1.0, 0.5
    return OccupancyGrid(probability, 0.1, Pose(-1.0, 0.5))


SCENE = MapBackground(
    grid(),
    warehouse=np.array([[[0.0, 1.0], [0.6, 1.0], [0.6, 1.6], [0.0, 1.6]]]),
    true_walls=np.array([[[-1.0, 0.55], [1.0, 0.55]]]),
    robot_radius=0.2,
    box_radius=0.1,
)
SEEN = RobotSnapshot(
    time=1.0,
    pose=Pose(0.25, 1.0, 0.5),
    lidar=Pose(0.1, 0.9, 0.5),
    points=np.array([[0.5, 0.6], [-0.9, 0.6]], np.float32),
    particles=np.array([[0.25, 1.0, 0.0], [0.3, 1.1, 0.0]], np.float32),
    path=np.array([[0.25, 1.0], [0.7, 1.2]], np.float32),
    boxes=np.array([[-0.5, 1.2]], np.float32),
    has_load=False,
)


def drawn(scene: MapBackground = SCENE, seen: RobotSnapshot = SEEN, **options: object) -> ElementTree.Element:
    """The picture as XML."""
    driven, goals = np.array([[0.0, 0.8], [0.25, 1.0]]), np.array([[0.3, 0.9], [0.9, 0.9]])
    return ElementTree.fromstring(draw_snapshot(scene, seen, driven, goals, label="The map", **options))  # type: ignore[arg-type]  # noqa: S314


def of_class(picture: ElementTree.Element, style: str) -> list[ElementTree.Element]:
    return [element for element in picture.iter() if element.get("class") == style]


def points(element: ElementTree.Element) -> list[list[float]]:
    return [[float(part) for part in pair.split(",")] for pair in (element.get("points") or "").split()]


def numbers(element: ElementTree.Element, *names: str) -> list[float]:
    return [float(element.get(name) or "nan") for name in names]


def test_every_layer_is_drawn_where_it_is_in_the_map() -> None:
    picture = drawn()
    assert points(of_class(picture, "warehouse")[0]) == SCENE.warehouse[0].tolist()
    assert points(of_class(picture, "driven")[0]) == [[0.0, 0.8], [0.25, 1.0]]
    assert points(of_class(picture, "plan")[0]) == [[0.3, 0.9], [0.9, 0.9]]
    assert points(of_class(picture, "path")[0]) == [[0.25, 1.0], [0.7, 1.2]]
    assert numbers(of_class(picture, "truth")[0], "x1", "y1", "x2", "y2") == [-1.0, 0.55, 1.0, 0.55]
    assert [numbers(dot, "cx", "cy") for dot in of_class(picture, "laser")] == [[0.5, 0.6], [-0.9, 0.6]]
    assert numbers(of_class(picture, "beam")[0], "x1", "y1", "x2", "y2") == [0.1, 0.9, 0.5, 0.6]
    assert [numbers(stroke, "x1", "y1") for stroke in of_class(picture, "particle")] == [[0.25, 1.0], [0.3, 1.1]]
    assert numbers(of_class(picture, "box")[0], "cx", "cy", "r") == [-0.5, 1.2, 0.1]
    assert numbers(of_class(picture, "lidar")[0], "cx", "cy") == [0.1, 0.9]


def test_north_is_up_and_the_whole_known_map_is_in_the_picture() -> None:
    picture = drawn()
    left, top, width, height = (float(part) for part in (picture.get("viewBox") or "").split())
    assert (left, top) == (0.0, 0.0)
    # Known cells' middles reach from (−0.95, 0.55) to (0.85, 1.45).
    assert (width, height) == pytest.approx((1.8 + 2 * MARGIN, 0.9 + 2 * MARGIN))
    transform = next(group.get("transform") or "" for group in picture.iter(f"{SVG}g"))
    west, north = (float(part) for part in re.findall(r"translate\(([-.\d]+) ([-.\d]+)\) scale\(1 -1\)", transform)[0])
    assert (-west, north) == pytest.approx((-0.95 - MARGIN, 1.45 + MARGIN))


def test_the_maps_image_is_the_map() -> None:
    image = next(drawn().iter(f"{SVG}image"))
    kind, data = (image.get("href") or "").split(",")
    assert kind == "data:image/png;base64"
    pixels = np.asarray(Image.open(io.BytesIO(base64.b64decode(data))))
    grey, alpha = pixels[..., 0].astype(int), pixels[..., 1]
    np.testing.assert_array_equal(alpha == 0, SCENE.grid.unknown)
    np.testing.assert_array_equal((grey < 128) & (alpha > 0), SCENE.grid.occupied)
    assert numbers(image, "width", "height") == pytest.approx([2.0, 1.0])
    assert "translate(-1.0000 0.5000)" in (image.get("transform") or "")


def test_the_load_is_drawn_in_the_fork() -> None:
    assert len(of_class(drawn(), "box")) == 1
    assert len(of_class(drawn(seen=replace(SEEN, has_load=True)), "box")) == 2


def test_a_close_up_shows_the_robot_in_its_middle() -> None:
    picture = drawn(around_robot=0.8)
    assert (picture.get("viewBox") or "").split()[2:] == ["1.600", "1.600"]
    transform = next(group.get("transform") or "" for group in picture.iter(f"{SVG}g"))
    assert transform.startswith("translate(0.550 1.800)")


def test_what_is_not_there_is_not_drawn() -> None:
    nothing = replace(SEEN, points=NO_POINTS, particles=np.empty((0, 3)), path=NO_POINTS, boxes=NO_POINTS)
    scene = replace(SCENE, warehouse=np.empty((0, 4, 2)), true_walls=np.empty((0, 2, 2)))
    picture = ElementTree.fromstring(draw_snapshot(scene, nothing, NO_POINTS, NO_POINTS, label="x"))  # noqa: S314
    for style in ("warehouse", "truth", "driven", "plan", "path", "laser", "beam", "particle", "box"):
        assert of_class(picture, style) == []
    assert len(of_class(picture, "robot")) == 1


def test_thousands_of_particles_are_thinned() -> None:
    many = replace(SEEN, particles=np.zeros((5 * MAX_PARTICLES + 1, 3), np.float32))
    assert MAX_PARTICLES / 2 < len(of_class(drawn(seen=many), "particle")) <= MAX_PARTICLES


def test_a_map_that_knows_nothing_can_be_drawn() -> None:
    unknown = OccupancyGrid(np.full((3, 3), 0.5, np.float32), 0.1)
    assert drawn(replace(SCENE, grid=unknown)).tag == f"{SVG}svg"


@pytest.mark.parametrize("label", ['a "quoted" map', "<b> & more"])
def test_a_label_cannot_break_the_picture(label: str) -> None:
    picture = ElementTree.fromstring(draw_snapshot(SCENE, SEEN, NO_POINTS, NO_POINTS, label=label))  # noqa: S314
    assert picture.get("aria-label") == label


EVIL = "<script>alert('x')</script> & \"more\""


def report(words: str) -> DeliveryReport:
    pictures = [ReportPicture(draw_snapshot(SCENE, SEEN, NO_POINTS, NO_POINTS, label=words), words) for _ in range(2)]
    return DeliveryReport(
        words, words, True, words, pictures, {words: words}, [words], [Narration(1.0, Phase.LEARN, words)]
    )


def test_every_text_on_the_page_is_escaped() -> None:
    page = render_report(report(EVIL))
    assert "<script" not in page
    assert page.count("alert(") >= 9  # two pictures with label and caption, and every other text
    assert "&lt;script&gt;" in page


def test_the_page_needs_nothing_from_outside() -> None:
    page = render_report(report("Delivery"))
    without_names = page.replace("http://www.w3.org/2000/svg", "")
    assert not re.search(r"(https?:)?//[a-z]", without_names)
    assert not re.search(r"<(script|link|iframe)\b|@import|url\(", page)
    assert not [link for link in re.findall(r'(?:src|href)="([^"]*)"', page) if not link.startswith("data:")]


def test_the_page_shows_figures_rules_and_log() -> None:
    page = render_report(
        replace(
            report("x"), metrics={"actions": "42"}, rules=["N: robot.y += 1"], log=[Narration(7.4, Phase.LEARN, "Hm")]
        )
    )
    assert "<td>actions</td><td>42</td>" in page
    assert "N: robot.y += 1" in page
    assert "<td>7 s</td><td>learn</td><td>Hm</td>" in page
    assert page.count("<svg") == 2


RUN: list[Record] = [
    Narration(0.1, Phase.EXPLORE, "I drive to [where] my laser will see most."),
    MapUpdate(1.0, grid(), 0.5, 3.0),
    SEEN,
    RunStarted("deliver", "hall", terms=TERMS),
    StepTaken(2.0, "0000100", "PICKUP", True, True, 3, 0, 2, NO_POINTS.astype(np.float32)),
    StepTaken(3.0, "0101011", "DROPOFF", False, True, 0, 1, 1, NO_POINTS.astype(np.float32)),
]


def shown(*, terminal: bool) -> str:
    """What a run prints."""
    out = io.StringIO()
    console = Console(file=out, force_terminal=terminal, width=120, _environ={"TERM": "xterm"})
    with DeliveryProgress(console, 2) as progress:
        for record in RUN:
            progress(record)
    return out.getvalue()


def test_without_a_terminal_there_are_lines_and_no_bars() -> None:
    assert shown(terminal=False) == "    0.1 s  explore  I drive to [where] my laser will see most.\n"


def test_on_a_terminal_there_are_three_bars() -> None:
    text = shown(terminal=True)
    for words in (
        "explored",
        "50%, 3.0 m of frontier left",
        "0 unknown pairs left",
        "DROPOFF · touch_S(robot, wall), touch_W",
        "1 of 2 boxes",
    ):
        assert words in text


def test_tables_and_rules_are_printed_as_they_are() -> None:
    out = io.StringIO()
    console = Console(file=out, width=100)
    print_table(console, "Result", {"map error": "1.2 cm"})
    print_rules(console, ["N: if [not] touch_N: robot.y += 1"])
    text = out.getvalue()
    assert "Result" in text
    assert re.search(r"map error\W+1\.2 cm", text)
    assert "  N: if [not] touch_N: robot.y += 1\n" in text
