"""Faults: a kidnapped robot, slipping wheels and a blinded lidar."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from wherry.robot import Odometry, Scan
from wherry.simulation import build
from wherry.simulation.faults import blind_lidar, kidnap, random_pose, slippery_wheels
from wherry.simulation.static_geometry import clearance
from wherry.space.pose import Pose
from wherry_testing.halls import CELL, box_in_base, drive, drive_to_x, hall, noise_free, stop


def _odometry(measurements: list[Scan | Odometry]) -> Odometry:
    return [measurement for measurement in measurements if isinstance(measurement, Odometry)][-1]


def test_a_kidnapped_robot_moves_without_odometry() -> None:
    simulation = noise_free(hall())
    before = _odometry(drive(simulation, 0.0, 0.0, 0.2))
    kidnap(simulation, Pose(1.0, 1.5, 2.0))
    after = _odometry(drive(simulation, 0.0, 0.0, 0.5))
    assert_allclose(simulation.referee.pose.as_array(), [1.0, 1.5, 2.0], atol=0.002)
    assert after.pose.distance_to(before.pose) < 0.001
    drive(simulation, 0.3, 0.0, 1.0)
    assert simulation.referee.pose.relative_to(Pose(1.0, 1.5, 2.0)).x > 0.2
    assert simulation.referee.collisions == []


def test_the_load_is_kidnapped_with_the_robot() -> None:
    simulation = noise_free(hall())
    drive_to_x(simulation, 4.5 * CELL)
    simulation.robot.close_latch()
    drive(simulation, -0.2, 0.0, 0.5)
    held = box_in_base(simulation, 0)
    kidnap(simulation, Pose(1.0, 1.5, -1.0))
    drive(simulation, -0.2, 0.0, 1.0)
    assert_allclose(box_in_base(simulation, 0), held, atol=0.002)


@pytest.mark.parametrize("pose", [Pose(0.1, 1.0), Pose(-3.0, 1.0), Pose(4.5 * CELL, 2.5 * CELL), Pose(4.5, 2.1)])
def test_kidnapping_into_a_collision_is_rejected(pose: Pose) -> None:
    simulation = noise_free(hall())
    with pytest.raises(ValueError, match="would collide at"):
        kidnap(simulation, pose)


def test_random_poses_are_free_and_spread_over_the_plan() -> None:
    simulation = build(hall(), np.random.default_rng(0))
    poses = [random_pose(simulation, np.random.default_rng(seed)) for seed in range(100)]
    points = np.array([pose.as_array()[:2] for pose in poses])
    assert clearance(simulation.geometry, points).min() > 0.2
    for box in simulation.referee.boxes:
        assert np.hypot(*(points - box.position).T).min() > 0.3
    assert np.ptp(points[:, 0]) > 6 * CELL
    assert np.ptp([pose.theta for pose in poses]) > 1.8 * math.pi


def test_slippery_wheels_make_odometry_wrong() -> None:
    def odometry_error(*, is_slippery: bool) -> float:
        simulation = noise_free(hall(o=" "))
        measurements = drive(simulation, 0.0, 0.0, 0.1)
        start = simulation.referee.pose
        if is_slippery:
            with slippery_wheels(simulation):
                measurements += drive(simulation, 0.5, 0.0, 1.0)
        else:
            measurements += drive(simulation, 0.5, 0.0, 1.0)
        drive(simulation, 0.5, 0.0, 0.5)
        last = _odometry(drive(simulation, 0.0, 0.0, 1.0))
        return last.pose.distance_to(simulation.referee.pose.relative_to(start))

    assert odometry_error(is_slippery=True) > 0.1
    assert odometry_error(is_slippery=False) < 0.01


def test_a_blind_lidar_returns_nan_and_recovers() -> None:
    simulation = noise_free(hall())
    with blind_lidar(simulation):
        scans = [measurement for measurement in drive(simulation, 0.0, 0.0, 0.5) if isinstance(measurement, Scan)]
        assert all(np.isnan(scan.ranges).all() and not scan.valid.any() for scan in scans[1:])
    stop(simulation)
    measurements = drive(simulation, 0.0, 0.0, 0.2)
    assert [measurement for measurement in measurements if isinstance(measurement, Scan)][-1].valid.all()
