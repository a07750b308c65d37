"""Replay of a bag of ROS 1 or ROS 2: mapping, and localization on the map."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from wherry.cli import app
from wherry.errors import InputError
from wherry.floorplan.world_files import find_world
from wherry.pipelines.logs.replay import ReplaySettings, prepare
from wherry.robot import Odometry, Scan, Velocity
from wherry.ros.bags.reading import read_bag
from wherry.ros.bags.run_recorder import RunRecorder
from wherry.ros.bags.writer import BagWriter
from wherry.simulation import build
from wherry.space.pose import Pose

SCANS = 200


@pytest.fixture(scope="module")
def ride(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Pose]:
    """A folder with run.bag, run.mcap and run of the same drive, and its true end pose relative to its start."""
    folder = tmp_path_factory.mktemp("ride")
    simulation = build(find_world("small"), np.random.default_rng(0))
    start = simulation.referee.pose
    bags = [BagWriter(folder / name) for name in ("run.bag", "run.mcap", "run")]
    robot = simulation.robot
    for bag in bags:
        robot = RunRecorder(bag).robot(robot)
    while simulation.time < 20.0:
        robot.receive()
        robot.command(Velocity(0.2, -0.25) if simulation.time < 10.0 else Velocity(0.0, 0.4))
    assert not simulation.referee.collisions  # a collision would make the wheels slip
    for bag in bags:
        bag.close()
    return folder, simulation.referee.pose.relative_to(start)


def run(*arguments: str) -> Any:
    return CliRunner().invoke(app, list(arguments))


def files_of(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def test_bag_is_mapped_and_localized_on_its_map(ride: tuple[Path, Pose], tmp_path: Path) -> None:
    folder, truth = ride
    result = run("replay", str(folder / "run.bag"), "--out", str(tmp_path / "out"), "--json", "--seed", "3")
    assert result.exit_code == 0, result.output
    metrics = json.loads(result.stdout.splitlines()[-1])
    assert metrics["mapping"]["scans"] == metrics["localization"]["scans"] == SCANS
    assert metrics["localization"]["rmse_m"] < 0.05  # against mapping's own trajectory
    assert np.hypot(*np.subtract(metrics["localization"]["final_pose"][:2], (truth.x, truth.y))) < 0.05
    assert metrics["localization"]["lost_fraction"] < 0.05
    names = set(files_of(tmp_path / "out"))
    assert names >= {"mapping/map.yaml", "mapping/map.png", "mapping/trajectory.tum", "localization/localization.png"}


def test_all_bag_formats_give_the_same_bytes(ride: tuple[Path, Pose], tmp_path: Path) -> None:
    folder, _ = ride
    for out, bag in (("one", "run.bag"), ("two", "run.mcap"), ("three", "run")):
        assert run("replay", str(folder / bag), "--out", str(tmp_path / out), "-q").exit_code == 0
    assert files_of(tmp_path / "one") == files_of(tmp_path / "two") == files_of(tmp_path / "three")


def test_with_a_map_only_localization_runs(ride: tuple[Path, Pose], tmp_path: Path) -> None:
    folder, _ = ride
    assert run("replay", str(folder / "run"), "--out", str(tmp_path / "first"), "-q").exit_code == 0
    map_file = tmp_path / "first" / "mapping" / "map.yaml"
    result = run("replay", str(folder / "run"), "--map", str(map_file), "--out", str(tmp_path / "second"), "--json")
    metrics = json.loads(result.stdout.splitlines()[-1])
    assert metrics["mapping"] is None
    assert metrics["localization"]["scans"] == SCANS
    assert set(files_of(tmp_path / "second")) == {"localization/localization.png", "localization/trajectory.tum"}


@pytest.mark.parametrize("name", ["map.bag", "map.mcap", "map"])
def test_recorded_mapping_contains_its_log(ride: tuple[Path, Pose], tmp_path: Path, name: str) -> None:
    folder, _ = ride
    assert run("map", str(folder / "run"), "--record", str(tmp_path / name), "-q").exit_code == 0
    before, after = read_bag(folder / "run"), read_bag(tmp_path / name)
    assert [scan.time for scan in after.scans] == [scan.time for scan in before.scans]
    for one, other in zip(before.scans, after.scans, strict=True):
        np.testing.assert_array_equal(one.ranges, other.ranges)
    np.testing.assert_allclose(after.odometry.poses, before.odometry.poses, atol=1e-12)
    assert after.lidar == before.lidar


def test_recorded_localization_contains_its_particles(ride: tuple[Path, Pose], tmp_path: Path) -> None:
    from rosbags.highlevel import AnyReader  # noqa: PLC0415

    folder, _ = ride
    run("replay", str(folder / "run"), "--out", str(tmp_path / "out"), "-q")
    map_file, record = tmp_path / "out" / "mapping" / "map.yaml", tmp_path / "found.mcap"
    result = run("localize", str(folder / "run"), "--map", str(map_file), "--record", str(record), "-q")
    assert result.exit_code == 0, result.output
    with AnyReader([record]) as reader:
        counts = {connection.topic: connection.msgcount for connection in reader.connections}
    assert counts["/particlecloud"] == counts["/amcl_pose"] == counts["/scan"] == SCANS
    assert counts["/map"] == 1


@pytest.mark.slow
def test_recorded_delivery_is_replayed(tmp_path: Path) -> None:
    record = tmp_path / "run.bag"
    arguments = ("--world", "small", "--boxes", "1", "--seed", "0", "--out", str(tmp_path / "out"), "-q", "--json")
    recorded = json.loads(run("deliver", *arguments, "--record", str(record)).stdout.splitlines()[-1])
    assert recorded["delivered"] == recorded["boxes"] == 1
    log = read_bag(record)
    assert log.scans[-1].time == pytest.approx(recorded["sim_seconds"], abs=0.1)
    result = run("replay", str(record), "--out", str(tmp_path / "replay"), "--json", "-q")
    metrics = json.loads(result.stdout.splitlines()[-1])
    assert metrics["localization"]["rmse_m"] < 0.05
    assert metrics["localization"]["lost_fraction"] < 0.02


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
    ride: tuple[Path, Pose], tmp_path: Path, with_map: bool
) -> None:
    params = tmp_path / "amcl.yaml"
    params.write_text("max_particles: many")
    map_file = tmp_path / "missing.yaml" if with_map else None
    with pytest.raises(InputError, match=r"amcl\.yaml"):
        prepare(ReplaySettings(ride[0] / "run.bag", tmp_path / "out", map_file, params=params))
    if with_map:
        with pytest.raises(InputError, match=r"missing\.yaml"):
            prepare(ReplaySettings(ride[0] / "run.bag", tmp_path / "out", map_file))
    assert not (tmp_path / "out").exists()
