"""Consistency of scans: points in the free space of another scan contradict a pose."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wherry.mapping.point_cloud import PointCloud
from wherry.mapping.visibility import COMPARED_POINTS, ScanView
from wherry.robot import Scan
from wherry.space.pose import Pose

LIDAR = Pose(0.2, 0.0, math.radians(180.0))
ROOM = (-3.0, 5.0, -2.0, 4.0)  # m, x and y of the walls


def view(base: Pose, *, without: slice = slice(0, 0)) -> ScanView:
    """What a lidar shows in the room with base_link at a pose; some of its beams may have no return."""
    lidar = base @ LIDAR
    angles = np.radians(np.arange(-180.0, 180.0))
    cos, sin = np.cos(angles + lidar.theta), np.sin(angles + lidar.theta)
    with np.errstate(divide="ignore"):
        to_x = np.where(cos > 0, (ROOM[1] - lidar.x) / cos, (ROOM[0] - lidar.x) / cos)
        to_y = np.where(sin > 0, (ROOM[3] - lidar.y) / sin, (ROOM[2] - lidar.y) / sin)
    ranges = np.minimum(to_x, to_y)
    ranges[without] = np.inf
    scan = Scan(0.0, ranges, -math.pi, math.radians(1.0), 0.05, 20.0)
    return ScanView.from_scan(scan, PointCloud.from_scan(scan, LIDAR), LIDAR)


@pytest.mark.parametrize("pose", [Pose(), Pose(0.5, 0.3, 0.4), Pose(-1.0, 1.0, 3.0)])
def test_scans_agree_at_the_true_pose(pose: Pose) -> None:
    consistency = view(Pose()).consistency(view(pose), pose)
    assert consistency.compared > 250
    assert consistency.share == 1.0


@pytest.mark.parametrize("offset", [Pose(1.0), Pose(0.0, -0.5), Pose(0.0, 0.0, math.radians(90.0))])
def test_scans_conflict_at_a_false_pose(offset: Pose) -> None:
    pose = Pose(0.5, 0.3, 0.4)
    consistency = view(Pose()).consistency(view(pose), pose @ offset)
    assert consistency.share < 0.8


def test_what_only_one_scan_has_seen_is_not_compared() -> None:
    whole, half = view(Pose()), view(Pose(), without=slice(0, 180))
    forward = len(half.points)  # all points of the half scan, and those of the whole one that the half scan has seen
    backward = whole.consistency(half, Pose()).compared - forward
    assert backward == pytest.approx(0.5 * COMPARED_POINTS, rel=0.15)
    dark = view(Pose(), without=slice(0, 360))
    assert whole.consistency(dark, Pose()).compared == 0
    assert whole.consistency(dark, Pose()).share == 1.0
