"""The localizer starts globally, detects kidnappings, relocalizes itself, and raises no false alarm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wherry.localization.localizer import Localization, Localizer
from wherry.localization.parameters import PRECISE_PARAMETERS
from wherry.robot import Odometry
from wherry.space.pose import Pose
from wherry_testing.rooms import LIDAR, Building, drive, wheel_odometry

GRID = Building().grid()
BUILDING = Building(circles=((2.1, 3.0, 0.1), (4.5, 2.7, 0.1), (8.1, 3.9, 0.1), (5.1, 6.3, 0.1), (2.1, 6.3, 0.1)))
START_COVARIANCE = np.diag([0.05**2, 0.05**2, 0.03**2])  # m², m², rad²


def follow(localizer: Localizer, truth: list[Pose], odometry: list[Odometry], seed: int = 0) -> list[Localization]:
    rng = np.random.default_rng(seed)
    pairs = zip(truth, odometry, strict=True)
    return [localizer.update(now, BUILDING.scan(now.time, pose, rng)) for pose, now in pairs]


def test_undisturbed_robot_is_never_lost() -> None:
    truth = list(drive())
    localizer = Localizer(GRID, LIDAR, PRECISE_PARAMETERS, np.random.default_rng(0))
    localizer.initialize(truth[0], START_COVARIANCE)
    found = follow(localizer, truth, wheel_odometry(truth, np.random.default_rng(0)))
    assert max(one.lost_probability for one in found) < 0.5
    assert not any(one.hypotheses for one in found)
    assert all(one.pose.distance_to(pose) < 0.1 for one, pose in zip(found, truth, strict=True))


def test_global_start_converges() -> None:
    truth = list(drive())[300:500]
    localizer = Localizer(GRID, LIDAR, PRECISE_PARAMETERS, np.random.default_rng(0))
    localizer.initialize_globally()
    found = follow(localizer, truth, wheel_odometry(truth, np.random.default_rng(0)))
    assert found[0].hypotheses
    assert found[-1].pose.distance_to(truth[-1]) < 0.05
    assert found[-1].lost_probability < 0.05


def test_kidnapping_is_detected_and_recovered() -> None:
    path = list(drive())
    truth = path[:100] + path[600:700]  # carried to another room after 10 s
    wheels = wheel_odometry(path[:100], np.random.default_rng(0))
    resumed = wheel_odometry(path[600:700], np.random.default_rng(1))
    shift = wheels[-1].pose @ resumed[0].pose.inverse
    wheels += [replace(now, time=10.0 + now.time, pose=shift @ now.pose) for now in resumed]
    localizer = Localizer(GRID, LIDAR, PRECISE_PARAMETERS, np.random.default_rng(0))
    localizer.initialize(truth[0], START_COVARIANCE)
    found = follow(localizer, truth, wheels)
    assert max(one.lost_probability for one in found[:100]) < 0.1
    assert max(one.lost_probability for one in found[100:120]) > 0.9
    assert found[-1].pose.distance_to(truth[-1]) < 0.05
    assert found[-1].lost_probability < 0.05


def test_same_seed_gives_same_bytes() -> None:
    truth = list(drive())[300:400]
    runs = []
    for _ in range(2):
        localizer = Localizer(GRID, LIDAR, PRECISE_PARAMETERS, np.random.default_rng(7))
        localizer.initialize_globally()
        found = follow(localizer, truth, wheel_odometry(truth, np.random.default_rng(0)))
        runs.append(np.array([[*one.pose.as_array(), one.lost_probability] for one in found]).tobytes())
    assert runs[0] == runs[1]
