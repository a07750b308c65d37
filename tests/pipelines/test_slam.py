"""Mapping of logs: files, metrics, and rejected input."""

from __future__ import annotations

import io
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from wherry.errors import InputError
from wherry.logs.options import ReadingOptions
from wherry.logs.reading import read_log
from wherry.logs.tables import read_odometry
from wherry.mapping.graph_slam import GraphSlam
from wherry.mapping.saved_graph import load_graph
from wherry.pipelines.logs.mapping import MappingSettings, prepare, run
from wherry.pipelines.logs.pictures import ACCEPTED_COLOUR, REJECTED_COLOUR, TRAJECTORY_COLOUR, draw_map
from wherry.space.map_files import load_map
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry.space.raycast import cast_rays
from wherry.views.map_picture import MIN_WIDTH


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive of 3 m through a room of 6 × 4 m, as a CARMEN log."""
    room = np.pad(np.zeros((80, 120), np.bool_), 1, constant_values=True)
    room[30:40, 60:70] = True
    angles = np.linspace(-math.pi / 2, math.pi / 2, 181)
    lines = []
    for n in range(16):
        pose = np.array([[1.0 + 0.1 * n, 1.0 + 0.05 * n, 0.05 * n]])
        ranges = cast_rays(room, 0.05, Pose(), pose, angles, 20.0)[0]
        place = " ".join(f"{value:.6f}" for value in pose[0])
        lines.append(f"FLASER 181 {' '.join(f'{r:.3f}' for r in ranges)} {place} {place} {n}.0 host {n}.0\n")
    path = tmp_path_factory.mktemp("log") / "room.clf"
    path.write_text("".join(lines))
    (path.parent / "room.relations").write_text("0 15 1.5 0.75 0 0 0 0.75\n2 8 0.626952 0.238601 0 0 0 0.3\n")
    return path


@pytest.mark.parametrize(("backend", "tolerance"), [("graph", 0.05), ("particles", 0.08)])
def test_a_log_becomes_a_map(log: Path, tmp_path: Path, backend: str, tolerance: float) -> None:
    settings = MappingSettings(log, relations=log.parent / "room.relations", backend=backend, out=tmp_path / "out")
    mapping = prepare(settings)
    assert list(mapping.steps()) == list(range(17))
    result = mapping.result
    assert (result.scans, result.relations, result.skipped) == (16, 2, 0)
    assert result.translational_error_m is not None
    assert result.translational_error_m < tolerance
    assert result.far_translational_error_m is None
    assert result.seconds > 0.0
    assert result.ms_per_scan_median <= result.ms_per_scan_p99
    grid = load_map(tmp_path / "out" / "map.yaml")
    assert grid.occupied.sum() > 100
    assert len(read_odometry(tmp_path / "out" / "trajectory.tum").times) == 16
    with Image.open(tmp_path / "out" / "map.png") as picture:
        assert picture.width >= grid.shape[1]
        assert picture.height > grid.shape[0]
    if backend == "graph":
        assert len(load_graph(tmp_path / "out" / "graph.npz").keyframes) > 3


@pytest.mark.parametrize("backend", ["graph", "particles"])
def test_the_same_seed_gives_the_same_bytes(log: Path, tmp_path: Path, backend: str) -> None:
    for name in ("a", "b"):
        run(MappingSettings(log, backend=backend, out=tmp_path / name, seed=3))
    files = sorted(path.name for path in (tmp_path / "a").iterdir())
    assert "map.pgm" in files
    for name in files:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name


@pytest.mark.parametrize(("backend", "tolerance"), [("graph", 0.05), ("particles", 0.1)])
def test_odometry_that_never_changes_does_not_keep_the_robot_in_place(
    log: Path, tmp_path: Path, backend: str, tolerance: float
) -> None:
    constant = tmp_path / "constant.clf"
    lines = [line.split() for line in log.read_text().splitlines()]
    constant.write_text("".join(f"{' '.join([*words[:183], *['0'] * 6, *words[189:]])}\n" for words in lines))
    mapping = prepare(MappingSettings(constant, relations=log.parent / "room.relations", backend=backend))
    for _ in mapping.steps():
        pass
    assert mapping.result.translational_error_m is not None
    assert mapping.result.translational_error_m < tolerance
    assert mapping.slam.odometry_contradictions


def test_without_relations_and_folder_nothing_is_scored_or_written(log: Path) -> None:
    result = run(MappingSettings(log))
    assert result.translational_error_m is None
    assert result.relations == 0


def test_invalid_settings_are_named(log: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for settings, source in (
        (MappingSettings(log, backend="magic"), "--backend"),
        (MappingSettings(log, resolution=0.0), "--resolution"),
        (MappingSettings(log, resolution=math.nan), "--resolution"),
        (MappingSettings(tmp_path / "none.log"), "none.log"),
        (MappingSettings(log, relations=log), "room.clf"),
        (MappingSettings(log, odometry=log), "room.clf"),
        (MappingSettings(log, out=tmp_path / "file" / "out"), "out"),
    ):
        with pytest.raises(InputError) as caught:
            prepare(settings)
        assert source in caught.value.source


@pytest.fixture(scope="module")
def mapped(log: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of mapping the log."""
    out = tmp_path_factory.mktemp("mapped")
    run(MappingSettings(log, out=out))
    return out


