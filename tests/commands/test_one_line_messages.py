"""What commands say about recordings and maps that they cannot use: one line that can be read at a glance."""

from __future__ import annotations

import gzip
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from wherry_testing.carmen_logs import drive_poses, write_carmen_log, write_room_map, write_scans
from wherry_testing.command_line import RunCommand
from wherry_testing.recorded_bags import SmallBag, link, quaternion

MAX_CHARACTERS = 300
LONG_PATTERN = "warehouse_7/robot_{}/sensors/front/lidar_2d_filtered"  # names as long as those of fleets
LONG = LONG_PATTERN.format(1)


TILTED = quaternion(0.5)


def good_log() -> Path:
    return write_carmen_log(Path("a.clf"), drive_poses())


def text(content: str) -> Callable[[], Path]:
    def write() -> Path:
        Path("a.clf").write_text(content)
        return Path("a.clf")

    return write


def changed(change: Callable[[list[str]], list[str]]) -> Callable[[], Path]:
    def write() -> Path:
        path = good_log()
        path.write_text("\n".join(change(path.read_text().splitlines())) + "\n")
        return path

    return write


def bag(fill: Callable[[SmallBag], object]) -> Callable[[], Path]:
    def write() -> Path:
        small = SmallBag("ros1")
        fill(small)
        return small.write(Path("a.bag"))

    return write


def frames(small: SmallBag) -> SmallBag:
    """Transforms of many frames with long names, none of which leads to the lidar."""
    return small.transforms([link(LONG_PATTERN.format(n), LONG_PATTERN.format(n + 100)) for n in range(40)]).drive()


def topics(small: SmallBag) -> SmallBag:
    """Scans of many lidars on topics with long names."""
    for n in range(40):
        small.scan(1.0, topic="/" + LONG_PATTERN.format(n), frame=LONG_PATTERN.format(n))
    return small


REFUSED: dict[str, tuple[Callable[[], Path], list[str]]] = {
    "no file": (lambda: Path("a.clf"), []),
    "an empty file": (text(""), []),
    "no log": (text("lorem ipsum\n" * 5), []),
    "binary": (lambda: Path("a.clf") if Path("a.clf").write_bytes(bytes(range(256)) * 20) else Path(), []),
    "a damaged archive": (
        lambda: Path("a.clf.gz") if Path("a.clf.gz").write_bytes(gzip.compress(b"x" * 999)[:-9]) else Path(),
        [],
    ),
    "a cut line": (changed(lambda lines: [*lines[:5], lines[5][:300], *lines[6:]]), []),
    "words for numbers": (changed(lambda lines: [line.replace("0.", "abc", 3) for line in lines]), ["--lenient"]),
    "time runs backwards": (changed(lambda lines: [*lines[5:], *lines[:5]]), []),
    "most lines are cut": (changed(lambda lines: [line[:300] for line in lines[:9]] + lines[9:]), ["--lenient"]),
    "no pose": (good_log, ["--lidar", "front"]),
    "no type": (good_log, ["--scan-topic", "/" + LONG]),
    "a topic of a text log": (good_log, ["--odom-topic", "/" + LONG]),
    "no backend": (good_log, ["--backend", "magic"]),
    "no resolution": (good_log, ["--resolution", "7"]),
    "no format": (good_log, ["--trajectory-format", "xml"]),
    "no graph": (good_log, ["--continue", "a.clf"]),
    "--start alone": (good_log, ["--start", "0,0,0"]),
    "--localize alone": (good_log, ["--localize"]),
    "relations of other times": (good_log, ["--relations", "relations.txt"]),
    "an empty bag": (bag(lambda small: small.declare("/scan", "sensor_msgs/msg/LaserScan")), []),
    "no transforms": (bag(lambda small: small.scan().drive()), []),
    "many frames": (bag(lambda small: frames(small).scan(frame=LONG)), []),
    "a tilted lidar": (
        bag(
            lambda small: small.scan(frame=LONG).transforms([link("base_link", LONG, rotation=quaternion(0.5))]).drive()
        ),
        [],
    ),
    "other topics": (bag(topics), ["--scan-topic", "/" + LONG + "_2"]),
    "no odometry of that name": (bag(lambda small: topics(small).drive()), ["--odom-topic", "/" + LONG]),
    "a zero quaternion": (
        bag(lambda small: small.scan(frame=LONG).transforms([link("base_link", LONG, rotation=(0, 0, 0, 0))]).drive()),
        [],
    ),
    "zero quaternions": (
        bag(lambda small: [small.scan(), *(small.odometry(t, orientation=(0, 0, 0, 0), topic=LONG) for t in range(9))]),
        ["--odom-topic", LONG],
    ),
    "no beams": (bag(lambda small: small.scan(ranges=[])), []),
    "backwards in a bag": (
        bag(lambda small: small.scan(9.0, topic=LONG).scan(3.0, topic=LONG, received=9.5)),
        [],
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refusals_are_one_short_line(run_command: RunCommand, case: str) -> None:
    write, arguments = REFUSED[case]
    Path("relations.txt").write_text("900 950 1 0 0 0 0 0\n")
    path = write()
    status, out, err = run_command("map", path, *arguments)
    assert (status, out) == (2, "")
    assert_short(err, beginning=("wherry: a.", "wherry: --", "wherry: relations.txt: "))


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("map.yaml", ""),
        ("map.yaml", "image: map.pgm\n"),
        ("map.yaml", "image: none.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n"),
        ("map.yaml", "image: map.pgm\nresolution: often\norigin: [0, 0, 0]\n"),
        ("map.yaml", "image: map.pgm\nresolution: 0.05\norigin: [0, 0]\nmode: fancy\n"),
        ("map.yaml", "image: [\n"),
        ("amcl.yaml", "amcl:\n  ros__parameters:\n    laser_max_range: far\n"),
        ("amcl.yaml", "amcl:\n  ros__parameters:\n    min_particles: 900\n    max_particles: 20\n"),
        (
            "amcl.yaml",
            "amcl: {ros__parameters: {}}\n" + "".join(f"/{LONG_PATTERN.format(n)}/amcl: {{}}\n" for n in range(30)),
        ),
        ("reference.tum", "900 0 0 0 0 0 0 1\n901 0 0 0 0 0 0 1\n"),
        ("reference.tum", "0 0 0 0 0 0 0 0\n"),
        ("reference.tum", "front\n"),
    ],
)
def test_refusals_of_other_files_are_one_short_line(run_command: RunCommand, name: str, content: str) -> None:
    log, map_file = good_log(), write_room_map(Path())
    Path(name).write_text(content)
    options = {"map.yaml": [], "amcl.yaml": ["--params", name], "reference.tum": ["--reference", name]}
    status, out, err = run_command("localize", log, "--map", map_file, *options[name])
    assert (status, out) == (2, "")
    assert_short(err, beginning=f"wherry: {name}: ")


