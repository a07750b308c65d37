"""wherry replay, and replays of what other commands record."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from wherry.ros.bags.reading import read_bag
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
