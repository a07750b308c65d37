"""Correction of scans for the robot's motion during a sweep."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wherry.logs.assembly import RecordedOdometry, RecordedScan, assemble_log
from wherry.logs.options import ReadingOptions
from wherry.robot import Scan
from wherry.space.pose import Pose
from wherry_testing.analytic_rooms import rectangle_ranges

WIDTH, HEIGHT = 8.0, 6.0  # m, the room
BEAMS = 360
PERIOD = 0.1  # s, of a sweep and from scan to scan
LIDAR = Pose(0.2, -0.1, math.pi)
SPEED, TURN_RATE = 0.6, 1.5  # m/s, rad/s


def pose_at(time: float) -> Pose:
    """base_link at a time, s, on an arc."""
    angle = TURN_RATE * time
    radius = SPEED / TURN_RATE
    return Pose(radius * math.sin(angle), radius * (1.0 - math.cos(angle)), angle)


def rolling_scan(time: float, *, is_clockwise: bool) -> Scan:
    """A scan whose beams are measured one after another while the robot drives."""
    angles = -math.pi + np.arange(BEAMS) * math.tau / BEAMS
    order = np.arange(BEAMS)[::-1] if is_clockwise else np.arange(BEAMS)
    increment = PERIOD / BEAMS
    ranges = [
        rectangle_ranges(pose_at(time + number * increment) @ LIDAR, angles[beam : beam + 1], WIDTH, HEIGHT)[0]
        for beam, number in enumerate(order.tolist())
    ]
    sign = -1.0 if is_clockwise else 1.0
    return Scan(time, np.array(ranges), -math.pi, math.tau / BEAMS, 0.1, 30.0, sign * increment)


def wall_errors(points: np.ndarray) -> np.ndarray:
    """Distances of points, [N, 2] m, from the nearest wall of the room, m."""
    distances: np.ndarray = np.abs(np.abs(points) - (WIDTH / 2.0, HEIGHT / 2.0)).min(axis=1)
    return distances


@pytest.mark.parametrize("is_clockwise", [False, True])
@pytest.mark.parametrize("period", [0.01, 0.05, 0.1, 0.13])
def test_walls_seen_while_turning_are_exact(period: float, is_clockwise: bool) -> None:
    scans = [RecordedScan(str(n), rolling_scan(n * PERIOD, is_clockwise=is_clockwise)) for n in range(20)]
    times = np.arange(-0.013, 2.1, period).tolist()
    odometry = [RecordedOdometry(str(n), time, pose_at(time)) for n, time in enumerate(times)]
    log = assemble_log("log", scans, odometry, LIDAR, ReadingOptions())
    raw, corrected = [], []
    for index, reading in enumerate(log.scan_odometry):
        assert reading is not None
        lidar = reading.pose @ LIDAR
        raw.append(wall_errors(lidar.transform(log.scans[index].points())).max())
        corrected.append(wall_errors(lidar.transform(log.deskewed(index).points())).max())
    assert max(corrected) < 1e-3
    assert min(raw) > 0.05


def test_scans_without_odometry_or_beam_times_stay_as_they_are() -> None:
    scans = [RecordedScan(str(n), rolling_scan(n * PERIOD, is_clockwise=False)) for n in range(3)]
    log = assemble_log("log", scans, [], LIDAR, ReadingOptions())
    assert log.deskewed(1) is log.scans[1]