def test_notes_are_short_lines(run_command: RunCommand) -> None:
    """Many faults at once, with long names."""
    small, rng = SmallBag("ros1"), np.random.default_rng(0)
    for n in range(60):
        stamp = 0.1 * n + (1e4 if n == 7 else 0.0)
        frame = LONG_PATTERN.format(n % 9 if n % 3 == 0 else 1)
        small.scan(
            stamp, topic="/" + LONG, frame=frame, received=0.1 * n, ranges=rng.uniform(1.0, 5.0, 10 - n % 3 // 2)
        )
    for n in range(30):
        small.odometry(0.1 * n, 0.01 * n, topic="/" + LONG_PATTERN.format("odom"), child=LONG_PATTERN.format("base"))
        small.odometry(0.1 * n, 0.01 * n, topic="/" + LONG_PATTERN.format("other"), child=LONG_PATTERN.format("other"))
    path = topics(frames(small)).write(Path("a.bag"))
    options = ["--lenient", "--lidar", "0,0,0", "--json"]
    status, out, err = run_command("map", path, *options, "--scan-topic", "/" + LONG)
    assert status in (0, 1), err
    result = json.loads(out)
    assert len(result["notes"]) > 2
    for line in (result["verdict"], *result["notes"]):
        assert_short(f"{line}\n", beginning="")


def test_the_verdict_on_another_building_is_a_short_line(run_command: RunCommand) -> None:
    rng = np.random.default_rng(0)
    log = write_scans(Path("a.clf"), [rng.uniform(0.5, 6.0, 181) for _ in range(16)], drive_poses())
    status, out, _ = run_command("localize", log, "--map", write_room_map(Path()), "--json", "-q")
    assert status == 1
    result = json.loads(out)
    for line in (result["verdict"], *result["notes"]):
        assert_short(f"{line}\n", beginning="")


def assert_short(text: str, beginning: str | tuple[str, ...]) -> None:
    """Assert that a text is one complete line of readable length."""
    line = text.removesuffix("\n")
    assert line.startswith(beginning)
    assert line.isprintable(), line
    assert len(line) <= MAX_CHARACTERS, line
    assert not line.endswith("…") or "; topics of " in line or "; frames of " in line, line
    assert not any(f" 1 {plural} " in f"{line} " for plural in ("scans", "lines", "messages", "beams", "words")), line
