"""The snapshot drawing, the delivery report and the terminal output."""

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
    """A free grid of 2 × 1 m at (−1, 0.5) m; its lowest row is occupied, its last column unknown."""
    probability = np.zeros((10, 20), np.float32)
    probability[0], probability[:, -1] = 1.0, 0.5
    return OccupancyGrid(probability, 0.1, Pose(-1.0, 0.5))


BACKGROUND = MapBackground(
    grid(),
    warehouse=np.array([[[0.0, 1.0], [0.6, 1.0], [0.6, 1.6], [0.0, 1.6]]]),
    true_walls=np.array([[[-1.0, 0.55], [1.0, 0.55]]]),
    robot_radius=0.2,
    box_radius=0.1,
)
SNAPSHOT = RobotSnapshot(
    time=1.0,
    pose=Pose(0.25, 1.0, 0.5),
    lidar=Pose(0.1, 0.9, 0.5),
    points=np.array([[0.5, 0.6], [-0.9, 0.6]], np.float32),
    particles=np.array([[0.25, 1.0, 0.0], [0.3, 1.1, 0.0]], np.float32),
    path=np.array([[0.25, 1.0], [0.7, 1.2]], np.float32),
    boxes=np.array([[-0.5, 1.2]], np.float32),
    has_load=False,
)


def draw(
    background: MapBackground = BACKGROUND, snapshot: RobotSnapshot = SNAPSHOT, **options: object
) -> ElementTree.Element:
    """The drawing as XML."""
    driven, goals = np.array([[0.0, 0.8], [0.25, 1.0]]), np.array([[0.3, 0.9], [0.9, 0.9]])
    return ElementTree.fromstring(draw_snapshot(background, snapshot, driven, goals, label="The map", **options))  # type: ignore[arg-type]  # noqa: S314


def of_class(picture: ElementTree.Element, style: str) -> list[ElementTree.Element]:
    return [element for element in picture.iter() if element.get("class") == style]


def points(element: ElementTree.Element) -> list[list[float]]:
    return [[float(part) for part in pair.split(",")] for pair in (element.get("points") or "").split()]


def numbers(element: ElementTree.Element, *names: str) -> list[float]:
    return [float(element.get(name) or "nan") for name in names]


def test_every_layer_is_drawn_in_map_coordinates() -> None:
    picture = draw()
    assert points(of_class(picture, "warehouse")[0]) == BACKGROUND.warehouse[0].tolist()
    assert points(of_class(picture, "driven")[0]) == [[0.0, 0.8], [0.25, 1.0]]
    assert points(of_class(picture, "plan")[0]) == [[0.3, 0.9], [0.9, 0.9]]
    assert points(of_class(picture, "path")[0]) == [[0.25, 1.0], [0.7, 1.2]]
    assert numbers(of_class(picture, "truth")[0], "x1", "y1", "x2", "y2") == [-1.0, 0.55, 1.0, 0.55]
    assert [numbers(dot, "cx", "cy") for dot in of_class(picture, "laser")] == [[0.5, 0.6], [-0.9, 0.6]]
    assert numbers(of_class(picture, "beam")[0], "x1", "y1", "x2", "y2") == [0.1, 0.9, 0.5, 0.6]
    assert [numbers(stroke, "x1", "y1") for stroke in of_class(picture, "particle")] == [[0.25, 1.0], [0.3, 1.1]]
    assert numbers(of_class(picture, "box")[0], "cx", "cy", "r") == [-0.5, 1.2, 0.1]
    assert numbers(of_class(picture, "lidar")[0], "cx", "cy") == [0.1, 0.9]


def test_north_is_up_and_the_picture_contains_the_known_map() -> None:
    picture = draw()
    left, top, width, height = (float(part) for part in (picture.get("viewBox") or "").split())
    assert (left, top) == (0.0, 0.0)
    # The centres of known cells reach from (−0.95, 0.55) to (0.85, 1.45).
    assert (width, height) == pytest.approx((1.8 + 2 * MARGIN, 0.9 + 2 * MARGIN))
    transform = next(group.get("transform") or "" for group in picture.iter(f"{SVG}g"))
    west, north = (float(part) for part in re.findall(r"translate\(([-.\d]+) ([-.\d]+)\) scale\(1 -1\)", transform)[0])
    assert (-west, north) == pytest.approx((-0.95 - MARGIN, 1.45 + MARGIN))


def test_the_embedded_image_is_the_map() -> None:
    image = next(draw().iter(f"{SVG}image"))
    kind, data = (image.get("href") or "").split(",")
    assert kind == "data:image/png;base64"
    pixels = np.asarray(Image.open(io.BytesIO(base64.b64decode(data))))
    grey, alpha = pixels[..., 0].astype(int), pixels[..., 1]
    np.testing.assert_array_equal(alpha == 0, BACKGROUND.grid.unknown)
    np.testing.assert_array_equal((grey < 128) & (alpha > 0), BACKGROUND.grid.occupied)
    assert numbers(image, "width", "height") == pytest.approx([2.0, 1.0])
    assert "translate(-1.0000 0.5000)" in (image.get("transform") or "")


