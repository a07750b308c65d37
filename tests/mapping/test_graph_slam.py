"""Graph SLAM in a building, and on real logs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from wherry.evaluation import absolute_trajectory_error, load_relations, relation_errors
from wherry.experiments.mapping.drifting_odometry import FALSE_DISTANCE, closure_errors, drifted, map_building
from wherry.logs.carmen import read_log, read_odometry
from wherry.mapping.graph_slam import GraphSlam, GraphSlamSettings
from wherry.mapping.localizer import MapLocalizer, place_on_map
from wherry.mapping.pieces import STEADY, Edge, Front
from wherry.pipelines.logs.mapping import merged_odometry
from wherry.robot import Odometry, Scan, Velocity
from wherry.space.pose import Floats, Pose, relative
from wherry_testing.buildings import LIDAR, Drive, building, drive, shared_data, wall_distances

SETTINGS = GraphSlamSettings(resolution=0.025)


def mapped(driven: Drive, *, with_odometry: bool = True, settings: GraphSlamSettings = SETTINGS) -> GraphSlam:
    slam = GraphSlam(LIDAR, settings)
    for scan, odometry in zip(driven.scans, driven.odometry, strict=True):
        slam.add(scan, odometry if with_odometry else None)
    slam.finish()
    return slam


def errors(slam: GraphSlam, truth: Floats) -> Floats:
    """[N, 2] m and rad, of the trajectory."""
    off = relative(slam.trajectory.poses, truth)
    return np.column_stack([np.hypot(off[:, 0], off[:, 1]), np.abs(off[:, 2])])


@pytest.fixture(scope="module")
def noisy() -> tuple[Drive, GraphSlam]:
    driven = drive(noise=0.01, drift=0.03)
    return driven, mapped(driven)


def test_without_noise_the_way_is_exact() -> None:
    driven = drive()
    off = errors(mapped(driven), driven.truth)
    assert off[:, 0].max() < 0.01
    assert off[:, 1].max() < math.radians(0.3)


def test_with_noise_and_drift_the_way_stays_right(noisy: tuple[Drive, GraphSlam]) -> None:
    driven, slam = noisy
    drifted = np.array([odometry.pose.as_array() for odometry in driven.odometry])
    assert np.hypot(*(drifted - driven.truth)[:, :2].T).max() > 0.5
    off = errors(slam, driven.truth)
    assert off[:, 0].mean() < 0.015
    assert off[:, 0].max() < 0.05
    assert off[:, 1].max() < math.radians(1.0)


def test_the_map_s_walls_are_where_the_walls_are(noisy: tuple[Drive, GraphSlam]) -> None:
    driven, slam = noisy
    distances = wall_distances(slam.grid(), driven.start, building())
    assert len(distances) > 2000
    assert np.median(distances) <= 0.02
    assert (distances > 0.06).mean() < 0.01


def test_loops_are_closed_and_every_one_is_told(noisy: tuple[Drive, GraphSlam]) -> None:
    driven, slam = noisy
    accepted = [closure for closure in slam.closures if closure.accepted]
    assert accepted
    keys: dict[int, int] = {}
    for number, (_, key, _) in enumerate(slam.passed):
        keys.setdefault(key, number)
    for closure in accepted:
        first, second = driven.truth[keys[closure.target]], driven.truth[keys[closure.node]]
        true = Pose.from_array(second).relative_to(Pose.from_array(first))
        assert closure.measured.distance_to(true) < 0.1
    assert all(closure.refused for closure in slam.closures if not closure.accepted)


def test_without_odometry_steady_motion_is_expected() -> None:
    driven = drive(noise=0.01, spacing=0.05)
    off = errors(mapped(driven, with_odometry=False), driven.truth)
    assert off[:, 0].max() < 0.1


def test_without_odometry_a_gap_in_the_log_is_no_journey() -> None:
    front = Front.begin(0.0, None).moved(0.5, Pose(0.5, 0.0, 0.1), None)
    movement, _ = front.expected_movement(1.0, None)
    assert (movement.x, movement.theta) == pytest.approx((0.5, 0.1))
    for gap in (230.0, 1e4):  # a submap that held the way of 1 m/s for so long would not fit in memory
        movement, _ = front.expected_movement(0.5 + gap, None)
        assert movement.x == pytest.approx(STEADY)
        assert movement.theta == pytest.approx(0.2 * STEADY)
    again = front.moved(0.5, Pose(0.6, 0.0, 0.1), None)  # stamps may be rounded: nothing is known of the speed then
    np.testing.assert_array_equal(again.rate, front.rate)


def test_boxes_that_stand_in_the_way_are_not_on_the_map() -> None:
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
    """[360] m to a disc (x, y, radius), or inf."""
    angles = lidar.theta + np.linspace(-math.pi, math.pi, 360, endpoint=False)
    dx, dy = disc[0] - lidar.x, disc[1] - lidar.y
    along = dx * np.cos(angles) + dy * np.sin(angles)
    aside = dx * np.sin(angles) - dy * np.cos(angles)
    inside = (np.abs(aside) < disc[2]) & (along > 0)
    half = np.sqrt(np.maximum(disc[2] ** 2 - aside**2, 0.0))
    ranges: Floats = np.where(inside, along - half, np.inf)
    return ranges


def test_the_grid_grown_scan_by_scan_is_the_grid_drawn_at_once() -> None:
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


def test_scans_that_say_nothing_are_passed_over() -> None:
    slam = GraphSlam()
    empty = Scan(0.0, np.full(360, np.nan), -math.pi, math.tau / 360, 0.05, 12.0)
    for n in range(4):
        pose = slam.add(replace(empty, time=float(n)), Odometry(float(n), Pose(0.5 * n, 0.0, 0.0), Velocity()))
        assert pose.distance_to(Pose(0.5 * n)) < 1e-6
    assert slam.grid().unknown.all()


def test_a_finished_map_is_localized_on_without_changing_it(noisy: tuple[Drive, GraphSlam]) -> None:
    _driven, slam = noisy
    other = drive(noise=0.01, drift=0.03, seed=5, spacing=0.2)
    before = slam.nodes.copy()
    localizer = MapLocalizer(slam, start=Pose(0.05, -0.03, 0.02))
    poses = [localizer.add(*pair).as_array() for pair in zip(other.scans, other.odometry, strict=True)]
    off = relative(np.array(poses), other.truth)[1:]
    assert np.hypot(off[:, 0], off[:, 1]).max() < 0.06
    np.testing.assert_array_equal(slam.nodes, before)


def test_intel_is_better_than_gmapping_s() -> None:
    log = read_log(shared_data("intel/intel_910_rawodom.clf.gz"))
    slam = GraphSlam(log.lidar, GraphSlamSettings(empty_range=0.0))
    for scan, odometry in zip(log.scans, log.scan_odometry, strict=True):
        slam.add(scan, odometry)
    slam.finish()
    dense = merged_odometry(log.odometry, read_odometry(shared_data("intel/intel_rawodom_dense.txt.gz")))
    found = relation_errors(slam.trajectory, load_relations(shared_data("intel/intel.relations.gz")), dense)
    assert found.relations == 2984
    assert found.translational_error_m <= 0.066
    assert found.far_translational_error_m <= 0.072
    assert found.rotational_error_deg <= 1.5


@pytest.mark.parametrize(("name", "largest"), [("aces", 0.15), ("csail", 0.15), ("fhw", 0.30)])
def test_drifting_odometry_is_put_right(name: str, largest: float) -> None:
    result = map_building(shared_data(f"radish/{name}-corrected.log.gz"), name, seed=1)
    assert result.odometry_rmse_m > 1.0
    assert result.rmse_m <= largest
    assert result.closures > 20
    assert result.false_closures == 0


def test_a_lidar_that_sees_less_far_closes_loops_after_it_erred() -> None:
    """Where the front end errs by more than it believes, windows are too narrow, and one closure alone is doubted."""
    log = read_log(shared_data("radish/fhw-corrected.log.gz"), lenient=True)
    reference = np.array([odometry.pose.as_array() for odometry in log.scan_odometry if odometry is not None])
    odometry = drifted(reference, np.random.default_rng(2))
    slam = GraphSlam(log.lidar, GraphSlamSettings(range_limit=12.0, empty_range=0.0))
    for scan, pose in zip(log.scans, odometry, strict=True):
        slam.add(scan, Odometry(scan.time, Pose.from_array(pose), Velocity()))
    slam.finish()
    off = closure_errors(slam, [closure for closure in slam.closures if closure.accepted], reference)
    assert absolute_trajectory_error(slam.trajectory.poses, reference) <= 0.30
    assert off[:, 0].max() < FALSE_DISTANCE


def test_a_closure_that_the_map_does_not_bear_out_makes_no_search_narrow(noisy: tuple[Drive, GraphSlam]) -> None:
    other = mapped(noisy[0])
    before = other._way_covariances()
    first, last = 0, len(other.pieces) - 1
    start, end = (Pose.from_array(other.nodes[other.pieces[number].origin]) for number in (first, last))
    wrong = Pose(4.0) @ end.relative_to(start)
    other.ways.append(Edge(first, last, wrong, np.diag([0.02**2, 0.02**2, 0.005**2])))
    after = other._way_covariances()
    np.testing.assert_array_equal(after[:-1], before)
    assert np.sqrt(after[-1, 0, 0]) > 1.0
    assert np.sqrt(np.median(before[:, 0, 0])) < 0.2


def test_another_day_goes_on_where_the_robot_stands() -> None:
    first, second = drive(noise=0.01, drift=0.03, spacing=0.2), drive(noise=0.01, drift=0.03, seed=4, spacing=0.2)
    slam = mapped(first)
    nodes = len(slam.nodes)
    later = [replace(scan, time=scan.time + 1000.0) for scan in second.scans]
    place = place_on_map(slam, later[0], Pose(1.0, -0.8, 0.4))
    assert place is not None
    assert place.distance_to(Pose()) < 0.05
    slam.resume(later[0], second.odometry[0], place)
    for scan, odometry in zip(later[1:], second.odometry[1:], strict=True):
        slam.add(scan, odometry)
    slam.finish()
    assert len(slam.nodes) > nodes
    joined = [closure for closure in slam.closures if closure.accepted and closure.target < nodes <= closure.node]
    assert joined, "the second day's scans close loops with the first day's"
    off = relative(slam.trajectory.poses[len(first.scans) :], second.truth)
    assert np.hypot(off[:, 0], off[:, 1]).max() < 0.06


def test_a_scan_of_elsewhere_is_placed_nowhere_and_nothing_is_not_resumed(noisy: tuple[Drive, GraphSlam]) -> None:
    driven, slam = noisy
    blind = replace(driven.scans[0], ranges=np.full(len(driven.scans[0].ranges), np.nan))
    assert place_on_map(slam, blind, Pose()) is None
    round_hall = replace(driven.scans[0], ranges=np.full(len(driven.scans[0].ranges), 9.0))
    assert place_on_map(slam, round_hall, Pose()) is None
    with pytest.raises(ValueError, match="before the first scan"):
        GraphSlam().resume(driven.scans[0], None, Pose())
