"""Agreement tells an unmapped thing from a wrong pose."""

from __future__ import annotations

import numpy as np
import pytest

from wherry.localization.agreement import compare
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
def test_each_beam_is_of_one_kind(origin: Pose) -> None:
    field = room([80], origin)
    ends = np.array([[3.05, 0.0], [1.5, 0.0], [5.0, 0.1], [-2.0, 0.0]])  # on the wall, before it, behind it, elsewhere
    found = compare(field, ALL, ends, Pose(), origin @ Pose(5.0, 5.0, 0.0))
    assert (found.explained, found.blocked, found.passed) == (0.25, 0.5, 0.25)
    assert found.beams == 4


def test_beams_that_end_where_the_map_knows_nothing_are_told_apart() -> None:
    charted = ALL.copy()
    charted[:, :40] = False
    ends = np.array([[-2.0, 0.0], [-0.5, 0.0], [-9.0, 0.0], [3.05, 0.0]])  # unknown, free, off the map, on the wall
    found = compare(room([80]), charted, ends, Pose(), Pose(5.0, 5.0, 0.0))
    assert (found.explained, found.blocked, found.passed, found.uncharted) == (0.25, 0.25, 0.0, 0.5)


def test_a_beam_along_a_wall_has_not_passed_through_it() -> None:
    field = room([80, 81, 82])
    found = compare(field, ALL, np.array([[0.35, 3.5]]), Pose(), Pose(7.85, 1.0, 0.0))
    assert found.explained == 1.0


def test_a_perfect_scan_and_a_blocked_one() -> None:
    truth = Pose(4.5, 2.0, 0.4)
    scan = Building().scan(0.0, truth)
    perfect = compare(FIELD, KNOWN, LIDAR.transform(scan.points()), LIDAR, truth)
    assert perfect.explained > 0.97
    assert perfect.passed < 0.03  # beams that graze the corners of doorways
    assert perfect.log_likelihood > -0.2
    scan.ranges[140:220] = 0.35
    blocked = compare(FIELD, KNOWN, LIDAR.transform(scan.points()), LIDAR, truth)
    assert blocked.blocked == pytest.approx(80 / 360, abs=0.02)
    assert blocked.passed < 0.03


def test_a_wrong_pose_sends_beams_through_walls() -> None:
    ends = LIDAR.transform(Building().scan(0.0, Pose(4.5, 2.0, 0.4)).points())
    wrong = compare(FIELD, KNOWN, ends, LIDAR, Pose(2.5, 1.0, 0.4))
    assert wrong.passed > 0.2
    assert wrong.log_likelihood < -1.0


def test_no_beams_agree_with_everything() -> None:
    assert compare(FIELD, KNOWN, np.empty((0, 2)), LIDAR, Pose()).beams == 0
