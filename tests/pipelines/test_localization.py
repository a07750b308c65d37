"""Localization of a recorded log: errors against a reference, reproducibility, and rejected inputs."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.logs.reading import read_log
from wherry.logs.timestamps import increasing_times
from wherry.mapping.graph_slam import GraphSlam
from wherry.mapping.saved_graph import save_graph
from wherry.pipelines.logs.localization import LocalizationSettings, prepare
from wherry.space.map_files import save_map
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry.space.raycast import cast_rays
from wherry.space.trajectory import save_tum
from wherry_testing.buildings import shared_data

ORIGIN = Pose(-1.0, -2.0)


def room() -> OccupancyGrid:
    """6 × 4 m with a pillar and a recess, so that every pose has a distinct scan."""
    probability = np.full((80, 120), 0.02, np.float32)
    probability[[0, -1]] = probability[:, [0, -1]] = 0.98
    probability[30:36, 80:88] = 0.98
    probability[60:, 20:26] = 0.98
    return OccupancyGrid(probability, 0.05, ORIGIN)


@pytest.fixture
def files(tmp_path: Path) -> LocalizationSettings:
    """A log of a drive around the room, its map, and the true trajectory."""
    grid = room()
    times = np.arange(60) * 0.5
    truth = np.array([[0.6 + 1.5 * math.sin(t / 8), 0.2 * math.cos(t / 5) - 0.8, t / 10 - 1.0] for t in times])
    angles = np.radians(np.arange(180) - 90.0)
    ranges = cast_rays(grid.occupied, grid.resolution, grid.origin, truth, angles, 50.0)
    lines, reference = [], []
    for time, pose, scan in zip(times, truth, ranges, strict=True):
        x, y, theta = (Pose(7.0, 3.0, 2.0) @ Pose.from_array(pose)).as_array()  # in the odom frame
        beams = " ".join(f"{r:.3f}" for r in scan)
        odometry = f"{x:.5f} {y:.5f} {theta:.6f}"
        lines.append(f"FLASER 180 {beams} {odometry} {odometry} {time:.3f} nohost {time:.3f}")
        reference.append(f"{time:.3f} {pose[0]:.5f} {pose[1]:.5f} {pose[2]:.6f}")
    (tmp_path / "log.clf").write_text("\n".join(lines) + "\n")
    (tmp_path / "truth.txt").write_text("\n".join(reference) + "\n")
    return LocalizationSettings(
        tmp_path / "log.clf", save_map(grid, tmp_path / "map.yaml"), reference=tmp_path / "truth.txt"
    )


@pytest.mark.parametrize("is_global", [False, True])
def test_drive_around_a_room_is_localized(files: LocalizationSettings, tmp_path: Path, is_global: bool) -> None:
    run = prepare(LocalizationSettings(files.log, files.map_file, reference=files.reference, is_global=is_global))
    assert len(list(run.steps())) == len(run) == 60
    result = run.result()
    assert result.median_m is not None
    assert result.median_m < 0.05  # the rays end on the cells' faces, half a cell before their centres
    assert result.lost_fraction < 0.1
    assert json.loads(json.dumps(result.as_dict(), allow_nan=False))["scans"] == 60
    tum, table, picture = run.save(tmp_path / "out")
    assert np.loadtxt(tum).shape == (60, 8)
    rows = np.loadtxt(table, delimiter=",", skiprows=1)
    assert rows.shape == (60, 6)
    assert rows[:, 4] == pytest.approx(run.lost_probabilities, abs=1e-6)
    assert (rows[:, 5] > 0.9).all()
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_same_seed_gives_same_bytes(files: LocalizationSettings) -> None:
    trajectories = []
    for _ in range(2):
        run = prepare(files)
        list(run.steps())
        trajectories.append(run.trajectory.as_tum())
    assert trajectories[0] == trajectories[1]


def test_without_a_reference_there_are_no_errors(files: LocalizationSettings) -> None:
    run = prepare(LocalizationSettings(files.log, files.map_file))
    list(run.steps())
    assert run.result().rmse_m is None


def test_unknown_parameters_are_reported(files: LocalizationSettings, tmp_path: Path) -> None:
    (tmp_path / "amcl.yaml").write_text("amcl: {alpha1: 0.1, sigma_hitt: 0.3}")
    run = prepare(
        LocalizationSettings(files.log, files.map_file, params=tmp_path / "amcl.yaml", reference=files.reference)
    )
    list(run.steps())
    assert run.result().unknown_parameters == ("sigma_hitt",)


def test_reference_without_poses_at_the_scans_is_rejected(files: LocalizationSettings, tmp_path: Path) -> None:
    (tmp_path / "other.txt").write_text("1000 0 0 0\n1001 0 0 0\n")
    with pytest.raises(
        InputError, match=r"other\.txt: has no pose at the time of any scan: it covers 1000\.000 to 1001"
    ):
        prepare(LocalizationSettings(files.log, files.map_file, reference=tmp_path / "other.txt"))


def test_saved_pose_graph_is_used_as_a_map(files: LocalizationSettings, tmp_path: Path) -> None:
    log = read_log(files.log)
    slam = GraphSlam(log.lidar)
    for scan, odometry in zip(log.scans, log.scan_odometry, strict=True):
        slam.add(scan, odometry)
    slam.finish()
    save_graph(slam.snapshot(), tmp_path / "graph.npz")
    save_tum(slam.trajectory, tmp_path / "slam.tum")
    run = prepare(LocalizationSettings(files.log, tmp_path / "graph.npz", reference=tmp_path / "slam.tum"))
    list(run.steps())
    median = run.result().median_m
    assert median is not None
    assert median < 0.05


def test_broken_pose_graph_is_rejected(files: LocalizationSettings, tmp_path: Path) -> None:
    (tmp_path / "graph.npz").write_bytes(b"no archive")
    with pytest.raises(InputError, match="not a saved pose graph"):
        prepare(LocalizationSettings(files.log, tmp_path / "graph.npz"))


def test_equal_timestamps_cause_no_odometry_jump(files: LocalizationSettings) -> None:
    lines = files.log.read_text().splitlines()
    stopped = [" ".join([*line.split()[:-3], "1134860000.0 nohost 1134860000.0"]) for line in lines[::2]]
    files.log.write_text("\n".join(stopped) + "\n")
    run = prepare(LocalizationSettings(files.log, files.map_file, params=None))
    run.localizer.initialize(Pose(0.6, -0.6, -1.0), np.diag([0.1, 0.1, 0.05]) ** 2)
    assert not any(scan.localization.estimate.problem for scan in run.steps())
    last = 58 * 0.5
    truth = Pose(0.6 + 1.5 * math.sin(last / 8), 0.2 * math.cos(last / 5) - 0.8, last / 10 - 1.0)
    assert run.localized[-1].localization.pose.distance_to(truth) < 0.1
    assert (np.diff(increasing_times(np.array([scan.time for scan in run.log.scans]))) > 0.0).all()


def test_global_localization_in_wean_hall() -> None:
    log, plan = shared_data("wean/robotdata3.log.gz"), shared_data("wean/wean.dat.gz")
    finals = []
    for seed in range(2):
        run = prepare(LocalizationSettings(log, plan, is_global=True, seed=seed))
        for _ in run.steps():
            pass
        finals.append(run.result().final_pose)
    assert np.hypot(finals[0][0] - 39.9, finals[0][1] - 39.7) < 0.5  # beside where the log begins
    assert np.hypot(finals[0][0] - finals[1][0], finals[0][1] - finals[1][1]) < 0.5
