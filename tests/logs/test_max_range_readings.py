"""Readings of beams without a return, told from real walls at a constant long range."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from wherry.logs.max_range_readings import mark_beams_without_return
from wherry.robot import Odometry, Scan, Velocity, mark_no_return
from wherry.space.pose import Floats, Pose
from wherry_testing.analytic_rooms import circle_ranges, rectangle_ranges

ANGLES = np.arange(180) * math.tau / 180.0
CODE = 8.19  # m, reading of the lidar without a return
DRIVE = [Pose(-8.0 + 0.1 * n, 1.0, 0.02 * n) for n in range(100)]
TURN = [Pose(0.0, 0.0, 0.05 * n) for n in range(100)]
STAND = [Pose()] * 100


def marked(ranges: Sequence[Floats], poses: Sequence[Pose | None]) -> tuple[tuple[Scan, ...], str]:
    increment = math.tau / len(ranges[0])
    scans = [Scan(float(n), row, 0.0, increment, 0.05, 100.0) for n, row in enumerate(ranges)]
    odometry = [None if p is None else Odometry(float(n), p, Velocity()) for n, p in enumerate(poses)]
    return mark_beams_without_return(scans, odometry)


def hall(poses: Sequence[Pose], longest: float = CODE, cell: float = 0.001) -> list[Floats]:
    """Readings of a lidar that reaches ``longest`` in a hall of 30 × 12 m, to a multiple of ``cell``, m."""
    ranges = [rectangle_ranges(pose, ANGLES, 30.0, 12.0) for pose in poses]
    return [np.where(row >= longest, longest, np.minimum((row / cell).round() * cell, longest)) for row in ranges]


@pytest.mark.parametrize("cell", [0.001, 0.01, 0.05])
@pytest.mark.parametrize(
    ("longest", "has_odometry"), [(5.5, True), (CODE, True), (CODE, False), (12.0, True), (12.0, False)]
)
def test_beams_without_a_return_are_found_whether_few_or_most(longest: float, has_odometry: bool, cell: float) -> None:
    readings = hall(DRIVE, longest, cell)
    scans, note = marked(readings, DRIVE if has_odometry else [None] * 100)
    share = np.mean([row == longest for row in readings])
    assert note.endswith(f"of the readings are {longest:.2f} m, the longest of all: they are taken as no return")
    assert float(note.partition("%")[0]) / 100.0 == pytest.approx(share, abs=0.02)
    for scan, row in zip(scans, readings, strict=True):
        assert np.isinf(scan.ranges[row == longest]).all()
        assert np.array_equal(scan.ranges[row < longest - 0.1], row[row < longest - 0.1])
    assert (share > 0.5) == (longest < 10.0)


def test_a_hall_in_which_the_lidar_stands_is_kept_and_said() -> None:
    readings = hall(STAND)
    scans, note = marked(readings, STAND)
    assert note.endswith("the longest of all; since the robot stays in its place, they are kept as walls")
    assert all(np.array_equal(scan.ranges, row) for scan, row in zip(scans, readings, strict=True))


@pytest.mark.parametrize("beams", [8, 180, 720])
@pytest.mark.parametrize("poses", [STAND, TURN], ids=["stands", "turns"])
@pytest.mark.parametrize("has_odometry", [True, False])
@pytest.mark.parametrize("cell", [1e-9, 0.01])
def test_the_wall_of_a_round_hall_is_kept(cell: float, has_odometry: bool, poses: list[Pose], beams: int) -> None:
    angles = np.arange(beams) * math.tau / beams
    pillars = np.where(np.cos(3.0 * angles) > 0.5, 2.0, np.inf)
    walls = [np.minimum(circle_ranges(pose, angles, 8.0), np.roll(pillars, n % beams)) for n, pose in enumerate(poses)]
    readings = [(row / cell).round() * cell for row in walls]
    scans, _ = marked(readings, poses if has_odometry else [None] * len(poses))
    assert all(np.array_equal(scan.ranges, row) for scan, row in zip(scans, readings, strict=True))


def test_the_wall_of_a_round_hall_is_kept_by_a_robot_that_drives() -> None:
    poses = [Pose(0.01 * n, 0.0, 0.0) for n in range(100)]
    readings = [circle_ranges(pose, ANGLES, 8.0).round(2) for pose in poses]
    scans, note = marked(readings, poses)
    assert not note
    assert all(np.array_equal(scan.ranges, row) for scan, row in zip(scans, readings, strict=True))


@pytest.mark.parametrize("cell", [0.001, 0.01])
def test_the_end_of_a_corridor_is_kept_where_the_robot_waits_before_it_drives(cell: float) -> None:
    angles = np.radians(np.arange(-90.0, 90.0, 0.25))
    poses = [Pose(-6.0)] * 200 + [Pose(-6.0 + 0.05 * n) for n in range(100)]
    readings = [(rectangle_ranges(pose, angles, 12.2, 1.0) / cell).round() * cell for pose in poses]
    scans, _ = marked(readings, poses)
    assert all(np.array_equal(scan.ranges, row) for scan, row in zip(scans, readings, strict=True))


@pytest.mark.parametrize("beams", [4, 8, 360])
def test_a_wall_along_which_the_robot_drives_is_kept(beams: int) -> None:
    angles = np.arange(beams) * math.tau / beams
    poses = [Pose(0.05 * n, 0.0, 0.0) for n in range(200)]
    ranges = rectangle_ranges(Pose(), angles, 1e6, 12.0)
    readings = [np.where(np.abs(ranges) < 6.1, ranges.round(2), np.inf)] * 200
    scans, _ = marked(readings, poses)
    assert all(np.array_equal(scan.ranges, row) for scan, row in zip(scans, readings, strict=True))


def test_readings_that_are_all_equal_are_kept_and_said() -> None:
    scans, note = marked([np.full(180, 5.0)] * 100, DRIVE)
    assert note.endswith("; since there are hardly any others, they are kept as walls")
    assert all((scan.ranges == 5.0).all() for scan in scans)


def test_a_covered_lidar_has_no_readings_of_its_own_for_no_return() -> None:
    readings = [np.full(180, 0.06)] * 60 + [np.full(180, 0.01)] * 40
    scans, note = marked(readings, DRIVE)
    assert not note
    assert all(np.array_equal(scan.ranges, row) for scan, row in zip(scans, readings, strict=True))


def test_readings_at_the_longest_range_are_no_return() -> None:
    ranges = np.array([1.0, 11.9, 11.9899, 11.9999, 12.0, 65.5, np.nan, 0.0])
    expected = [1.0, 11.9, 11.9899, np.inf, np.inf, np.inf, np.nan, 0.0]
    np.testing.assert_array_equal(mark_no_return(ranges, 12.0), expected)


@pytest.mark.parametrize("cell", [0.001, 0.01])
def test_beams_without_a_return_are_found_where_more_readings_are_a_little_shorter(cell: float) -> None:
    poses = [Pose(-2.0 + 0.04 * n, 1.0, 0.02 * n) for n in range(100)]
    ranges = [rectangle_ranges(pose, ANGLES, 10.0, 11.0) for pose in poses]
    readings = [np.where(row >= CODE, CODE, (row / cell).round() * cell) for row in ranges]
    near, below = (
        sum(((row > low) & (row <= high)).sum() for row in readings) for low, high in ((8.1, 8.2), (7.1, 8.1))
    )
    assert near < below
    assert sum((row == CODE).sum() for row in readings) < 0.9 * near  # with walls beside it
    scans, note = marked(readings, poses)
    assert note.endswith("8.19 m, the longest of all: they are taken as no return")
    for scan, row in zip(scans, readings, strict=True):
        assert np.isposinf(scan.ranges[row == CODE]).all()
        assert np.array_equal(scan.ranges[row < CODE - 0.1], row[row < CODE - 0.1])


def test_readings_of_a_long_log_are_counted_in_some_of_its_scans(monkeypatch: pytest.MonkeyPatch) -> None:
    readings = hall(DRIVE)
    monkeypatch.setattr("wherry.logs.max_range_readings.MAX_COUNTED", 180 * 20)
    scans, note = marked(readings, DRIVE)
    assert note.endswith("8.19 m, the longest of all: they are taken as no return")
    assert all(np.isposinf(scan.ranges[row == CODE]).all() for scan, row in zip(scans, readings, strict=True))
