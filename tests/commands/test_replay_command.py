"""wherry replay, and replays of what other commands record."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from wherry.floorplan.world_files import find_world
from wherry.ros.bags.reading import read_bag
from wherry.simulation.ground_truth import true_map
from wherry.space.map_files import save_map
from wherry_testing.command_line import RunCommand
from wherry_testing.recorded_drives import SCANS, RecordedDrive, record_drive


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> RecordedDrive:
    return record_drive(tmp_path_factory.mktemp("drive"))


def test_replay_prints_the_metrics_of_both_stages(
    run_command: RunCommand, drive: RecordedDrive, tmp_path: Path
) -> None:
    status, out, err = run_command("replay", drive.ros1, "--out", tmp_path, "--json")
    assert status == 0, err
    metrics = json.loads(out)
    assert metrics["bag"] == str(drive.ros1)
    assert metrics["mapping"]["scans"] == metrics["localization"]["scans"] == SCANS
    assert f"Written to {tmp_path}" in err


def test_every_replay_gets_a_folder_of_its_own(run_command: RunCommand, drive: RecordedDrive) -> None:
    for folder in (Path("runs/run-replay"), Path("runs/run-replay-2")):
        status, out, _ = run_command("replay", drive.ros1, "--json")
        assert status == 0
        metrics = json.loads(out)
        assert metrics == json.loads((folder / "result.json").read_text())
        assert {path.name for path in folder.iterdir()} == {"mapping", "localization", "result.json"}
        assert metrics["localization"]["fits_map"] is True
        assert min(metrics["localization"]["fit"], metrics["mapping"]["fit"]) > 0.9
        assert metrics["mapping"]["is_doubtful"] is False
        assert metrics["notes"] == list(dict.fromkeys(metrics["mapping"]["notes"] + metrics["localization"]["notes"]))


def test_verdicts_and_notes_of_both_stages_are_printed_once(
    run_command: RunCommand, drive: RecordedDrive, tmp_path: Path
) -> None:
    out = run_command("replay", drive.ros2, "--out", tmp_path, "--lidar", "0.5,0,0").out
    metrics = json.loads((tmp_path / "result.json").read_text())
    for line in (metrics["mapping"]["verdict"], metrics["localization"]["verdict"]):
        assert out.count(f"{line}\n") == 1
    assert [note for note in metrics["notes"] if "--lidar" in note]  # the transforms have it elsewhere
    for note in metrics["notes"]:
        assert out.count(f"Note: {note}\n") == 1


@pytest.mark.parametrize(("world", "fits"), [("rooms", False), ("offices", True)])  # the latter only in part
def test_a_map_of_another_building_ends_with_status_1(
    run_command: RunCommand, drive: RecordedDrive, tmp_path: Path, world: str, fits: bool
) -> None:
    map_file = save_map(true_map(find_world(world)), tmp_path / "map.yaml")
    status, out, _ = run_command("replay", drive.ros1, "--map", map_file, "--global", "--out", tmp_path / "out", "-q")
    assert (status, out) == (1, "")
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["localization"]["fits_map"] is fits
    verdict = "The scans fit the map only in part" if fits else "These scans do not fit this map"
    assert result["localization"]["verdict"].startswith(verdict)


def test_a_refused_replay_leaves_no_folder(run_command: RunCommand, drive: RecordedDrive, tmp_path: Path) -> None:
    (tmp_path / "log.clf").write_text("FLASER")
    for arguments in ((tmp_path / "log.clf",), (drive.ros1, "--scan-topic", "/none"), (drive.ros1, "--lidar", "0")):
        status, _, err = run_command("replay", *arguments)
        assert status == 2
        assert err.count("\n") == 1
        assert list(Path("runs").glob("*")) == []


@pytest.mark.parametrize("name", ["map.bag", "map.mcap", "map"])
def test_recorded_mapping_contains_its_log(
    run_command: RunCommand, drive: RecordedDrive, tmp_path: Path, name: str
) -> None:
    assert run_command("map", drive.ros2, "--record", tmp_path / name, "-q").status == 0
    before, after = read_bag(drive.ros2), read_bag(tmp_path / name)
    assert [scan.time for scan in after.scans] == [scan.time for scan in before.scans]
    for recorded, original in zip(after.scans, before.scans, strict=True):
        np.testing.assert_array_equal(recorded.ranges, original.ranges)
    np.testing.assert_allclose(after.odometry.poses, before.odometry.poses, atol=1e-12)
    assert after.lidar == before.lidar


def test_recorded_localization_contains_its_particles(
    run_command: RunCommand, drive: RecordedDrive, tmp_path: Path
) -> None:
    from rosbags.highlevel import AnyReader  # noqa: PLC0415

    map_file, record = tmp_path / "map" / "map.yaml", tmp_path / "localized.mcap"
    assert run_command("map", drive.ros2, "--out", map_file.parent, "-q").status == 0
    assert run_command("localize", drive.ros2, "--map", map_file, "--record", record, "-q").status == 0
    with AnyReader([record]) as reader:
        counts = {connection.topic: connection.msgcount for connection in reader.connections}
    assert counts["/particlecloud"] == counts["/amcl_pose"] == counts["/scan"] == SCANS
    assert counts["/map"] == 1


@pytest.mark.slow
def test_recorded_delivery_is_replayed(run_command: RunCommand, tmp_path: Path) -> None:
    record = tmp_path / "run.bag"
    arguments = ("--world", "small", "--boxes", "1", "--seed", "0", "--out", tmp_path / "out", "-q", "--json")
    delivery = json.loads(run_command("deliver", *arguments, "--record", record).out.splitlines()[-1])
    assert delivery["delivered"] == delivery["boxes"] == 1
    log = read_bag(record)
    assert log.scans[-1].time == pytest.approx(delivery["sim_seconds"], abs=0.1)
    replay = run_command("replay", record, "--out", tmp_path / "replay", "--json", "-q")
    metrics = json.loads(replay.out.splitlines()[-1])
    assert metrics["localization"]["rmse_m"] < 0.05
    assert metrics["localization"]["lost_fraction"] < 0.02
