"""Global relocalization with one scan: unique and ambiguous poses."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wherry.localization.relocalization import Relocalizer
from wherry.robot import Scan
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose, wrap
from wherry_testing.rooms import LIDAR, WALL_THICKNESS, Building, drive

RELOCALIZER = Relocalizer(Building().grid(), LIDAR)


def test_unambiguous_poses_are_correct() -> None:
    rng = np.random.default_rng(0)
    building = Building(circles=((4.5, 2.7, 0.1), (5.1, 6.3, 0.1), (2.1, 6.3, 0.1)))
    poses = list(drive())[::60]
    found = [RELOCALIZER.search(building.scan(0.0, pose, rng)) for pose in poses]
    errors = [best.hypotheses[0].pose.distance_to(pose) for best, pose in zip(found, poses, strict=True)]
    is_certain = [not best.is_ambiguous for best in found]
    assert sum(is_certain) > 0.9 * len(poses)
    assert all(error < 0.05 for error, certain in zip(errors, is_certain, strict=True) if certain)


def test_the_pose_on_a_rotated_map_is_found() -> None:
    origin = Pose(-1.0, 2.0, -0.6)
    truth = Pose(4.5, 2.0, 2.5)
    found = Relocalizer(Building().grid(origin=origin), LIDAR).search(Building().scan(0.0, truth))
    assert found.hypotheses[0].pose.distance_to(truth) < 0.05
    assert abs(wrap(found.hypotheses[0].pose.theta - truth.theta)) < 0.02


def test_two_equal_rooms_are_two_hypotheses() -> None:
    half = WALL_THICKNESS / 2
    walls = [(x - half, 0.0, x + half, 4.0) for x in (0.0, 4.0, 4.8, 8.8)]
    walls += [(x, y - half, x + 4.0, y + half) for x in (0.0, 4.8) for y in (0.0, 4.0)]
    walls += [(x, 1.0, x + 0.5, 1.3) for x in (0.6, 5.4)]  # breaks the symmetry of the rooms
    building = Building(rectangles=np.array(walls))
    truth = Pose(2.5, 2.5, 0.8)
    found = Relocalizer(building.grid(), LIDAR).search(building.scan(0.0, truth))
    assert found.is_ambiguous
    assert found.ambiguity == pytest.approx(0.5, abs=0.2)
    assert sum(hypothesis.probability for hypothesis in found.hypotheses[:2]) > 0.95
    assert sorted(round(hypothesis.pose.x, 1) for hypothesis in found.hypotheses[:2]) == [2.5, 7.3]


def test_probabilities_are_sorted_and_sum_to_one() -> None:
    found = RELOCALIZER.search(Building().scan(0.0, Pose(0.9, 3.6, 1.0)))
    probabilities = [hypothesis.probability for hypothesis in found.hypotheses]
    assert probabilities == sorted(probabilities, reverse=True)
    assert sum(probabilities) == pytest.approx(1.0)


def test_a_scan_without_readings_has_no_hypotheses() -> None:
    scan = Scan(0.0, np.full(360, math.nan), -math.pi, math.tau / 360, 0.05, 12.0)
    found = RELOCALIZER.search(scan)
    assert found.hypotheses == ()
    assert found.is_ambiguous


def test_a_map_without_free_space_has_no_hypotheses() -> None:
    nowhere = OccupancyGrid(np.full((50, 50), 0.5, np.float32), 0.05)
    assert Relocalizer(nowhere, LIDAR).search(Building().scan(0.0, Pose(1.0, 1.0))).hypotheses == ()


def test_an_earlier_scan_confirms_a_hypothesis_despite_odometry_errors() -> None:
    earlier, now = Pose(2.7, 0.9, 0.5), Pose(4.5, 2.1, 0.8)
    building = Building()
    (found,) = RELOCALIZER.search(building.scan(1.0, now)).hypotheses[:1]
    assert found.pose.distance_to(now) < 0.05
    true = earlier.relative_to(now)
    reported = Pose(1.1 * true.x, 1.1 * true.y, true.theta + 0.15)
    ends = LIDAR.transform(building.scan(0.0, earlier).points())
    (confirmed,) = RELOCALIZER.confirm([found], [(reported, ends)])
    assert confirmed.agreement.inlier_fraction > 0.95