def test_the_load_is_drawn_in_the_fork() -> None:
    assert len(of_class(draw(), "box")) == 1
    assert len(of_class(draw(snapshot=replace(SNAPSHOT, has_load=True)), "box")) == 2


def test_a_close_up_is_centred_on_the_robot() -> None:
    picture = draw(around_robot=0.8)
    assert (picture.get("viewBox") or "").split()[2:] == ["1.600", "1.600"]
    transform = next(group.get("transform") or "" for group in picture.iter(f"{SVG}g"))
    assert transform.startswith("translate(0.550 1.800)")


def test_empty_layers_draw_nothing() -> None:
    nothing = replace(SNAPSHOT, points=NO_POINTS, particles=np.empty((0, 3)), path=NO_POINTS, boxes=NO_POINTS)
    background = replace(BACKGROUND, warehouse=np.empty((0, 4, 2)), true_walls=np.empty((0, 2, 2)))
    picture = ElementTree.fromstring(draw_snapshot(background, nothing, NO_POINTS, NO_POINTS, label="x"))  # noqa: S314
    for style in ("warehouse", "truth", "driven", "plan", "path", "laser", "beam", "particle", "box"):
        assert of_class(picture, style) == []
    assert len(of_class(picture, "robot")) == 1


def test_large_particle_sets_are_subsampled() -> None:
    many = replace(SNAPSHOT, particles=np.zeros((5 * MAX_PARTICLES + 1, 3), np.float32))
    assert MAX_PARTICLES / 2 < len(of_class(draw(snapshot=many), "particle")) <= MAX_PARTICLES


def test_an_unknown_map_can_be_draw() -> None:
    unknown = OccupancyGrid(np.full((3, 3), 0.5, np.float32), 0.1)
    assert draw(replace(BACKGROUND, grid=unknown)).tag == f"{SVG}svg"


@pytest.mark.parametrize("label", ['a "quoted" map', "<b> & more"])
def test_labels_are_escaped(label: str) -> None:
    picture = ElementTree.fromstring(draw_snapshot(BACKGROUND, SNAPSHOT, NO_POINTS, NO_POINTS, label=label))  # noqa: S314
    assert picture.get("aria-label") == label


MARKUP = "<script>alert('x')</script> & \"more\""


def report(text: str) -> DeliveryReport:
    pictures = [
        ReportPicture(draw_snapshot(BACKGROUND, SNAPSHOT, NO_POINTS, NO_POINTS, label=text), text) for _ in range(2)
    ]
    return DeliveryReport(text, text, True, text, pictures, {text: text}, [text], [Narration(1.0, Phase.LEARN, text)])


def test_all_text_of_the_report_is_escaped() -> None:
    page = render_report(report(MARKUP))
    assert "<script" not in page
    assert page.count("alert(") >= 9  # label and caption of two pictures, and every other text
    assert "&lt;script&gt;" in page


def test_the_report_is_self_contained() -> None:
    page = render_report(report("Delivery"))
    without_names = page.replace("http://www.w3.org/2000/svg", "")
    assert not re.search(r"(https?:)?//[a-z]", without_names)
    assert not re.search(r"<(script|link|iframe)\b|@import|url\(", page)
    assert not [link for link in re.findall(r'(?:src|href)="([^"]*)"', page) if not link.startswith("data:")]


def test_the_report_shows_metrics_rules_and_log() -> None:
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
    SNAPSHOT,
    RunStarted("deliver", "hall", terms=TERMS),
    StepTaken(2.0, "0000100", "PICKUP", True, True, 3, 0, 2, NO_POINTS.astype(np.float32)),
    StepTaken(3.0, "0101011", "DROPOFF", False, True, 0, 1, 1, NO_POINTS.astype(np.float32)),
]


def terminal_output(*, is_terminal: bool) -> str:
    """The output of a run."""
    out = io.StringIO()
    console = Console(file=out, force_terminal=is_terminal, width=120, _environ={"TERM": "xterm"})
    with DeliveryProgress(console, 2) as progress:
        for record in RUN:
            progress(record)
    return out.getvalue()


def test_without_a_terminal_only_narrations_are_printed() -> None:
    assert terminal_output(is_terminal=False) == "    0.1 s  explore  I drive to [where] my laser will see most.\n"


def test_a_terminal_shows_three_bars() -> None:
    text = terminal_output(is_terminal=True)
    for words in (
        "explored",
        "50%, 3.0 m of frontier left",
        "0 unknown pairs left",
        "DROPOFF · touch_S(robot, wall), touch_W",
        "1 of 2 boxes",
    ):
        assert words in text


def test_tables_and_rules_are_printed_without_markup() -> None:
    out = io.StringIO()
    console = Console(file=out, width=100)
    print_table(console, "Result", {"map error": "1.2 cm"})
    print_rules(console, ["N: if [not] touch_N: robot.y += 1"])
    text = out.getvalue()
    assert "Result" in text
    assert re.search(r"map error\W+1\.2 cm", text)
    assert "  N: if [not] touch_N: robot.y += 1\n" in text