@pytest.fixture(scope="module")
def next_day(log: Path) -> Path:
    """The same drive with times a hundred seconds later."""
    path = log.parent / "next.clf"
    lines = [line.split() for line in log.read_text().splitlines()]
    path.write_text("".join(f"{' '.join(words[:-3])} {float(words[-3]) + 100.0} host 0\n" for words in lines))
    return path


def test_mapping_continues_from_a_saved_graph(log: Path, mapped: Path, next_day: Path, tmp_path: Path) -> None:
    result = run(MappingSettings(next_day, graph=mapped / "graph.npz", start=Pose(0.2, 0.1, 0.1), out=tmp_path))
    assert result.scans == 16
    both = read_odometry(tmp_path / "trajectory.tum")
    assert len(both.times) == 32
    np.testing.assert_allclose(both.poses[16:, :2], both.poses[:16, :2], atol=0.05)
    assert len(load_graph(tmp_path / "graph.npz").keyframes) > len(load_graph(mapped / "graph.npz").keyframes)


def test_localizing_does_not_change_the_map(log: Path, mapped: Path, next_day: Path, tmp_path: Path) -> None:
    run(MappingSettings(next_day, graph=mapped / "graph.npz", start=Pose(), localize=True, out=tmp_path))
    assert (tmp_path / "map.pgm").read_bytes() == (mapped / "map.pgm").read_bytes()
    assert not (tmp_path / "graph.npz").exists()
    localized, first = read_odometry(tmp_path / "trajectory.tum"), read_odometry(mapped / "trajectory.tum")
    np.testing.assert_allclose(localized.poses[:, :2], first.poses[:, :2], atol=0.05)


def test_options_that_cannot_continue_a_graph_are_named(log: Path, mapped: Path, next_day: Path) -> None:
    graph, mount = mapped / "graph.npz", ReadingOptions(lidar=Pose(0.1))
    for settings, source, reason in (
        (MappingSettings(next_day, localize=True), "--localize", "--continue"),
        (MappingSettings(next_day, start=Pose()), "--start", "--continue"),
        (MappingSettings(next_day, relations=log.parent / "room.relations"), "room.relations", "no relation within"),
        (MappingSettings(next_day, graph=graph, backend="particles"), "--backend", "cannot continue"),
        (MappingSettings(log, graph=graph), "room.clf", "time runs backwards"),
        (MappingSettings(next_day, graph=graph, start=Pose(50.0)), "next.clf", "matches the map at no pose"),
        (MappingSettings(next_day, graph=log), "room.clf", "not a saved pose graph"),
        (
            MappingSettings(next_day, graph=graph, reading=mount),
            "next.clf",
            r"the lidar at \(0.1.*graph at \(0.0.*--lidar",
        ),
        (MappingSettings(next_day, graph=graph, resolution=0.1), "--resolution", "cannot be changed by --continue"),
    ):
        with pytest.raises(InputError, match=reason) as caught:
            prepare(settings)
        assert source in caught.value.source


def test_relations_outside_of_the_log_are_not_scored(log: Path) -> None:
    path = log.parent / "more.relations"
    path.write_text((log.parent / "room.relations").read_text() + "0 500 9 9 0 0 0 0\n")
    result = run(MappingSettings(log, relations=path))
    assert result.relations == 2
    assert f"1 of 3 relations of {path} are beyond the log's time: they are left out." in result.notes


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["graph", "particles"])
def test_one_thread_or_two_write_the_same_bytes(log: Path, tmp_path: Path, backend: str) -> None:
    code = (
        "import sys; from pathlib import Path; from wherry.pipelines.logs.mapping import MappingSettings, run;"
        "run(MappingSettings(Path(sys.argv[1]), backend=sys.argv[2], out=Path(sys.argv[3])))"
    )
    for threads in ("1", "2"):
        names = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
        environment = {**os.environ, **dict.fromkeys(names, threads)}
        command = [sys.executable, "-c", code, str(log), backend, str(tmp_path / threads)]
        subprocess.run(command, env=environment, check=True)
    files = sorted(path.name for path in (tmp_path / "1").iterdir())
    assert {"map.pgm", "trajectory.tum"} <= set(files)
    for name in files:
        assert (tmp_path / "1" / name).read_bytes() == (tmp_path / "2" / name).read_bytes(), name


def test_the_picture_of_a_narrow_map_is_wide_enough_for_its_legend(log: Path) -> None:
    narrow = OccupancyGrid(np.full((1000, 3), 0.5, np.float32), 0.05, Pose())
    wide = OccupancyGrid(np.full((3, 1000), 0.5, np.float32), 0.05, Pose())
    slam = GraphSlam()
    slam.add(read_log(log).scans[0])
    for grid in (narrow, wide):
        image = Image.open(io.BytesIO(draw_map(grid, slam)))
        assert image.width == max(MIN_WIDTH, grid.shape[1])
        assert image.height > grid.shape[0]
        colours = {colour for _, colour in image.getcolors(1_000_000) or []}
        assert {TRAJECTORY_COLOUR, ACCEPTED_COLOUR, REJECTED_COLOUR} <= colours
