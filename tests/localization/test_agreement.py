"""Agreement distinguishes unmapped objects from a wrong pose."""

from __future__ import annotations

import numpy as np
import pytest

from wherry.localization.agreement import scan_agreement
from wherry.space.distance_field import DistanceField
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry_testing.rooms import LIDAR, Building

FIELD = DistanceField.of(Building().grid(), 2.0)
KNOWN = ~Building().grid().unknown
ALL = np.ones((100, 100), np.bool_)


def room(walls: list[int], origin: Pose = Pose()) -> DistanceField:  # noqa: B008
    """Free space of 10 × 10 m with walls along x, in columns of 0.1 m."""
    probability = np.full((100, 100), 0.1, np.float32)
    probability[:, walls] = 0.9
    return DistanceField.of(OccupancyGrid(probability, 0.1, origin), 2.0)


@pytest.mark.parametrize("origin", [Pose(), Pose(3.0, 1.0, -2.0)])
def test_every_beam_has_one_class(origin: Pose) -> None:
    field = room([80], origin)
    ends = np.array([[3.05, 0.0], [1.5, 0.0], [5.0, 0.1], [-2.0, 0.0]])  # on the wall, before it, behind it, elsewhere
    found = scan_agreement(field, ALL, ends, Pose(), origin @ Pose(5.0, 5.0, 0.0))
    assert (found.inlier_fraction, found.blocked_fraction, found.passed_fraction) == (0.25, 0.5, 0.25)
    assert found.beam_count == 4


def test_beams_that_end_in_unknown_space_are_counted_separately() -> None:
    known = ALL.copy()
    known[:, :40] = False
    ends = np.array([[-2.0, 0.0], [-0.5, 0.0], [-9.0, 0.0], [3.05, 0.0]])  # unknown, free, off the map, on the wall
    found = scan_agreement(room([80]), known, ends, Pose(), Pose(5.0, 5.0, 0.0))
    assert (found.inlier_fraction, found.blocked_fraction, found.passed_fraction, found.unknown_fraction) == (
        0.25,
        0.25,
        0.0,
        0.5,
    )


def test_beam_along_a_wall_has_not_passed_through_it() -> None:
    field = room([80, 81, 82])
    found = scan_agreement(field, ALL, np.array([[0.35, 3.5]]), Pose(), Pose(7.85, 1.0, 0.0))
    assert found.inlier_fraction == 1.0


def test_fractions_of_a_perfect_and_of_a_blocked_scan() -> None:
    truth = Pose(4.5, 2.0, 0.4)
    scan = Building().scan(0.0, truth)
    perfect = scan_agreement(FIELD, KNOWN, LIDAR.transform(scan.points()), LIDAR, truth)
    assert perfect.inlier_fraction > 0.97
    assert perfect.passed_fraction < 0.03  # beams that graze the corners of doorways
    assert perfect.log_likelihood > -0.2
    scan.ranges[140:220] = 0.35
    blocked = scan_agreement(FIELD, KNOWN, LIDAR.transform(scan.points()), LIDAR, truth)
    assert blocked.blocked_fraction == pytest.approx(80 / 360, abs=0.02)
    assert blocked.passed_fraction < 0.03


def test_wrong_pose_sends_beams_through_walls() -> None:
    ends = LIDAR.transform(Building().scan(0.0, Pose(4.5, 2.0, 0.4)).points())
    wrong = scan_agreement(FIELD, KNOWN, ends, LIDAR, Pose(2.5, 1.0, 0.4))
    assert wrong.passed_fraction > 0.2
    assert wrong.log_likelihood < -1.0


def test_empty_scan_has_no_beams() -> None:
    assert scan_agreement(FIELD, KNOWN, np.empty((0, 2)), LIDAR, Pose()).beam_count == 0
