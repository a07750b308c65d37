"""Point clouds, matching grids, correlation and refinement: exact without noise, then with it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wherry.mapping.correlative import SearchWindow, correlate, score_at
from wherry.mapping.matching_grid import MAX_LIKELIHOOD, WINDOW_SIZES, MatchingGrid
from wherry.mapping.matching_grid import RESOLUTION as CELL
from wherry.mapping.motion_noise import ODOMETRY_NOISE
from wherry.mapping.point_cloud import MIN_POINT_SPACING, PointCloud, merge_clouds
from wherry.mapping.refinement import Refinement, refine
from wherry.mapping.scan_matching import _fused_with_prior, find_scan, track_scan
from wherry.robot import Scan
from wherry.space.pose import Pose
from wherry.space.raycast import cast_rays
from wherry_testing.buildings import LIDAR, RANGE_MAX, RESOLUTION, building
from wherry_testing.corridors import bare_corridor

HERE = Pose(2.4, 2.0, 0.4)


def scan_at(pose: Pose, beams: int = 360, fov: float = math.tau, noise: float = 0.0, seed: int = 0) -> Scan:
    angles = -fov / 2 + fov / beams * np.arange(beams)
    ranges = cast_rays(building(), RESOLUTION, Pose(), (pose @ LIDAR).as_array()[None], angles, RANGE_MAX)[0]
    ranges = ranges + np.random.default_rng(seed).normal(0, 1, beams) * noise
    return Scan(0.0, ranges, -fov / 2, fov / beams, 0.05, RANGE_MAX)


def cloud_at(pose: Pose, **kwargs: float) -> PointCloud:
    return PointCloud.from_scan(scan_at(pose, **kwargs), LIDAR)  # type: ignore[arg-type]


def grid_at(*poses: Pose, noise: float = 0.0) -> MatchingGrid:
    grid = MatchingGrid()
    for number, pose in enumerate(poses):
        grid.add(cloud_at(pose, noise=noise, seed=number + 100).transformed(pose.relative_to(HERE)))
    return grid


def test_points_lie_on_walls_and_normals_face_the_lidar() -> None:
    cloud = cloud_at(HERE)
    world = cloud.transformed(HERE)
    known = np.hypot(*cloud.normals.T) > 0
    assert known.mean() > 0.8
    np.testing.assert_allclose(np.hypot(*cloud.normals[known].T), 1.0, atol=1e-9)
    towards = LIDAR.as_array()[:2] - cloud.points
    assert ((towards * cloud.normals).sum(axis=1)[known] > 0).all()
    on_left_wall = known & (world.points[:, 0] < 0.061) & (world.points[:, 1] > 0.5) & (world.points[:, 1] < 3.0)
    assert on_left_wall.sum() > 10
    np.testing.assert_allclose(world.normals[on_left_wall], [[1.0, 0.0]] * int(on_left_wall.sum()), atol=1e-6)


def test_invalid_distant_and_redundant_readings_are_left_out() -> None:
    scan = scan_at(HERE, beams=1440)
    ranges = scan.ranges.copy()
    ranges[::3], ranges[1::3] = np.nan, np.inf
    broken = Scan(0.0, ranges, scan.angle_min, scan.angle_increment, 0.05, RANGE_MAX)
    cloud = PointCloud.from_scan(broken, Pose(), range_limit=2.0)
    assert 0 < len(cloud.points) < 480
    assert np.hypot(*cloud.points.T).max() <= 2.0
    steps = np.hypot(*np.diff(PointCloud.from_scan(scan, Pose()).points, axis=0).T)
    assert steps.min() >= MIN_POINT_SPACING - 1e-9
    empty = Scan(0.0, np.full(10, np.nan), 0.0, 0.1, 0.05, RANGE_MAX)
    assert PointCloud.from_scan(empty, Pose()).points.shape == (0, 2)


def test_merging_keeps_one_point_per_cell() -> None:
    cloud = cloud_at(HERE)
    both = merge_clouds([cloud, cloud], 0.1)
    assert len(both.points) == len(np.unique(np.floor(cloud.points / 0.1), axis=0))


def test_levels_are_the_exact_maxima_of_their_windows() -> None:
    grid = grid_at(HERE)
    finest = grid.likelihood[0]
    assert finest.max() == MAX_LIKELIHOOD
    for number, level in enumerate(WINDOW_SIZES):
        windows = np.lib.stride_tricks.sliding_window_view(finest, (level, level)).max(axis=(2, 3))
        np.testing.assert_array_equal(grid.likelihood[number][: len(windows), : windows.shape[1]], windows)


def test_a_grid_that_grows_keeps_its_likelihoods() -> None:
    far = Pose(9.4, 2.0, 1.0)
    grown = grid_at(HERE, far)
    columns, rows = (grid_at(far).corner - grown.corner).tolist()
    alone = grid_at(far).likelihood[0]
    part = grown.likelihood[0][rows : rows + alone.shape[0], columns : columns + alone.shape[1]]
    assert (part >= alone).all()


@given(x=st.floats(-0.4, 0.4), y=st.floats(-0.4, 0.4), theta=st.floats(-0.3, 0.3))
@settings(max_examples=25, deadline=None)
def test_a_scan_is_found_anywhere_in_the_window(x: float, y: float, theta: float) -> None:
    cloud = cloud_at(HERE)
    found = correlate(grid_at(HERE), cloud.points, SearchWindow(Pose(x, y, theta), 0.5, 0.4))
    assert (
        found.score > 0.75
    )  # not 1, since the true pose is up to half a cell and half an angle step from the searched ones
    assert max(abs(found.pose.x), abs(found.pose.y)) < CELL
    assert abs(found.pose.theta) < math.radians(1.5)


def test_branch_and_bound_agrees_with_an_exhaustive_search() -> None:
    grid, cloud = grid_at(HERE), cloud_at(HERE @ Pose(0.12, -0.07, 0.05)).subsampled(60)
    window = SearchWindow(Pose(0.05, 0.0, 0.0), 0.2, 0.0)
    found = correlate(grid, cloud.points, window)
    steps = np.arange(-4, 5) * CELL
    scores = {
        (x, y): score_at(grid, cloud.points, Pose(0.05 + x, y, 0.0)) for x in steps.tolist() for y in steps.tolist()
    }
    best = max(scores.values())
    assert found.score == pytest.approx(score_at(grid, cloud.points, found.pose))
    assert found.score > best - 0.03  # the prior may prefer a pose nearer to the centre


def test_a_corridor_is_ambiguous_and_a_room_is_not() -> None:
    corridor = bare_corridor(8.0)
    grid = MatchingGrid()
    grid.add(corridor)
    part = np.abs(corridor.points[:, 0]) < 3.0
    along = correlate(grid, corridor.points[part], SearchWindow(Pose(), 2.0, 0.05), second_best_share=0.9)
    assert along.second_best_score > 0.9 * along.score
    inside = correlate(grid_at(HERE), cloud_at(HERE).points, SearchWindow(Pose(), 2.0, 0.3), second_best_share=0.9)
    assert inside.second_best_score < 0.9 * inside.score


@given(x=st.floats(-0.03, 0.03), y=st.floats(-0.03, 0.03), theta=st.floats(-0.02, 0.02))
@settings(max_examples=25, deadline=None)
def test_refinement_without_noise_is_exact(x: float, y: float, theta: float) -> None:
    match = refine(grid_at(HERE), cloud_at(HERE), Pose(x, y, theta))
    assert math.hypot(match.pose.x, match.pose.y) < 0.003
    assert abs(match.pose.theta) < 0.002
    assert match.overlap > 0.95


def test_refinement_errors_with_noise_agree_with_the_information() -> None:
    around = [HERE @ Pose(0.05 * n, 0.02 * n, 0.05 * n) for n in range(5)]
    grid = grid_at(*around, noise=0.02)
    errors = []
    for seed in range(20):
        match = refine(grid, cloud_at(HERE @ Pose(0.1, 0.0, 0.1), noise=0.02, seed=seed), Pose(0.11, 0.01, 0.11))
        errors.append(match.pose.relative_to(Pose(0.1, 0.0, 0.1)).as_array())
    deviations = np.sqrt(np.diag(np.linalg.inv(match.information)))
    assert np.sqrt((np.array(errors) ** 2).mean(axis=0)) == pytest.approx([0, 0, 0], abs=0.01)
    assert (np.std(errors, axis=0) < 3.0 * deviations).all()


def test_a_bare_corridor_gives_no_information_along_it() -> None:
    x = np.arange(-8.0, 8.0, 0.05)
    rng = np.random.default_rng(0)
    walls = np.vstack([np.column_stack([x, np.full_like(x, side)]) for side in (-0.8, 0.8)])
    tilt = rng.normal(0.0, math.radians(3.0), len(walls))
    normals = np.column_stack([np.sin(tilt), -np.sign(walls[:, 1]) * np.cos(tilt)])
    grid = MatchingGrid()
    grid.add(PointCloud(walls, normals))
    match = refine(grid, PointCloud(walls[::3], normals[::3]), Pose(0.1, 0.02, 0.01), prior=Pose(0.1, 0.0, 0.0))
    assert match.information[0, 0] < 1e-3 * match.information[1, 1]
    assert match.pose.x == pytest.approx(0.1, abs=1e-3), "odometry alone determines the position along the corridor"
    assert match.pose.y == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize(("beams", "fov"), [(180, math.pi), (361, math.pi), (360, math.tau), (1081, 1.5 * math.pi)])
def test_scans_of_any_field_of_view_are_matched(beams: int, fov: float) -> None:
    grid = MatchingGrid()
    grid.add(cloud_at(HERE, beams=beams, fov=fov))
    there = Pose(0.3, 0.1, 0.2)
    match = find_scan(
        grid, cloud_at(HERE @ there, beams=beams, fov=fov), Pose(0.4, 0.0, 0.1), Pose(0.4), ODOMETRY_NOISE
    )
    assert match is not None
    assert match.pose.distance_to(there) < 0.02
    assert abs(match.pose.theta - there.theta) < 0.01


def test_a_scan_is_found_where_odometry_slipped_beyond_its_noise() -> None:
    there = Pose(0.3, 0.1, math.radians(15.0))
    _, angle = ODOMETRY_NOISE.deviations(Pose(0.3))
    assert 3.0 * angle < there.theta
    match = find_scan(grid_at(HERE), cloud_at(HERE @ there), Pose(0.3), Pose(0.3), ODOMETRY_NOISE)
    assert match is not None
    assert match.pose.distance_to(there) < 0.02
    assert match.pose.theta == pytest.approx(there.theta, abs=0.01)


def test_a_scan_that_matches_at_no_pose_has_no_match() -> None:
    grid = grid_at(HERE)
    assert find_scan(grid, cloud_at(Pose(9.4, 7.0, 2.0)), Pose(), Pose(0.1), ODOMETRY_NOISE) is None
    few = PointCloud(np.ones((5, 2)), np.zeros((5, 2)))
    assert find_scan(grid, few, Pose(), Pose(0.1), ODOMETRY_NOISE) is None
    assert track_scan(grid, few, Pose(), Pose(0.1), ODOMETRY_NOISE) is None
    tracked = track_scan(grid, cloud_at(HERE @ Pose(0.02)), Pose(0.03), Pose(0.03), ODOMETRY_NOISE)
    assert tracked is not None
    assert tracked.pose.x == pytest.approx(0.02, abs=0.005)


def test_the_prior_determines_what_the_points_leave_open() -> None:
    across = Refinement(Pose(0.3, 0.0, 0.1), np.diag([0.0, 1e6, 1e6]), overlap=0.5, residual=0.02)
    fused = _fused_with_prior(Pose(0.3, 0.02, 0.01), across, Pose(), ODOMETRY_NOISE.information(Pose(1.0)))
    assert fused.pose.x == pytest.approx(0.0, abs=0.01), "the points do not determine it along the corridor"
    assert fused.pose.y == pytest.approx(0.02, abs=0.005)
    assert fused.pose.theta == pytest.approx(0.01, abs=0.002)
    assert fused.information[0, 0] < 2.0
    assert fused.information[1, 1] > 300.0
