"""AMCL: tracking, global localization, and invalid measurements."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.localization.amcl import Amcl
from wherry.localization.estimation import PoseEstimate
from wherry.localization.initialization import PoseMode
from wherry.localization.parameters import PRECISE_PARAMETERS, AmclParameters
from wherry.robot import Odometry, Scan, Velocity
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry_testing.rooms import LIDAR, Building, drive, wheel_odometry

START_COVARIANCE = np.diag([0.05**2, 0.05**2, 0.03**2])  # m², m², rad²
BOXES = ((2.1, 3.0, 0.1), (4.5, 2.7, 0.1), (5.1, 1.5, 0.1), (8.1, 3.9, 0.1), (5.1, 6.3, 0.1), (2.1, 6.3, 0.1))
GRID = Building().grid()


def track(
    parameters: AmclParameters, seed: int, steps: int = 1000, grid: OccupancyGrid = GRID
) -> tuple[list[PoseEstimate], np.ndarray]:
    """Drive through the building among unmapped boxes, in the second half with one that blocks the forward 80°."""
    rng = np.random.default_rng(seed)
    truth = list(drive())[:steps]
    building = Building(circles=BOXES)
    amcl = Amcl(grid, LIDAR, parameters, np.random.default_rng(seed))
    amcl.initialize(truth[0], START_COVARIANCE)
    estimates = []
    for i, (pose, odometry) in enumerate(zip(truth, wheel_odometry(truth, rng), strict=True)):
        scan = building.scan(odometry.time, pose, rng)
        if i > steps // 2:
            scan.ranges[140:220] = 0.28
        estimates.append(amcl.update(odometry, scan))
    errors = np.array([found.pose.distance_to(pose) for found, pose in zip(estimates, truth, strict=True)])
    return estimates, errors


def test_tracking_is_precise_to_a_centimetre_without_jumps() -> None:
    for seed in range(3):
        estimates, errors = track(PRECISE_PARAMETERS, seed)
        assert math.sqrt((errors**2).mean()) < 0.02
        assert errors.max() < 0.08
        assert max(after.pose.distance_to(before.pose) for before, after in pairwise(estimates)) < 0.1


def test_matching_the_estimate_to_the_map_makes_it_more_precise() -> None:
    fine = Building().grid(0.02)  # on coarser maps the cells' size is what limits the precision
    _, plain = track(AmclParameters(refine=False, robot_radius=0.2), 0, grid=fine)
    _, refined = track(AmclParameters(robot_radius=0.2), 0, grid=fine)
    assert math.sqrt((refined**2).mean()) < 0.7 * math.sqrt((plain**2).mean())


def test_kld_sampling_needs_fewer_particles_after_convergence() -> None:
    estimates, _ = track(AmclParameters(min_particles=100), 0, 100)
    assert estimates[0].particle_count == 2000
    assert estimates[-1].particle_count < 300


def test_same_seed_gives_same_bytes() -> None:
    first, _ = track(PRECISE_PARAMETERS, 5, 200)
    second, _ = track(PRECISE_PARAMETERS, 5, 200)
    third, _ = track(PRECISE_PARAMETERS, 6, 200)
    poses = [np.array([found.pose.as_array() for found in run]).tobytes() for run in (first, second, third)]
    assert poses[0] == poses[1] != poses[2]


def test_global_localization_converges() -> None:
    truth = list(drive())[:700]
    rng = np.random.default_rng(2)
    amcl = Amcl(GRID, LIDAR, replace(PRECISE_PARAMETERS, max_particles=20_000, sigma_hit=0.2), np.random.default_rng(2))
    amcl.initialize_globally()
    for pose, odometry in zip(truth, wheel_odometry(truth, rng), strict=True):
        found = amcl.update(odometry, Building().scan(odometry.time, pose, rng))
    assert found.pose.distance_to(truth[-1]) < 0.05
    assert found.weight > 0.9


def test_random_particles_recover_a_kidnapped_robot() -> None:
    parameters = AmclParameters(recovery_alpha_slow=0.01, recovery_alpha_fast=0.3, max_particles=10_000)
    truth = list(drive())[:1200]
    rng = np.random.default_rng(4)
    amcl = Amcl(GRID, LIDAR, parameters, np.random.default_rng(4))
    amcl.initialize(truth[0], START_COVARIANCE)
    odometry = wheel_odometry(truth[:200], rng)
    for pose, wheels in zip(truth[:200], odometry, strict=True):
        amcl.update(wheels, Building().scan(wheels.time, pose, rng))
    kidnapped_at = odometry[-1].time
    for pose, wheels in zip(truth[600:], wheel_odometry(truth[600:], rng), strict=True):  # kidnapped
        moved = Odometry(
            kidnapped_at + wheels.time, odometry[-1].pose @ wheels.pose.relative_to(Pose(3.0, -2.0, 1.0)), Velocity()
        )
        found = amcl.update(moved, Building().scan(moved.time, pose, rng))
    assert found.pose.distance_to(truth[-1]) < 0.2


STILL = Odometry(0.0, Pose(), Velocity())
HERE = Pose(1.0, 1.0, 0.3)


def updated_filter() -> Amcl:
    """A filter that was updated with one scan at HERE."""
    amcl = Amcl(GRID, LIDAR, PRECISE_PARAMETERS, np.random.default_rng(0))
    amcl.initialize(HERE, START_COVARIANCE)
    first = amcl.update(STILL, Building().scan(0.0, HERE))
    assert not first.problem
    assert first.is_updated
    return amcl


def next_estimate(
    amcl: Amcl, ranges: np.ndarray | None = None, time: float = 1.0, pose: Pose = STILL.pose
) -> PoseEstimate:
    """The estimate after another scan at HERE, with other ranges, time, s, or odometry if they are given."""
    scan = Building().scan(time, HERE)
    return amcl.update(Odometry(time, pose, Velocity()), scan if ranges is None else replace(scan, ranges=ranges))


@pytest.mark.parametrize("reading", [math.nan, math.inf, -math.inf, -1.0, 0.0, 1e300])
def test_scan_without_valid_readings_changes_nothing(reading: float) -> None:
    found = next_estimate(updated_filter(), np.full(360, reading))
    assert found.problem == "the scan has no readings"
    assert found.pose.distance_to(HERE) < 0.03


def test_empty_scan_changes_nothing() -> None:
    assert next_estimate(updated_filter(), np.empty(0)).problem == "the scan has no readings"


def test_some_invalid_readings_are_ignored() -> None:
    ranges = Building().scan(1.0, HERE).ranges.copy()
    ranges[::3], ranges[1::7] = math.nan, -5.0
    found = next_estimate(updated_filter(), ranges)
    assert not found.problem
    assert found.pose.distance_to(HERE) < 0.03


def test_odometry_that_is_not_finite_is_rejected() -> None:
    amcl = updated_filter()
    assert next_estimate(amcl, pose=Pose(math.nan, 0.0, 0.0)).problem == "the odometry is not finite"
    assert next_estimate(amcl).problem == ""


def test_scan_before_the_last_one_is_rejected() -> None:
    amcl = updated_filter()
    next_estimate(amcl, time=5.0)
    assert next_estimate(amcl, time=4.0).problem == "time runs backwards"
    assert next_estimate(amcl, time=5.0).problem == ""


def test_odometry_jump_is_not_a_motion() -> None:
    amcl = updated_filter()
    found = next_estimate(amcl, pose=Pose(100.0, 3.0, 2.0))
    assert "jumped by 100" in found.problem
    assert found.pose.distance_to(HERE) < 0.03
    after = next_estimate(amcl, time=2.0, pose=Pose(100.0, 3.0, 2.0))
    assert not after.problem
    assert after.pose.distance_to(HERE) < 0.03


def test_filter_is_updated_after_motion_or_on_request() -> None:
    amcl = updated_filter()
    assert not next_estimate(amcl).is_updated
    amcl.request_update()
    assert next_estimate(amcl, time=2.0).is_updated
    assert not next_estimate(amcl, time=3.0).is_updated


@pytest.mark.parametrize("probability", [0.5, 0.0, 1.0])
def test_maps_without_structure_never_give_nan(probability: float) -> None:
    grid = OccupancyGrid(np.full((40, 40), probability, np.float32), 0.05)
    amcl = Amcl(grid, LIDAR, replace(PRECISE_PARAMETERS, update_min_d=0.0), np.random.default_rng(0))
    for i, pose in enumerate(list(drive())[:30]):
        found = amcl.update(Odometry(i / 10, pose, Velocity()), Building().scan(i / 10, pose))
        assert np.isfinite(found.pose.as_array()).all()
        assert np.isfinite(found.covariance).all()
    assert amcl.weights.sum() == pytest.approx(1.0)


def test_start_outside_the_map_is_kept() -> None:
    amcl = updated_filter()
    amcl.initialize(Pose(500.0, -500.0, 0.0), START_COVARIANCE)
    found = next_estimate(amcl)
    assert found.pose.distance_to(Pose(500.0, -500.0)) < 1.0


def test_invalid_initial_distributions_are_rejected() -> None:
    amcl = updated_filter()
    with pytest.raises(InputError, match="not finite"):
        amcl.initialize(Pose(math.nan), START_COVARIANCE)
    with pytest.raises(InputError, match="not a covariance"):
        amcl.initialize(Pose(), -START_COVARIANCE)
    nowhere = OccupancyGrid(np.full((10, 10), 0.5, np.float32), 0.05)
    with pytest.raises(InputError, match="no free space"):
        Amcl(nowhere, LIDAR, PRECISE_PARAMETERS, np.random.default_rng(0)).initialize_globally()


def test_modes_share_the_particles_by_weight() -> None:
    amcl = updated_filter()
    there = Pose(7.5, 3.3, 0.0)
    amcl.initialize_modes(
        [PoseMode(HERE, START_COVARIANCE, 3.0), PoseMode(there, START_COVARIANCE, 1.0)], prior_weight=0.2
    )
    near_there = np.hypot(*(amcl.particles[:, :2] - (there.x, there.y)).T) < 1.0
    assert near_there.mean() == pytest.approx(0.2, abs=0.05)  # a quarter of what the prior leaves
    assert len(amcl.particles) == PRECISE_PARAMETERS.max_particles


def test_tracking_with_a_lidar_mounted_sideways() -> None:
    mounted = Pose(0.1, 0.05, math.pi / 2)
    truth = list(drive())[:300]
    rng = np.random.default_rng(0)
    amcl = Amcl(GRID, mounted, PRECISE_PARAMETERS, np.random.default_rng(0))
    amcl.initialize(truth[0], START_COVARIANCE)
    for pose, odometry in zip(truth, wheel_odometry(truth, rng), strict=True):
        seen = Building().ranges(pose @ mounted, np.linspace(-2.0, 2.0, 181), 12.0)
        scan = Scan(odometry.time, seen, -2.0, 4.0 / 180, 0.05, 12.0)
        found = amcl.update(odometry, scan)
    assert found.pose.distance_to(truth[-1]) < 0.05
