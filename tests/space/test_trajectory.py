"""Trajectories: interpolation along arcs, and files in the formats TUM, CSV and KITTI."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.space.trajectory import Trajectory, save_trajectory, save_tum

TIMES = np.array([1.5, 2.0])
POSES = np.array([[1.0, -2.0, 0.0], [3.0, 4.0, math.pi / 2.0]])
TRAJECTORY = Trajectory(TIMES, POSES)
QUARTER = Trajectory(np.array([0.0, 1.0]), np.array([[0.0, 0.0, 0.0], [2.0, 2.0, math.pi / 2.0]]))
"""A quarter of a circle with a radius of 2 m to the left."""


@pytest.mark.parametrize("time", [-0.5, 0.0, 0.25, 0.5, 1.0, 1.25])
def test_poses_between_and_beyond_readings_lie_on_the_arc(time: float) -> None:
    angle = time * math.pi / 2.0
    expected = [2.0 * math.sin(angle), 2.0 - 2.0 * math.cos(angle), angle]
    assert QUARTER.along_arcs(np.array([time]))[0] == pytest.approx(expected, abs=1e-12)


def test_a_straight_motion_is_interpolated_in_proportion_to_time() -> None:
    straight = Trajectory(np.array([0.0, 2.0, 3.0]), np.array([[0.0, 0.0, 0.3], [1.0, 2.0, 0.3], [1.0, 2.0, 0.3]]))
    expected = [[0.5, 1.0, 0.3], [1.0, 2.0, 0.3]]
    np.testing.assert_allclose(straight.along_arcs(np.array([1.0, 2.5])), expected, atol=1e-12)


def test_formats_have_the_poses_in_their_own_order(tmp_path: Path) -> None:
    save_tum(TRAJECTORY, tmp_path / "a")
    half = f"{math.sqrt(0.5):.6f}"
    assert (tmp_path / "a").read_text().splitlines() == [
        "# time x y z qx qy qz qw",
        "1.500000 1.000000 -2.000000 0.000000 0.000000 0.000000 0.000000 1.000000",
        f"2.000000 3.000000 4.000000 0.000000 0.000000 0.000000 {half} {half}",
    ]
    save_trajectory(TRAJECTORY, tmp_path / "a", "csv")
    assert (tmp_path / "a").read_text().splitlines() == [
        "time,x,y,theta",
        "1.500000,1.000000,-2.000000,0.000000",
        "2.000000,3.000000,4.000000,1.570796",
    ]
    save_trajectory(TRAJECTORY, tmp_path / "a", "kitti")
    matrices = np.loadtxt(tmp_path / "a").reshape(2, 3, 4)
    np.testing.assert_allclose(matrices[1], [[0, -1, 0, 3], [1, 0, 0, 4], [0, 0, 1, 0]], atol=1e-9)


def test_the_format_is_that_of_the_suffix_or_the_one_named(tmp_path: Path) -> None:
    for suffix in ("tum", "csv", "kitti"):
        save_trajectory(TRAJECTORY, tmp_path / f"a.{suffix}")
        save_trajectory(TRAJECTORY, tmp_path / "b.txt", suffix)
        assert (tmp_path / f"a.{suffix}").read_text() == (tmp_path / "b.txt").read_text()
    with pytest.raises(InputError, match="'txt' is no format of trajectories; there are tum, csv, kitti"):
        save_trajectory(TRAJECTORY, tmp_path / "b.txt")
