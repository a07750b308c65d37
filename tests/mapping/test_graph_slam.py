"""Graph SLAM in a simulated building."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from wherry.mapping.constraints import Constraint
from wherry.mapping.graph_slam import GraphSlam
from wherry.mapping.scan_matching_localizer import ScanMatchingLocalizer, locate_on_map
from wherry.mapping.settings import GraphSlamSettings
from wherry.mapping.submap_graph import SubmapGraph
from wherry.mapping.tracking import MAX_EXTRAPOLATED_DISTANCE, TrackingState
from wherry.robot import Odometry, Scan, Velocity
from wherry.space.pose import Floats, Pose, relative
from wherry_testing.buildings import LIDAR, Drive, building, drive, wall_distances

SETTINGS = GraphSlamSettings(resolution=0.025)


def mapped(driven: Drive, *, with_odometry: bool = True, settings: GraphSlamSettings = SETTINGS) -> GraphSlam:
    slam = GraphSlam(LIDAR, settings)
    for scan, odometry in zip(driven.scans, driven.odometry, strict=True):
        slam.add(scan, odometry if with_odometry else None)
    slam.finish()
    return slam


def errors(slam: GraphSlam, truth: Floats) -> Floats:
    """Errors of the trajectory, [N, 2] m, rad."""
    off = relative(slam.trajectory.poses, truth)
    return np.column_stack([np.hypot(off[:, 0], off[:, 1]), np.abs(off[:, 2])])


@pytest.fixture(scope="module")
def noisy() -> tuple[Drive, GraphSlam]:
    driven = drive(noise=0.01, drift=0.03)
    return driven, mapped(driven)


def test_the_trajectory_is_exact_without_noise() -> None:
    driven = drive()
    off = errors(mapped(driven), driven.truth)
    assert off[:, 0].max() < 0.01
    assert off[:, 1].max() < math.radians(0.3)


def test_the_trajectory_is_accurate_with_noise_and_drift(noisy: tuple[Drive, GraphSlam]) -> None:
    driven, slam = noisy
    drifted = np.array([odometry.pose.as_array() for odometry in driven.odometry])
    assert np.hypot(*(drifted - driven.truth)[:, :2].T).max() > 0.5
    off = errors(slam, driven.truth)
    assert off[:, 0].mean() < 0.015
    assert off[:, 0].max() < 0.05
    assert off[:, 1].max() < math.radians(1.0)


def test_mapped_walls_coincide_with_the_true_walls(noisy: tuple[Drive, GraphSlam]) -> None:
    driven, slam = noisy
    distances = wall_distances(slam.grid(), driven.start, building())
    assert len(distances) > 2000
    assert np.median(distances) <= 0.02
    assert (distances > 0.06).mean() < 0.01


def test_accepted_closures_are_true_and_rejected_ones_have_a_reason(noisy: tuple[Drive, GraphSlam]) -> None:
    driven, slam = noisy
    accepted = [closure for closure in slam.loop_closures if closure.is_accepted]
    assert accepted
    scans = slam.snapshot().keyframe_scans
    for closure in accepted:
        first, second = driven.truth[scans[closure.target]], driven.truth[scans[closure.keyframe]]
        true = Pose.from_array(second).relative_to(Pose.from_array(first))
        assert closure.measured.distance_to(true) < 0.1
    assert all(closure.explanation for closure in slam.loop_closures if not closure.is_accepted)


def test_without_odometry_constant_velocity_is_assumed() -> None:
    driven = drive(noise=0.01, spacing=0.05)
    off = errors(mapped(driven, with_odometry=False), driven.truth)
    assert off[:, 0].max() < 0.1


def test_extrapolation_over_a_gap_without_odometry_is_bounded() -> None:
    tracking = TrackingState.begin(0.0, None).with_scan(0.5, Pose(0.5, 0.0, 0.1), None)
    motion = tracking.predictions(1.0, None)[0].motion
    assert (motion.x, motion.theta) == pytest.approx((0.5, 0.1))
    for gap in (230.0, 1e4):  # at 1 m/s the submap would not fit in memory
        motion = tracking.predictions(0.5 + gap, None)[0].motion
        assert motion.x == pytest.approx(MAX_EXTRAPOLATED_DISTANCE)
        assert motion.theta == pytest.approx(0.2 * MAX_EXTRAPOLATED_DISTANCE)
    again = tracking.with_scan(0.5, Pose(0.6, 0.0, 0.1), None)  # equal time stamps leave the velocity unchanged
    np.testing.assert_array_equal(again.velocity, tracking.velocity)


def test_excluded_discs_leave_no_hits_on_the_map() -> None:
    driven = drive()
    box = np.array([6.0, 4.3, 0.15])  # in the corridor, building frame
    scans = [
        replace(scan, ranges=np.minimum(scan.ranges, _disc_ranges(driven.start @ Pose.from_array(pose) @ LIDAR, box)))
        for scan, pose in zip(driven.scans, driven.truth, strict=True)
    ]
    slam = mapped(replace(driven, scans=scans))
    middle = driven.start.inverse.transform(box[None, :2])[0]
    beside = [
        np.hypot(*(grid.occupied_points() - middle).T).min()
        for grid in (slam.grid(), slam.grid(np.array([[*middle, 0.22]])), slam.grid())
    ]
    assert beside[0] < 0.2
    assert beside[1] > 0.3
    assert beside[2] == beside[0]


def _disc_ranges(lidar: Pose, disc: Floats) -> Floats:
    """Ranges to a disc (x, y, radius), [360] m; infinite where it is missed."""
    angles = lidar.theta + np.linspace(-math.pi, math.pi, 360, endpoint=False)
    dx, dy = disc[0] - lidar.x, disc[1] - lidar.y
    along = dx * np.cos(angles) + dy * np.sin(angles)
    aside = dx * np.sin(angles) - dy * np.cos(angles)
    inside = (np.abs(aside) < disc[2]) & (along > 0)
    half = np.sqrt(np.maximum(disc[2] ** 2 - aside**2, 0.0))
    ranges: Floats = np.where(inside, along - half, np.inf)
    return ranges


def test_a_grid_rendered_scan_by_scan_equals_one_rendered_at_once() -> None:
    driven = drive(spacing=0.3)
    settings = replace(SETTINGS, close_loops=False)
    slam = GraphSlam(LIDAR, settings)
    for scan, odometry in zip(driven.scans, driven.odometry, strict=True):
        slam.add(scan, odometry)
        grown = slam.grid()
    once = mapped(driven, settings=settings).grid()
    np.testing.assert_array_equal(grown.probability, once.probability)


def test_the_same_scans_give_the_same_bytes(noisy: tuple[Drive, GraphSlam]) -> None:
    driven, slam = noisy
    again = mapped(driven)
    assert again.trajectory.poses.tobytes() == slam.trajectory.poses.tobytes()
    assert again.grid().probability.tobytes() == slam.grid().probability.tobytes()


def test_scans_without_readings_follow_odometry() -> None:
    slam = GraphSlam()
    empty = Scan(0.0, np.full(360, np.nan), -math.pi, math.tau / 360, 0.05, 12.0)
    for n in range(4):
        pose = slam.add(replace(empty, time=float(n)), Odometry(float(n), Pose(0.5 * n, 0.0, 0.0), Velocity()))
        assert pose.distance_to(Pose(0.5 * n)) < 1e-6
    assert slam.grid().unknown.all()


def test_localization_on_a_finished_map_does_not_change_it(noisy: tuple[Drive, GraphSlam]) -> None:
    _driven, slam = noisy
    other = drive(noise=0.01, drift=0.03, seed=5, spacing=0.2)
    before = slam.keyframe_poses.copy()
    localizer = ScanMatchingLocalizer(slam, start=Pose(0.05, -0.03, 0.02))
    poses = [localizer.add(*pair).as_array() for pair in zip(other.scans, other.odometry, strict=True)]
    off = relative(np.array(poses), other.truth)[1:]
    assert np.hypot(off[:, 0], off[:, 1]).max() < 0.06
    np.testing.assert_array_equal(slam.keyframe_poses, before)


def test_a_closure_that_the_map_contradicts_does_not_narrow_the_search_window(noisy: tuple[Drive, GraphSlam]) -> None:
    snapshot = noisy[1].snapshot()
    poses, submaps = snapshot.keyframe_poses, SubmapGraph(snapshot.submaps, snapshot.submap_constraints.copy())
    before = submaps.constraint_covariances(poses)
    first, last = 0, len(submaps) - 1
    start, end = (Pose.from_array(poses[submaps[index].origin]) for index in (first, last))
    wrong = Pose(4.0) @ end.relative_to(start)
    submaps.add_constraint(Constraint(first, last, wrong, np.diag([0.02**2, 0.02**2, 0.005**2])))
    after = submaps.constraint_covariances(poses)
    np.testing.assert_array_equal(after[:-1], before)
    assert np.sqrt(after[-1, 0, 0]) > 1.0
    assert np.sqrt(np.median(before[:, 0, 0])) < 0.2


def test_mapping_resumes_at_another_pose() -> None:
    first, second = drive(noise=0.01, drift=0.03, spacing=0.2), drive(noise=0.01, drift=0.03, seed=4, spacing=0.2)
    slam = mapped(first)
    keyframes = len(slam.keyframe_poses)
    later = [replace(scan, time=scan.time + 1000.0) for scan in second.scans]
    located = locate_on_map(slam, later[0], Pose(1.0, -0.8, 0.4))
    assert located is not None
    assert located.distance_to(Pose()) < 0.05
    slam.resume(later[0], second.odometry[0], located)
    for scan, odometry in zip(later[1:], second.odometry[1:], strict=True):
        slam.add(scan, odometry)
    slam.finish()
    assert len(slam.keyframe_poses) > keyframes
    joined = [
        closure
        for closure in slam.loop_closures
        if closure.is_accepted and closure.target < keyframes <= closure.keyframe
    ]
    assert joined, "no loop is closed between the two logs"
    off = relative(slam.trajectory.poses[len(first.scans) :], second.truth)
    assert np.hypot(off[:, 0], off[:, 1]).max() < 0.06


def test_a_scan_that_matches_at_no_pose_is_not_located(noisy: tuple[Drive, GraphSlam]) -> None:
    driven, slam = noisy
    blind = replace(driven.scans[0], ranges=np.full(len(driven.scans[0].ranges), np.nan))
    assert locate_on_map(slam, blind, Pose()) is None
    round_hall = replace(driven.scans[0], ranges=np.full(len(driven.scans[0].ranges), 9.0))
    assert locate_on_map(slam, round_hall, Pose()) is None


def test_mapping_cannot_resume_before_the_first_scan() -> None:
    driven = drive()
    with pytest.raises(ValueError, match="before the first scan"):
        GraphSlam().resume(driven.scans[0], None, Pose())
