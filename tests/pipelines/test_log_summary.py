"""Names, sizes, distances and notes of runs over logs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wherry.logs.lidar_log import LidarLog
from wherry.pipelines.logs.reading import recording_name
from wherry.pipelines.logs.summary import DriveSummary, MapExtent, as_sentences, driven_distance
from wherry.robot import Scan
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose
from wherry.space.trajectory import Trajectory


def poses(x: Floats) -> Floats:
    return np.column_stack([x, np.zeros((len(x), 2))])


def log(ranges: Floats, count: int) -> LidarLog:
    scans = tuple(Scan(0.5 * n, ranges, -0.1, 0.1, 0.0, 10.0) for n in range(count))
    return LidarLog(scans, (None,) * count, Trajectory(np.zeros(0), np.zeros((0, 3))), Pose(), (), ("read so",))


@pytest.mark.parametrize(
    ("path", "name"),
    [
        ("intel.clf.gz", "intel"),
        ("2024.05.01.log", "2024.05.01"),
        ("run.bag", "run"),
        ("run.mcap", "run"),
        ("plain", "plain"),
    ],
)
def test_results_are_named_after_the_file_without_its_format(tmp_path: Path, path: str, name: str) -> None:
    assert recording_name(tmp_path / path) == name


def test_results_are_named_after_a_folder_as_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "rosbag2_2024_05_01-12.30"
    folder.mkdir()
    assert recording_name(folder) == folder.name
    monkeypatch.chdir(folder)
    assert recording_name(Path()) == folder.name


def test_the_extent_of_a_map_is_that_of_its_known_cells() -> None:
    probability = np.full((100, 200), 0.5, np.float32)
    probability[20:60, 50:150] = 0.02
    probability[20, 50:150] = 0.98
    extent = MapExtent.of(OccupancyGrid(probability, 0.1, Pose()))
    assert extent.size == pytest.approx((10.0, 4.0))
    assert extent.free_area == pytest.approx(39 * 100 * 0.01)
    assert MapExtent.of(OccupancyGrid(np.full((9, 9), 0.5, np.float32), 0.1, Pose())).size == (0.0, 0.0)


def test_the_jitter_of_a_standing_robot_is_no_distance() -> None:
    jitter = 0.01 * np.random.default_rng(0).uniform(-1.0, 1.0, 1000)
    assert driven_distance(poses(jitter)) == 0.0
    assert driven_distance(poses(np.linspace(0.0, 7.0, 1000))) == pytest.approx(7.0, abs=0.05)
    assert driven_distance(poses(np.array([0.0, 1.0, 0.0]))) == 2.0


def test_what_a_log_cannot_show_is_noted() -> None:
    seen, blind = np.full(3, 2.0), np.full(3, np.inf)
    assert DriveSummary.of(log(seen, 3), poses(np.arange(3.0))).notes == ("Read so.",)
    assert DriveSummary.of(log(seen, 1), poses(np.zeros(1))).notes[1].startswith("The log has only one scan")
    still = DriveSummary.of(log(seen, 5), poses(np.zeros(5)))
    assert still.notes[1].startswith("The robot moved 0.00 m in 5 scans and 2.0 s: ")
    assert (still.distance_m, still.duration_s) == (0.0, 2.0)
    assert DriveSummary.of(log(blind, 3), poses(np.arange(3.0))).notes[1] == "Only 0 of 9 beams met anything."


def test_notes_are_sentences_and_said_once() -> None:
    notes = ["one scan", "Two.", "One scan.", "/scan is read", "time_increment is 0"]
    assert as_sentences(notes) == ("One scan.", "Two.", "/scan is read.", "time_increment is 0.")
