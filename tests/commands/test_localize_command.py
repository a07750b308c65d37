"""wherry localize: verdict, notes, metrics, files and exit status."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from wherry.logs.tables import read_odometry
from wherry.space.map_files import save_map
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry_testing.carmen_logs import drive_poses, write_carmen_log, write_room_map, write_scans
from wherry_testing.command_line import RunCommand

OFF_THE_MAP = "The map has no free space at the start pose of the log; --global searches the whole map.\n"
POSES = drive_poses(24)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log, a map of its room, the true trajectory, and parameters with the true start pose."""
    folder = tmp_path_factory.mktemp("room")
    write_carmen_log(folder / "walk.clf", POSES)
    write_room_map(folder)
    truth = "".join(f"{n} {x:.6f} {y:.6f} {theta:.6f}\n" for n, (x, y, theta) in enumerate(POSES))
    (folder / "truth.txt").write_text(truth)
    start = "initial_pose_x: 1.0\ninitial_pose_y: 1.0\ninitial_pose_a: 0.0\n"
    (folder / "amcl.yaml").write_text(start)
    return folder


def localized(folder: Path, *options: object) -> tuple[object, ...]:
    return ("localize", folder / "walk.clf", "--map", folder / "map.yaml", *options)


def test_the_verdict_comes_before_the_numbers(run_command: RunCommand, folder: Path) -> None:
    status, out, err = run_command(*localized(folder, "--reference", folder / "truth.txt", "--json"))
    assert status == 0
    metrics = json.loads(out)
    assert err.splitlines()[0] == metrics["verdict"]
    assert metrics["fits_map"] is True
    assert metrics["fit"] > 0.9
    assert metrics["rmse_m"] < 0.05
    assert metrics["scans"] == 24
    assert metrics["distance_m"] == pytest.approx(23 * np.hypot(0.1, 0.05), abs=0.1)
    assert metrics["duration_s"] == 23.0
    x, y, _ = metrics["final_pose"]
    assert f"x {x:.2f} m, y {y:.2f} m, heading " in err
    assert "position error to the reference (rms)" in err
    assert "final_pose" not in err
    assert "Not measured" not in err
    assert OFF_THE_MAP not in err
    for note in metrics["notes"]:
        assert err.count(f"Note: {note}\n") == 1


def test_results_are_saved_to_a_folder_of_their_own(run_command: RunCommand, folder: Path) -> None:
    for name in ("walk-localize", "walk-localize-2"):
        options = ("--params", folder / "amcl.yaml", "--trajectory-format", "kitti")
        status, out, _ = run_command(*localized(folder, *options))
        assert status == 0
        results = Path("runs") / name
        files = ("trajectory.tum", "trajectory.kitti", "localization.csv", "localization.png")
        assert "reference" not in out
        assert out.endswith("Written: " + ", ".join(str(results / file) for file in files) + "\n")
        assert {path.name for path in results.iterdir()} == {*files, "result.json", "trace.wherry"}
        np.testing.assert_allclose(read_odometry(results / "trajectory.tum").poses, POSES, atol=0.2)
        assert json.loads((results / "result.json").read_text())["fits_map"] is True


def test_scans_that_do_not_fit_the_map_end_with_status_1_and_their_results(
    run_command: RunCommand, folder: Path, tmp_path: Path
) -> None:
    rng = np.random.default_rng(0)
    log = write_scans(tmp_path / "noise.clf", [rng.uniform(0.5, 6.0, 181) for _ in POSES], POSES)
    status, out, err = run_command("localize", log, "--map", folder / "map.yaml", "--global", "--json")
    assert status == 1
    assert err.startswith("These scans do not fit this map")
    assert json.loads(out)["fits_map"] is False
    assert Path("runs/noise-localize/trajectory.tum").exists()


def test_a_start_off_the_map_is_reported(run_command: RunCommand, folder: Path, tmp_path: Path) -> None:
    far = save_map(OccupancyGrid(np.full((40, 40), 0.02, np.float32), 0.05, Pose(30.0, 0.0)), tmp_path / "map.yaml")
    status, out, _ = run_command("localize", folder / "walk.clf", "--map", far)
    assert OFF_THE_MAP in out
    assert status == 1  # the map covers nothing of what the lidar sees


def test_the_mount_of_the_lidar_can_be_stated(run_command: RunCommand, folder: Path, tmp_path: Path) -> None:
    log = write_carmen_log(tmp_path / "back.clf", POSES, Pose(-0.2, 0.1, np.pi))
    reference = ("--reference", folder / "truth.txt", "--map", folder / "map.yaml", "--json", "-q")
    status, out, _ = run_command("localize", log, "--lidar", "-0.2,0.1,180", *reference)
    assert status == 0
    assert json.loads(out)["rmse_m"] < 0.05


def test_a_topic_of_odometry_is_refused_in_a_text_log(run_command: RunCommand, folder: Path) -> None:
    reason = f"is for bags only; {folder / 'walk.clf'} is a text log, whose odometry is in its lines"
    assert run_command(*localized(folder, "--odom-topic", "/a")) == (2, "", f"wherry: --odom-topic: /a: {reason}\n")
    assert not Path("runs").exists()
