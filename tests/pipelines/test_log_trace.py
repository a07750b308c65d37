"""Trace records of a log that is mapped or localized."""

from __future__ import annotations

import numpy as np

from wherry.logs.lidar_log import LidarLog
from wherry.mapping.loop_closure import LoopClosure
from wherry.mapping.rejections import Rejection
from wherry.pipelines.logs.trace import LogTrace
from wherry.robot import Odometry, Scan, Velocity
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry.space.trajectory import Trajectory
from wherry.trace.records import (
    MapUpdate,
    Narration,
    Phase,
    Record,
    RobotSnapshot,
    RunStarted,
)

LIDAR = Pose(0.1, 0.0, 0.0)


def log() -> LidarLog:
    """Two scans of one beam straight ahead, 2 m, one and a half seconds apart."""
    scans = tuple(Scan(time, np.array([2.0]), 0.0, 0.1, 0.1, 10.0) for time in (1000.0, 1001.5))
    odometry = tuple(Odometry(scan.time, Pose(), Velocity()) for scan in scans)
    return LidarLog(scans, odometry, Trajectory(np.array([1000.0]), np.zeros((1, 3))), LIDAR, ())


def test_times_count_from_the_first_scan_and_points_are_in_the_map_frame() -> None:
    records: list[Record] = []
    trace = LogTrace(Phase.LOCALIZE, "walk.log", log(), records.append)
    grid = OccupancyGrid(np.full((2, 2), 0.5, np.float32), 0.1)
    trace.map(grid)
    trace.scan(1, Pose(1.0, 2.0, np.pi / 2), np.array([[1.0, 2.0, 0.5]]))
    assert [type(record) for record in records] == [RunStarted, Narration, MapUpdate, RobotSnapshot]
    seen = records[-1]
    assert isinstance(seen, RobotSnapshot)
    assert seen.time == 1.5
    np.testing.assert_allclose(seen.points, [[1.0, 4.1]], atol=1e-6)
    np.testing.assert_allclose(seen.particles, [[1.0, 2.0, 0.5]])
    assert isinstance(records[2], MapUpdate)
    assert records[2].grid is grid


def test_getting_lost_and_localized_again_is_narrated_once_each() -> None:
    records: list[Record] = []
    trace = LogTrace(Phase.LOCALIZE, "walk.log", log(), records.append)
    for probability in (0.1, 0.6, 0.9, 0.2, 0.1):
        trace.lost_probability(1, probability)
    assert [record.text for record in records[2:] if isinstance(record, Narration)] == [
        "I am lost.",
        "I am localized again.",
    ]


def test_loop_closures_are_narrated_when_their_number_changes() -> None:
    records: list[Record] = []
    trace = LogTrace(Phase.MAP, "walk.log", log(), records.append)
    candidates = [closure(None), closure(Rejection.LOW_SCORE), closure(None)]
    for count in (0, 2, 2, 3):
        trace.loop_closures(1, candidates[:count])
    assert [record.text for record in records[2:] if isinstance(record, Narration)] == [
        "Loop closures so far: 1 accepted, 1 rejected.",
        "Loop closures so far: 2 accepted, 1 rejected.",
    ]


def closure(rejection: Rejection | None) -> LoopClosure:
    """A candidate loop closure, rejected for a reason unless that is empty."""
    return LoopClosure(1000.0, 1, 0, Pose(), np.eye(3), 0.5, 0.0, 1.0, rejection)


def test_points_are_corrected_for_the_motion_during_the_scan() -> None:
    """The second beam is measured half a second later, half a metre further on."""
    scan = Scan(1000.0, np.array([2.0, 2.0]), 0.0, 1e-9, 0.1, 10.0, time_increment=0.5)
    odometry = Trajectory(np.array([1000.0, 1001.0]), np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))
    driving = LidarLog((scan,), (Odometry(1000.0, Pose(), Velocity()),), odometry, LIDAR, ())
    records: list[Record] = []
    LogTrace(Phase.MAP, "walk.log", driving, records.append).scan(0, Pose())
    seen = records[-1]
    assert isinstance(seen, RobotSnapshot)
    np.testing.assert_allclose(seen.points, [[2.1, 0.0], [2.6, 0.0]], atol=1e-6)
