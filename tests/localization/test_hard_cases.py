"""Localization with wheel slip, with an incomplete map, and between indistinguishable rooms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wherry.localization.localizer import Localization, Localizer
from wherry.localization.parameters import PRECISE_PARAMETERS
from wherry.robot import Odometry
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry_testing.rooms import LIDAR, WALL_THICKNESS, Building, drive, wheel_odometry

START_COVARIANCE = np.diag([0.05**2, 0.05**2, 0.03**2])  # m², m², rad²


def follow(building: Building, localizer: Localizer, truth: list[Pose], odometry: list[Odometry]) -> list[Localization]:
    rng = np.random.default_rng(0)
    return [localizer.update(now, building.scan(now.time, at, rng)) for at, now in zip(truth, odometry, strict=True)]


def test_wheel_slip_is_corrected() -> None:
    truth = list(drive())[:150]
    wheels = wheel_odometry(truth, np.random.default_rng(0))
    before = wheels[60].pose
    shifted = before @ Pose(0.12, 0.0, 0.15) @ before.inverse  # wheel slip of 12 cm and 9°
    wheels[60:] = [replace(now, pose=shifted @ now.pose) for now in wheels[60:]]
    building = Building()
    localizer = Localizer(building.grid(), LIDAR, PRECISE_PARAMETERS, np.random.default_rng(0))
    localizer.initialize(truth[0], START_COVARIANCE)
    found = follow(building, localizer, truth, wheels)
    errors = [one.pose.distance_to(at) for one, at in zip(found, truth, strict=True)]
    assert max(errors[:60]) < 0.05
    assert max(errors) < 0.35
    assert max(errors[90:]) < 0.05  # three seconds later


@pytest.mark.parametrize("at", [40, 180])
def test_two_seconds_of_wheel_slip_are_corrected_while_it_lasts(at: int) -> None:
    path = list(drive())[:250]
    truth = path[:at] + [path[at]] * 20 + path[at:]
    driven = wheel_odometry(path, np.random.default_rng(0))
    before = driven[at].pose
    slipping = [Odometry((at + i) / 10, before @ Pose(0.03 * (i + 1)), driven[at].velocity) for i in range(20)]  # 60 cm
    shifted = slipping[-1].pose @ before.inverse
    resumed = [replace(now, time=now.time + 2.0, pose=shifted @ now.pose) for now in driven[at:]]
    building = Building()
    localizer = Localizer(building.grid(), LIDAR, PRECISE_PARAMETERS, np.random.default_rng(0))
    localizer.initialize(truth[0], START_COVARIANCE)
    found = follow(building, localizer, truth, driven[:at] + slipping + resumed)
    errors = [one.pose.distance_to(pose) for one, pose in zip(found, truth, strict=True)]
    assert max(errors) < 0.3
    assert max(errors[at + 20 :]) < 0.08


def test_robot_is_not_lost_beyond_the_border_of_the_map() -> None:
    building = Building()
    whole = building.grid()
    probability = whole.probability.copy()
    probability[:, 5 * probability.shape[1] // 8 :] = 0.5  # the east was never mapped
    truth = list(drive())[:300]
    assert max(at.x for at in truth) > 6.5
    localizer = Localizer(replace(whole, probability=probability), LIDAR, PRECISE_PARAMETERS, np.random.default_rng(0))
    localizer.initialize(truth[0], START_COVARIANCE)
    found = follow(building, localizer, truth, wheel_odometry(truth, np.random.default_rng(0)))
    assert all(np.isfinite(one.pose.as_array()).all() for one in found)
    assert max(one.pose.distance_to(at) for one, at in zip(found, truth, strict=True)) < 0.5
    assert max(one.lost_probability for one in found) < 0.5


def two_rooms() -> tuple[Building, OccupancyGrid]:
    """Two rooms that are identical from the inside."""
    half = WALL_THICKNESS / 2
    walls = [(x - half, 0.0, x + half, 4.0) for x in (0.0, 4.0, 4.8, 8.8)]
    walls += [(x, y - half, x + 4.0, y + half) for x in (0.0, 4.8) for y in (0.0, 4.0)]
    walls += [(x, 1.0, x + 0.5, 1.3) for x in (0.6, 5.4)]
    building = Building(rectangles=np.array(walls))
    return building, building.grid()


def test_indistinguishable_rooms_keep_the_lost_probability_high() -> None:
    building, grid = two_rooms()
    truth = list(drive(((2.5, 2.5), (3.3, 2.5), (2.0, 3.2), (2.5, 2.5))))
    localizer = Localizer(grid, LIDAR, PRECISE_PARAMETERS, np.random.default_rng(0))
    localizer.initialize_globally()
    found = follow(building, localizer, truth, wheel_odometry(truth, np.random.default_rng(0)))
    assert len(found[0].hypotheses) >= 2
    assert all(one.lost_probability > 0.2 for one in found)  # the scans fit both rooms equally
    last, beside = found[-1].pose, Pose(truth[-1].x + 4.8, truth[-1].y)
    assert min(last.distance_to(truth[-1]), last.distance_to(beside)) < 0.1
