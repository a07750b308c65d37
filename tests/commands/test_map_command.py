"""wherry map: verdict, notes, metrics, and the folder of its results."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from wherry.logs.tables import read_odometry
from wherry.space.pose import Pose, relative
from wherry_testing.carmen_logs import drive_poses, write_carmen_log, write_scans
from wherry_testing.command_line import RunCommand

POSES = drive_poses()


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_carmen_log(tmp_path_factory.mktemp("log") / "2024.05.01.room.clf", POSES)


def test_the_verdict_comes_before_the_numbers(run_command: RunCommand, log: Path) -> None:
    status, out, _ = run_command("map", log)
    assert status == 0
    verdict, *rest = out.splitlines()
    assert verdict.startswith("A map of 5.7 × 4.1 m (")
    assert " free) from 16 scans: the robot drove 1.7 m in 15.0 s; 0 loops closed." in verdict
    assert rest[0].startswith("Map of 2024.05.01.room.clf")
    assert "Note: " not in out
    assert "reference relations" not in out
    assert "Not measured" not in out


def test_json_has_what_the_table_has_and_result_json_keeps_it(run_command: RunCommand, log: Path) -> None:
    metrics = json.loads(run_command("map", log, "--json").out)
    assert metrics == json.loads(Path("runs/2024.05.01.room-map/result.json").read_text())
    assert metrics["size_m"] == pytest.approx([5.65, 4.1])  # the wall behind the robot is not seen
    assert metrics["resolution_m"] == 0.05
    assert metrics["distance_m"] == pytest.approx(15 * math.hypot(0.1, 0.05), abs=0.05)
    assert metrics["duration_s"] == 15.0
    assert metrics["fit"] > 0.95
    assert metrics["is_doubtful"] is False
    assert metrics["notes"] == []
    assert metrics["relations"] == 0


def test_every_run_gets_a_folder_of_its_own(run_command: RunCommand, log: Path) -> None:
    for folder in ("runs/2024.05.01.room-map", "runs/2024.05.01.room-map-2", "runs/2024.05.01.room-map-3"):
        out = run_command("map", log).out
        assert out.endswith(f"Map, picture, trajectory, pose graph and loop closures: {folder}\n")
        names = {path.name for path in Path(folder).iterdir()}
        assert names >= {"map.yaml", "map.pgm", "map.png", "trajectory.tum", "graph.npz", "result.json", "trace.wherry"}
    assert len(list(Path("runs").iterdir())) == 3


def test_the_folder_can_be_chosen(run_command: RunCommand, log: Path, tmp_path: Path) -> None:
    assert run_command("map", log, "--out", tmp_path / "mine", "-q") == (0, "", "")
    assert (tmp_path / "mine" / "map.yaml").exists()
    assert not Path("runs").exists()


def test_a_refused_run_leaves_no_folder(run_command: RunCommand, log: Path, tmp_path: Path) -> None:
    (tmp_path / "run.bag").write_text("precious")
    assert run_command("map", log, "--record", tmp_path / "run.bag", "-q").status == 2
    assert run_command("map", log, "--backend", "magic", "-q").status == 2
    assert not list(Path().rglob("*-map"))


def test_a_folder_has_the_files_of_its_last_run_only(run_command: RunCommand, log: Path, tmp_path: Path) -> None:
    assert run_command("map", log, "--out", tmp_path, "--trajectory-format", "kitti", "-q").status == 0
    first = {path.name for path in tmp_path.iterdir()}
    assert run_command("map", log, "--out", tmp_path, "--backend", "particles", "-q").status == 0
    assert first - {path.name for path in tmp_path.iterdir()} == {"graph.npz", "closures.txt", "trajectory.kitti"}


def test_a_stopped_run_says_what_its_folder_has(
    run_command: RunCommand, log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run_command("map", log, "--out", tmp_path, "-q").status == 0
    monkeypatch.setattr("wherry.pipelines.logs.trace.LogTrace.scan", _press_ctrl_c)
    folder = "runs/2024.05.01.room-map"
    status, out, err = run_command("map", log)
    assert (status, out, err.strip()) == (130, "", f"wherry: stopped; {folder} has only trace.wherry")
    status, out, err = run_command("map", log, "--out", tmp_path)
    text = f"wherry: stopped; the results in {tmp_path} are those of an earlier run, without its trace"
    assert (status, out, err.strip()) == (130, "", text)


def _press_ctrl_c(*arguments: object) -> None:
    raise KeyboardInterrupt


@pytest.mark.parametrize(("name", "columns"), [("csv", 4), ("kitti", 12)])
def test_trajectories_are_written_in_other_formats_too(
    run_command: RunCommand, log: Path, tmp_path: Path, name: str, columns: int
) -> None:
    assert run_command("map", log, "--out", tmp_path, "--trajectory-format", name, "-q").status == 0
    assert len(read_odometry(tmp_path / "trajectory.tum").times) == 16
    last = (tmp_path / f"trajectory.{name}").read_text().splitlines()[-1]
    values = [float(word) for word in last.replace(",", " ").split()]
    assert len(values) == columns
    x, y = (values[1], values[2]) if name == "csv" else (values[3], values[7])
    expected = relative(POSES[-1:], POSES[:1])[0]
    assert (x, y) == pytest.approx((expected[0], expected[1]), abs=0.03)


def test_the_mount_of_the_lidar_can_be_stated(run_command: RunCommand, tmp_path: Path) -> None:
    """A lidar that faces backwards, 20 cm behind the centre, in a log that does not say so."""
    turning = np.column_stack([np.full(20, 2.0), np.full(20, 2.5), 0.1 * np.arange(20)])
    log = write_carmen_log(tmp_path / "back.clf", turning, Pose(-0.2, 0.1, math.pi))
    assert run_command("map", log, "--lidar", "-0.2,0.1,180", "--out", tmp_path, "-q").status == 0
    poses = read_odometry(tmp_path / "trajectory.tum").poses
    np.testing.assert_allclose(poses[:, :2], 0.0, atol=0.02)  # turns about its centre
    np.testing.assert_allclose(poses[:, 2], 0.1 * np.arange(20), atol=0.01)


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["--lidar", "0.1,0"], "--lidar: 0.1,0: must be x,y,θ in metres and degrees"),
        (["--lidar", "0,0,nan"], "--lidar: 0,0,nan: must be finite"),
        (["--scan-topic", "RLASER"], "LOG: --scan-topic: RLASER has no scans in it; there are FLASER (16)"),
        (
            ["--odom-topic", "/odom"],
            "--odom-topic: /odom: is for bags only; LOG is a text log, whose odometry is in its lines",
        ),
        (["--trajectory-format", "xml"], "--trajectory-format: xml: is none of tum, csv, kitti"),
    ],
)
def test_options_of_reading_that_cannot_be_used_are_named(
    run_command: RunCommand, log: Path, arguments: list[str], line: str
) -> None:
    expected = f"wherry: {line.replace('LOG', str(log))}\n"
    assert run_command("map", log, *arguments, "-q") == (2, "", expected)


def test_a_robot_that_stands_still_is_noted(run_command: RunCommand, tmp_path: Path) -> None:
    log = write_carmen_log(tmp_path / "still.clf", np.tile(POSES[:1], (9, 1)), period=0.5)
    status, out, _ = run_command("map", log)
    note = "The robot moved 0.00 m in 9 scans and 4.0 s: the log shows only what is seen from one place."
    assert status == 0
    assert out.count(f"Note: {note}\n") == 1
    assert json.loads(run_command("map", log, "--json").out)["notes"] == [note]


def test_a_map_of_one_scan_is_noted(run_command: RunCommand, tmp_path: Path) -> None:
    log = write_carmen_log(tmp_path / "one.clf", POSES[:1])
    notes = json.loads(run_command("map", log, "--json").out)["notes"]
    assert notes == ["The log has only one scan, which shows what is seen from one place."]


def test_a_map_that_does_not_fit_its_own_scans_is_doubtful(run_command: RunCommand, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    poses = POSES[:6]
    log = write_scans(tmp_path / "noise.clf", [rng.uniform(0.5, 6.0, 181) for _ in poses], poses)
    status, out, err = run_command("map", log, "--json")
    assert (status, json.loads(out)["is_doubtful"]) == (1, True)
    assert err.startswith("The map is doubtful: its own scans do not fit it (fit 0.")
    assert Path("runs/noise-map/map.yaml").exists()


def test_a_log_in_which_no_beam_met_anything_is_refused(run_command: RunCommand, tmp_path: Path) -> None:
    log = write_scans(tmp_path / "void.clf", [np.full(181, 81.91)] * 16, POSES)
    line = f"wherry: {log}: has no range within the limits of its lidar, 0.02 to 80 m, in any scan\n"
    assert run_command("map", log) == (2, "", line)
    assert not Path("runs").exists()


def test_reference_relations_are_scored_only_if_there_are_some(
    run_command: RunCommand, log: Path, tmp_path: Path
) -> None:
    relations = tmp_path / "room.relations"
    relations.write_text("0 15 1.5 0.75 0 0 0 0.75\n")
    out = run_command("map", log, "--relations", relations).out
    assert "reference relations" in out
    assert "translational error (mean)" in out


def test_odometry_that_the_scans_contradict_is_noted(run_command: RunCommand, tmp_path: Path) -> None:
    """Odometry is reset to zero in the middle of the drive; the map is that of the room all the same."""
    poses = drive_poses(24)
    log = write_carmen_log(tmp_path / "reset.clf", poses)
    lines = [line.split() for line in log.read_text().splitlines()]
    for words, place in zip(lines[12:], relative(poses[12:], poses[12]), strict=True):
        words[-9:-3] = [f"{value:.6f}" for value in (*place, *place)]
    log.write_text("".join(" ".join(words) + "\n" for words in lines))
    status, out, _ = run_command("map", log, "--out", tmp_path)
    assert status == 0
    assert out.count("Note: Scan matching contradicts odometry at ") == 1
    found = read_odometry(tmp_path / "trajectory.tum").poses
    np.testing.assert_allclose(found[:, :2], relative(poses, poses[0])[:, :2], atol=0.05)
