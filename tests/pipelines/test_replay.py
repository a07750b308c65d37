"""Replay of a bag: mapping of its scans, and localization of them on the map."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.floorplan.world_files import find_world
from wherry.pipelines.logs.replay import ReplayRun, ReplaySettings, prepare
from wherry.robot import Odometry, Scan
from wherry.ros.bags.run_recorder import RunRecorder
from wherry.ros.bags.writer import BagWriter
from wherry.simulation import build
from wherry.space.pose import Pose
from wherry_testing.recorded_drives import SCANS, RecordedDrive, record_drive


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> RecordedDrive:
    return record_drive(tmp_path_factory.mktemp("drive"))


def replayed(bag: Path, out: Path, map_file: Path | None = None, seed: int = 0) -> ReplayRun:
    """A replay after its last step."""
    run = prepare(ReplaySettings(bag, out, map_file, seed=seed))
    for _ in run.steps():
        pass
    return run


def files_of(folder: Path) -> dict[str, bytes]:
    """The contents of all files in a folder by their relative paths."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def test_bag_is_mapped_and_localized_on_its_map(drive: RecordedDrive, tmp_path: Path) -> None:
    run = replayed(drive.ros1, tmp_path, seed=3)
    assert run.mapping is not None
    assert run.mapping.scans == run.localization.scans == SCANS
    assert run.localization.rmse_m is not None
    assert run.localization.rmse_m < 0.05  # to the trajectory from mapping
    assert np.hypot(*np.subtract(run.localization.final_pose[:2], (drive.end.x, drive.end.y))) < 0.05
    assert run.localization.lost_fraction < 0.05
    names = set(files_of(tmp_path))
    assert names >= {"mapping/map.yaml", "mapping/map.png", "mapping/trajectory.tum", "localization/localization.png"}


def test_stages_are_reported_scan_by_scan(drive: RecordedDrive, tmp_path: Path) -> None:
    steps = list(prepare(ReplaySettings(drive.ros1, tmp_path)).steps())
    assert [step for step in steps if step[0] == "localizing"] == [
        ("localizing", n, SCANS) for n in range(1, SCANS + 1)
    ]
    assert ("mapping", SCANS, SCANS) in steps
    assert {stage for stage, _, _ in steps} == {"mapping", "localizing"}


def test_all_bag_formats_give_the_same_bytes(drive: RecordedDrive, tmp_path: Path) -> None:
    for name, bag in (("ros1", drive.ros1), ("mcap", drive.mcap), ("ros2", drive.ros2)):
        replayed(bag, tmp_path / name)
    assert files_of(tmp_path / "ros1") == files_of(tmp_path / "mcap") == files_of(tmp_path / "ros2")


def test_with_a_map_only_localization_runs(drive: RecordedDrive, tmp_path: Path) -> None:
    first = replayed(drive.ros2, tmp_path / "first")
    second = replayed(drive.ros2, tmp_path / "second", map_file=first.map_file)
    assert second.mapping is None
    assert second.localization.scans == SCANS
    names = {"localization.png", "localization.csv", "trajectory.tum"}
    assert set(files_of(tmp_path / "second")) == {f"localization/{name}" for name in names}


def write_bag_without_odometry(path: Path) -> None:
    simulation = build(find_world("small"), np.random.default_rng(0))
    with BagWriter(path) as bag:
        recording = RunRecorder(bag)
        for _ in range(9):
            measurement: Scan | Odometry = simulation.robot.receive()
            if isinstance(measurement, Scan):
                recording.write_measurement(measurement, Pose())


def test_invalid_bags_are_rejected(tmp_path: Path) -> None:
    (tmp_path / "log.txt").write_text("FLASER")
    (tmp_path / "empty").mkdir()
    write_bag_without_odometry(tmp_path / "scans.bag")
    for name, reason in (
        ("log.txt", "is not a bag"),
        ("empty", "is not a bag"),
        ("missing.bag", "No such file"),
        ("scans.bag", "has no odometry"),
    ):
        with pytest.raises(InputError, match=reason):
            prepare(ReplaySettings(tmp_path / name, tmp_path / "out"))
    with pytest.raises(InputError, match="--backend"):
        prepare(ReplaySettings(tmp_path / "scans.bag", tmp_path / "out", backend="magic"))


@pytest.mark.parametrize("with_map", [False, True])
def test_invalid_parameters_and_maps_are_rejected_before_mapping(
    drive: RecordedDrive, tmp_path: Path, with_map: bool
) -> None:
    params = tmp_path / "amcl.yaml"
    params.write_text("max_particles: many")
    map_file = tmp_path / "missing.yaml" if with_map else None
    with pytest.raises(InputError, match=r"amcl\.yaml"):
        prepare(ReplaySettings(drive.ros1, tmp_path / "out", map_file, params=params))
    if with_map:
        with pytest.raises(InputError, match=r"missing\.yaml"):
            prepare(ReplaySettings(drive.ros1, tmp_path / "out", map_file))
    assert not (tmp_path / "out").exists()
