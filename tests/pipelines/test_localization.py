"""Localization of a recorded log: errors against a reference, reproducibility, and rejected inputs."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.logs.reading import read_log
from wherry.logs.timestamps import increasing_times
from wherry.mapping.graph_slam import GraphSlam
from wherry.mapping.saved_graph import save_graph
from wherry.pipelines.logs.localization import LocalizationResult, LocalizationSettings, prepare
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
    return write_log(tmp_path, room())


def write_log(tmp_path: Path, grid: OccupancyGrid) -> LocalizationSettings:
    """Write a log of a drive around a room, its map, and the true trajectory."""
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


def result_of(settings: LocalizationSettings) -> LocalizationResult:
    run = prepare(settings)
    list(run.steps())
    return run.result()


def another_room() -> OccupancyGrid:
    """9 × 7 m with walls of its own."""
    probability = np.full((140, 180), 0.02, np.float32)
    probability[[0, -1]] = probability[:, [0, -1]] = 0.98
    probability[70, :110] = probability[70:, 60] = 0.98
    probability[20:30, 120:150] = 0.98
    return OccupancyGrid(probability, 0.05, ORIGIN)


def scaled(grid: OccupancyGrid, factor: float) -> OccupancyGrid:
    origin = Pose(factor * grid.origin.x, factor * grid.origin.y)
    return OccupancyGrid(grid.probability, factor * grid.resolution, origin)


def mirrored(grid: OccupancyGrid) -> OccupancyGrid:
    return OccupancyGrid(grid.probability[::-1].copy(), grid.resolution, grid.origin)


@pytest.mark.parametrize("is_global", [False, True])
@pytest.mark.parametrize(
    "grid", [another_room(), scaled(room(), 2.0), scaled(room(), 0.5)], ids=["other", "twice", "half"]
)
def test_a_wrong_map_is_told_from_the_right_one(
    files: LocalizationSettings, tmp_path: Path, grid: OccupancyGrid, is_global: bool
) -> None:
    wrong = save_map(grid, tmp_path / "wrong.yaml")
    result = result_of(LocalizationSettings(files.log, wrong, is_global=is_global))
    assert not result.fits_map
    assert result.fit < 0.7
    assert result.lost_probability == 1.0
    assert result.verdict.startswith("These scans do not fit this map")
    assert ("--global" in result.verdict) == (not is_global)


def test_a_mirrored_room_fits_only_in_part(files: LocalizationSettings, tmp_path: Path) -> None:
    wrong = save_map(mirrored(room()), tmp_path / "mirrored.yaml")
    result = result_of(LocalizationSettings(files.log, wrong, is_global=True))
    assert result.fit < 0.85  # the four outer walls are the same
    assert not result.fits_map or "only in part" in result.verdict


def test_the_right_map_fits(files: LocalizationSettings) -> None:
    result = result_of(files)
    assert result.fits_map
    assert result.fit > 0.95
    assert result.map_coverage > 0.95
    assert result.lost_probability < 0.05
    assert "the robot is localized" in result.verdict


def test_a_map_that_lacks_most_of_the_place_does_not_fit(files: LocalizationSettings, tmp_path: Path) -> None:
    grid = room()
    probability = grid.probability.copy()
    probability[:, 40:] = 0.5
    part = save_map(OccupancyGrid(probability, grid.resolution, grid.origin), tmp_path / "part.yaml")
    result = result_of(LocalizationSettings(files.log, part, reference=files.reference))
    assert not result.fits_map
    assert "covers only" in result.verdict


def test_two_poses_that_fit_equally_are_said(files: LocalizationSettings, tmp_path: Path) -> None:
    grid = room()
    symmetric = np.maximum(grid.probability, grid.probability[::-1, ::-1])
    log = write_log(tmp_path, OccupancyGrid(symmetric, grid.resolution, grid.origin))
    result = result_of(LocalizationSettings(log.log, log.map_file, is_global=True))
    assert result.fits_map
    assert result.lost_probability == pytest.approx(0.5, abs=0.05)
    assert "2 poses fit equally: x " in result.verdict
    centre = grid.origin @ Pose(3.0, 2.0)
    turned = centre @ Pose(theta=math.pi) @ centre.inverse @ Pose(*result.final_pose)
    assert turned.distance_to(Pose(*result.alternative_poses[0].pose)) < 0.1
    assert json.loads(json.dumps(result.as_dict()))["alternative_poses"][0]["odds"] == pytest.approx(1.0, abs=0.3)


def moved_reference(files: LocalizationSettings, folder: Path, frame: Pose) -> Path:
    """The true trajectory in a frame whose pose in the map frame is given."""
    assert files.reference is not None
    rows = np.loadtxt(files.reference)
    poses = [(frame.inverse @ Pose.from_array(row[1:])).as_array() for row in rows]
    np.savetxt(folder / "moved.txt", np.column_stack([rows[:, 0], poses]))
    return folder / "moved.txt"


def test_a_reference_in_the_map_frame_is_compared_without_alignment(files: LocalizationSettings) -> None:
    result = result_of(files)
    assert result.rmse_m is not None
    assert result.aligned_rmse_m is not None
    assert result.aligned_rmse_m <= result.rmse_m < 0.05
    assert result.reference_offset is None
    assert result.reference_scans == 60
    assert result.reference_verdict == "The reference is in the map frame; 60 of 60 scans are compared."


def test_a_reference_in_nanoseconds_is_converted_and_it_is_said(files: LocalizationSettings, tmp_path: Path) -> None:
    assert files.reference is not None
    rows = np.loadtxt(files.reference)
    rows[:, 0] = np.round(1e9 * rows[:, 0])
    np.savetxt(tmp_path / "reference.txt", rows, fmt=["%d", "%.6f", "%.6f", "%.6f"])
    run = prepare(replace(files, reference=tmp_path / "reference.txt"))
    assert any("reference.txt are in nanoseconds: they are converted to seconds" in note for note in run.log.notes)
    assert run.log.scan_odometry


def test_a_reference_in_another_frame_is_aligned_and_said(files: LocalizationSettings, tmp_path: Path) -> None:
    frame = Pose(12.0, -7.0, 1.2)
    run = prepare(LocalizationSettings(files.log, files.map_file, reference=moved_reference(files, tmp_path, frame)))
    list(run.steps())
    result = run.result()
    assert result.rmse_m is None
    assert result.aligned_rmse_m is not None
    assert result.aligned_rmse_m < 0.05
    assert result.reference_offset is not None
    assert np.abs(np.array(result.reference_offset) - frame.as_array()).max() < 0.4  # 14 m away
    assert "in another frame than the map (offset x 1" in (result.reference_verdict or "")
    assert any("do not fit the map at the reference's first pose" in note for note in run.log.notes)


def test_a_reference_that_begins_late_still_gives_the_start(files: LocalizationSettings, tmp_path: Path) -> None:
    assert files.reference is not None
    lines = files.reference.read_text().splitlines()
    (tmp_path / "late.txt").write_text("\n".join(lines[10:]) + "\n")
    result = result_of(LocalizationSettings(files.log, files.map_file, reference=tmp_path / "late.txt"))
    assert result.reference_scans == 50
    assert result.rmse_m is not None
    assert result.rmse_m < 0.05


def test_a_reference_is_not_interpolated_over_its_gaps(files: LocalizationSettings, tmp_path: Path) -> None:
    assert files.reference is not None
    lines = files.reference.read_text().splitlines()
    (tmp_path / "gap.txt").write_text("\n".join(lines[:10] + lines[40:]) + "\n")
    result = result_of(LocalizationSettings(files.log, files.map_file, reference=tmp_path / "gap.txt"))
    assert result.reference_scans == 30


def test_a_reference_in_nanoseconds_is_compared(files: LocalizationSettings, tmp_path: Path) -> None:
    assert files.reference is not None
    rows = np.loadtxt(files.reference)[1:]
    rows[:, 0] *= 1e9
    np.savetxt(tmp_path / "ns.txt", rows)
    result = result_of(LocalizationSettings(files.log, files.map_file, reference=tmp_path / "ns.txt"))
    assert result.reference_scans == 59
    assert result.rmse_m is not None
    assert result.rmse_m < 0.05


@pytest.mark.parametrize("missing", [range(10), range(50, 60), range(20, 40)], ids=["begin", "end", "hole"])
def test_scans_without_odometry_are_left_out_and_said(files: LocalizationSettings, missing: range) -> None:
    log = read_log(files.log)
    odometry = tuple(None if index in missing else one for index, one in enumerate(log.scan_odometry))
    run = prepare(files, replace(log, scan_odometry=odometry))
    list(run.steps())
    result = run.result()
    at = log.scans[missing.start].time
    note = f"{len(missing)} of 60 scans have no odometry and are left out, the first at {at:.1f} s."
    assert note in run.log.notes
    assert result.scans == 60 - len(missing)
    assert result.rmse_m is not None
    assert result.rmse_m < 0.05


@pytest.mark.parametrize(("count", "reason"), [(0, "has no odometry"), (5, "has odometry for only 5 of 60 scans")])
def test_a_log_with_hardly_any_odometry_is_refused(files: LocalizationSettings, count: int, reason: str) -> None:
    log = read_log(files.log)
    odometry = tuple(one if index < count else None for index, one in enumerate(log.scan_odometry))
    with pytest.raises(InputError, match=f"{reason}, which localization needs; wherry map can do without"):
        prepare(files, replace(log, scan_odometry=odometry))


def test_a_start_at_the_origin_is_said(files: LocalizationSettings) -> None:
    notes = prepare(LocalizationSettings(files.log, files.map_file)).log.notes
    assert any("starts at (x 0.00 m, y 0.00 m, 0°), the map's origin" in note for note in notes)
    assert any("do not fit the map there; --global searches the whole map" in note for note in notes)
