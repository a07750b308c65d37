"""Scans: beam directions, mounts upside down, and correction for the robot's motion during a scan."""

import math

import numpy as np
import pytest

from wherry.robot import Scan, mark_no_return
from wherry.space.pose import Pose

LIDAR = Pose(0.2, -0.1, 0.3)
MOTION = Pose(0.1, 0.02, 0.2)


def scan_of_points(points: np.ndarray, time_increment: float, motion: Pose) -> Scan:
    """A scan whose beam i measures point i, [R, 2] m in the first base_link frame, while the robot moves steadily."""
    share = np.linspace(0.0, 1.0, len(points))
    share = share if time_increment > 0.0 else share[::-1]
    seen = []
    for fraction, point in zip(share, points, strict=True):
        base = Pose(fraction * motion.x, fraction * motion.y, fraction * motion.theta)
        seen.append((base @ LIDAR).inverse.transform(point[None])[0])
    x, y = np.array(seen).T
    return Scan(5.0, np.hypot(x, y), 0.0, 0.01, 0.1, 30.0, time_increment, np.arctan2(y, x))


@pytest.mark.parametrize("time_increment", [1e-3, -1e-3])
def test_deskewed_scan_shows_the_points_where_they_are(time_increment):
    points = np.column_stack([np.linspace(2.0, 4.0, 50), np.linspace(-3.0, 3.0, 50)])
    corrected = scan_of_points(points, time_increment, MOTION).deskewed(LIDAR, MOTION)
    assert np.allclose(LIDAR.transform(corrected.points()), points, atol=1e-12)
    assert corrected.time == 5.0
    assert corrected.time_increment == 0.0


def test_scan_without_beam_times_is_not_corrected():
    scan = Scan(0.0, np.ones(4), -1.0, 0.5, 0.1, 10.0)
    assert scan.deskewed(LIDAR, MOTION) is scan


def test_beams_without_a_valid_range_keep_it_and_only_turn():
    scan = Scan(0.0, np.array([np.inf, 0.0, np.nan]), 0.0, 0.1, 0.1, 10.0, time_increment=0.01)
    corrected = scan.deskewed(Pose(), Pose(1.0, 0.0, 0.2))
    assert np.array_equal(corrected.ranges, scan.ranges, equal_nan=True)
    assert corrected.angles == pytest.approx([0.0, 0.2, 0.4])


def test_mirrored_scan_negates_every_direction_and_stays_counter_clockwise():
    scan = Scan(0.0, np.array([1.0, 2.0, 3.0]), -0.5, 0.4, 0.1, 10.0, time_increment=0.01)
    mirrored = scan.mirrored()
    assert mirrored.angles == pytest.approx(-scan.angles[::-1])
    assert mirrored.points() == pytest.approx((scan.points() * (1.0, -1.0))[::-1])
    assert mirrored.time_increment == -0.01
    assert mirrored.duration == pytest.approx(0.02)
    assert mirrored.mirrored().angles == pytest.approx(scan.angles)


def test_given_beam_angles_replace_the_even_ones():
    angles = np.array([0.0, 0.3, math.pi])
    scan = Scan(0.0, np.array([1.0, 2.0, 3.0]), 0.0, 0.1, 0.1, 10.0, beam_angles=angles)
    assert scan.angles is angles
    assert scan.points()[2] == pytest.approx([-3.0, 0.0])


def test_beam_times_begin_with_the_beam_that_was_measured_first():
    scan = Scan(5.0, np.ones(4), 0.0, 0.1, 0.1, 10.0, time_increment=0.01)
    assert scan.beam_times == pytest.approx([0.0, 0.01, 0.02, 0.03])
    assert scan.mirrored().beam_times == pytest.approx([0.03, 0.02, 0.01, 0.0])


def test_readings_less_than_a_tolerance_below_the_longest_range_are_no_return():
    ranges = np.array([[1.0, 7.985], [7.9999, 9.0]])
    assert mark_no_return(ranges, 8.0).tolist() == [[1.0, 7.985], [math.inf, math.inf]]
