"""Trajectory errors, on cases with known exact results."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wherry.errors import InputError
from wherry.evaluation import (
    Relations,
    absolute_trajectory_error,
    align,
    load_relations,
    matching_times,
    position_errors,
    relation_errors,
    root_mean_square,
)
from wherry.logs.tables import read_odometry
from wherry.space.pose import Pose, compose, relative
from wherry.space.trajectory import Trajectory, save_tum
from wherry_testing.buildings import shared_data

TIMES = np.array([0.0, 10.0, 20.0, 100.0])
POSES = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, math.pi / 2], [1.0, 2.0, math.pi], [-3.0, 2.0, -math.pi / 2]])


def true_relations(pairs: list[tuple[int, int]]) -> Relations:
    first, second = POSES[[a for a, _ in pairs]], POSES[[b for _, b in pairs]]
    return Relations(np.array([[TIMES[a], TIMES[b]] for a, b in pairs]), relative(second, first))


def test_relations_in_nanoseconds_are_converted_and_it_is_said(tmp_path: Path) -> None:
    path = tmp_path / "some.relations"
    path.write_text(
        "1600000000500000000 1600000002000000000 1 2 0 0 0 0.5\n1600000002000000000 1600000003000000000 " + "0 " * 6
    )
    relations = load_relations(path)
    np.testing.assert_allclose(relations.times, 1.6e9 + np.array([[0.5, 2.0], [2.0, 3.0]]), atol=1e-6, rtol=0.0)
    np.testing.assert_array_equal(relations.poses, [[1.0, 2.0, 0.5], [0.0, 0.0, 0.0]])
    assert relations.notes == (f"the times of {path} are in nanoseconds: they are converted to seconds",)


def test_an_exact_trajectory_has_no_error_in_any_frame() -> None:
    relations = true_relations([(0, 1), (1, 2), (0, 3), (3, 1)])
    moved = compose(np.tile([5.0, -3.0, 1.2], (4, 1)), POSES)
    for poses in (POSES, moved):
        found = relation_errors(Trajectory(TIMES, poses), relations)
        assert found.translational_error_m == pytest.approx(0.0, abs=1e-12)
        assert found.rotational_error_deg == pytest.approx(0.0, abs=1e-12)
    assert found.relations == 4


def test_the_error_of_one_relation_is_exact() -> None:
    relations = true_relations([(0, 1)])
    perturbed = Relations(relations.times, compose(relations.poses, np.array([[0.3, -0.4, math.radians(10.0)]])))
    found = relation_errors(Trajectory(TIMES, POSES), perturbed)
    assert found.translational_error_m == pytest.approx(0.5)
    assert found.rotational_error_deg == pytest.approx(10.0)
    assert found.translational_sd_m == 0.0
    assert math.isnan(found.far_translational_error_m)


def test_means_standard_deviations_and_errors_of_far_relations() -> None:
    relations = true_relations([(0, 1), (0, 3)])
    offsets = np.array([[0.1, 0.0, math.radians(2.0)], [0.0, 0.3, math.radians(-4.0)]])
    found = relation_errors(Trajectory(TIMES, POSES), Relations(relations.times, compose(relations.poses, offsets)))
    assert found.translational_error_m == pytest.approx(0.2)
    assert found.translational_sd_m == pytest.approx(0.1)
    assert found.rotational_error_deg == pytest.approx(3.0)
    assert found.rotational_sd_deg == pytest.approx(1.0)
    assert found.far_translational_error_m == pytest.approx(0.3)


def test_comparing_with_no_relations_is_an_error() -> None:
    with pytest.raises(ValueError, match="no relations"):
        relation_errors(Trajectory(TIMES, POSES), Relations(np.zeros((0, 2)), np.zeros((0, 3))))


def test_poses_are_interpolated_with_odometry() -> None:
    sparse = Trajectory(np.array([0.0, 10.0]), np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]))
    assert sparse.at(np.array([2.5]))[0] == pytest.approx([0.5, 0.0, 0.0])
    # The odometry has its own frame; the robot stands still for 8 s and then drives.
    dense = Trajectory(np.array([0.0, 8.0, 10.0]), np.array([[7.0, 7.0, 1.0]] * 3))
    dense.poses[2] = compose(dense.poses[0], np.array([2.0, 0.0, 0.0]))
    assert sparse.at(np.array([8.0]), dense)[0] == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)
    assert sparse.at(np.array([9.0]), dense)[0] == pytest.approx([1.0, 0.0, 0.0])
    # A scale error of 10 % in the odometry is distributed in proportion to the distance.
    long = Trajectory(dense.times, np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [2.2, 0.0, 0.0]]))
    assert sparse.at(np.array([9.0, 10.0]), long) == pytest.approx(np.array([[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]))


def test_interpolation_at_the_times_of_poses_returns_the_poses() -> None:
    odometry = Trajectory(np.linspace(0, 100, 50), np.random.default_rng(0).normal(size=(50, 3)))
    for found in (Trajectory(TIMES, POSES).at(TIMES), Trajectory(TIMES, POSES).at(TIMES, odometry)):
        np.testing.assert_allclose(relative(found, POSES), 0.0, atol=1e-9)


poses = st.tuples(st.floats(-20, 20), st.floats(-20, 20), st.floats(-math.pi, math.pi))


@given(st.lists(poses, min_size=1, max_size=8), poses)
def test_alignment_with_headings_recovers_any_rigid_motion(
    estimated: list[tuple[float, float, float]], motion: tuple[float, float, float]
) -> None:
    estimates = np.array(estimated)
    reference = compose(np.tile(motion, (len(estimates), 1)), estimates)
    alignment = align(estimates, reference, heading_lever=1.0)
    assert position_errors(estimates, reference, alignment).max() < 1e-6


@given(x=st.floats(-9, 9), y=st.floats(-9, 9), theta=st.floats(-3, 3))
def test_alignment_of_positions_recovers_any_rigid_motion(x: float, y: float, theta: float) -> None:
    reference = np.random.default_rng(0).normal(size=(20, 3)) * 5.0
    moved = compose(np.tile([x, y, theta], (20, 1)), reference)
    alignment = align(moved[:, :2], reference[:, :2])
    np.testing.assert_allclose((alignment @ Pose(x, y, theta)).as_array(), 0.0, atol=1e-8)
    assert absolute_trajectory_error(moved, reference) == pytest.approx(0.0, abs=1e-9)


def test_alignment_keeps_errors_that_no_rigid_motion_removes() -> None:
    estimated = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    reference = estimated + np.array([[0.0, 0.1, 0.0], [0.0, -0.2, 0.0], [0.0, 0.1, 0.0]])  # not a rigid motion
    errors = position_errors(estimated, reference, align(estimated, reference, heading_lever=1.0))
    assert root_mean_square(errors) == pytest.approx(math.sqrt((0.01 + 0.04 + 0.01) / 3))


def test_the_absolute_trajectory_error_is_the_root_mean_square() -> None:
    reference = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    scaled = 0.5 + (reference - 0.5) * 1.2  # every corner is off by 0.1 √2, which no rigid motion reduces
    assert absolute_trajectory_error(scaled, reference) == pytest.approx(0.1 * math.sqrt(2.0))


def test_a_trajectory_survives_the_tum_format(tmp_path: Path) -> None:
    save_tum(Trajectory(TIMES, POSES), tmp_path / "trajectory.tum")
    loaded = read_odometry(tmp_path / "trajectory.tum")
    np.testing.assert_allclose(loaded.times, TIMES)
    np.testing.assert_allclose(relative(loaded.poses, POSES), 0.0, atol=2e-6)


def test_relations_are_read_and_malformed_lines_are_reported(tmp_path: Path) -> None:
    path = tmp_path / "some.relations"
    path.write_text("# comment\n1.0 2.0 0.1 0.2 0 0 0 0.3\n")
    loaded = load_relations(path)
    np.testing.assert_allclose(loaded.times, [[1.0, 2.0]])
    np.testing.assert_allclose(loaded.poses, [[0.1, 0.2, 0.3]])
    path.write_text("1.0 2.0 0.1 0.2 0 0 0 0.3\n1.0 2.0 nan 0.2 0 0 0 0.3\n")
    with pytest.raises(InputError, match="line 2"):
        load_relations(path)
    path.write_text("")
    with pytest.raises(InputError, match="no numbers"):
        load_relations(path)


def test_the_reference_trajectory_of_intel_has_the_published_error() -> None:
    reference = read_odometry(shared_data("intel/intel_910_gfs_corrected_tum.txt.gz"))
    dense = read_odometry(shared_data("intel/intel_rawodom_dense.txt.gz"))
    relations = load_relations(shared_data("intel/intel.relations.gz"))
    found = relation_errors(reference, relations, dense)
    assert found.translational_error_m == pytest.approx(0.062, abs=0.006)


def test_a_reference_matches_times_near_its_poses_and_between_close_ones() -> None:
    reference = np.array([0.0, 0.5, 10.0, 11.5])
    times = np.array([-0.02, -0.005, 0.2, 0.509, 5.0, 9.995, 10.7, 11.505, 12.0])
    expected = [False, True, True, True, False, True, False, True, False]
    assert matching_times(reference, times).tolist() == expected
