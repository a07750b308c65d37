"""Consistency of two scans: no point of one may lie in the space that the other has seen to be free."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from wherry.kernels import kernel
from wherry.mapping.point_cloud import PointCloud
from wherry.robot import Scan
from wherry.space.pose import Floats, Pose

RANGE_TOLERANCE = 0.1  # m by which a point may lie in front of or behind the surface that the other scan shows
COMPARED_POINTS = 180  # points of each scan that are compared
MAX_GAP_RATIO = 3.0  # angle between two readings, as a multiple of the scan's median, that surfaces are taken to span


@dataclass(frozen=True)
class Consistency:
    """How two scans agree where both have seen the same space.

    Attributes:
        agreeing: Points of one scan on a surface of the other.
        conflicting: Points of one scan in the free space of the other.
    """

    agreeing: int
    conflicting: int

    @property
    def compared(self) -> int:
        """Points in space that both scans have seen."""
        return self.agreeing + self.conflicting

    @property
    def share(self) -> float:
        """Share of the compared points that agree, 0 to 1; 1 if none can be compared."""
        return self.agreeing / self.compared if self.compared else 1.0


@dataclass(frozen=True)
class ScanView:
    """What a scan shows: points, and free space up to the readings.

    Attributes:
        points: All points in the base_link frame, [N, 2] m.
        origin: Position of the lidar in the base_link frame, [2] m.
        bearings: Directions of the readings from the lidar in increasing order, [R] rad, base_link frame.
        ranges: Ranges of the readings, [R] m.
        max_gap: Angle between readings that surfaces and free space are taken to span, rad.
    """

    points: Floats
    origin: Floats
    bearings: Floats
    ranges: Floats
    max_gap: float

    @classmethod
    def from_scan(cls, scan: Scan, cloud: PointCloud, lidar: Pose) -> ScanView:
        """The view of a scan with its point cloud, taken by a lidar at a pose in the base_link frame."""
        valid = scan.valid
        bearings, ranges, max_gap = _ordered(scan.angles[valid], scan.ranges[valid], lidar.theta)
        return cls(cloud.points, np.array([lidar.x, lidar.y]), bearings, ranges, max_gap)

    def consistency(self, other: ScanView, pose: Pose) -> Consistency:
        """Compare with another scan, taken with base_link at a pose in this scan's base_link frame."""
        agreeing, conflicting = self._compare(other.points, pose)
        back_agreeing, back_conflicting = other._compare(self.points, pose.inverse)
        return Consistency(agreeing + back_agreeing, conflicting + back_conflicting)

    def _compare(self, points: Floats, pose: Pose) -> tuple[int, int]:
        """Numbers of points [N, 2] m, moved by a pose, on the surfaces that this scan shows, and in front of them."""
        return _compare(self.bearings, self.ranges, self.origin, self.max_gap, points, pose.as_array())


@kernel
def _ordered(angles: Floats, ranges: Floats, turn: float) -> tuple[Floats, Floats, float]:
    """Bearings in increasing order with their ranges, and the largest gap that surfaces span, rad.

    Args:
        angles: Directions of the readings, [R] rad, lidar frame.
        ranges: Ranges of the readings, [R] m.
        turn: Heading of the lidar in the base_link frame, rad.
    """
    bearings = np.empty(len(angles))
    for n in range(len(angles)):
        bearings[n] = (angles[n] + turn + math.pi) % math.tau - math.pi
    order = np.argsort(bearings, kind="mergesort")
    bearings = bearings[order]
    gap = float(np.median(bearings[1:] - bearings[:-1])) if len(bearings) > 1 else 0.0
    return bearings, ranges[order], MAX_GAP_RATIO * gap


@kernel
def _compare(
    bearings: Floats, ranges: Floats, origin: Floats, max_gap: float, points: Floats, pose: Floats
) -> tuple[int, int]:
    """As `ScanView._compare`, with the pose [3]; of many points, only `COMPARED_POINTS` are compared."""
    agreeing, conflicting = 0, 0
    if len(bearings) < 2:
        return agreeing, conflicting
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    compared = min(len(points), COMPARED_POINTS)
    for n in range(compared):
        point = points[n * len(points) // compared]
        dx = pose[0] + cos * point[0] - sin * point[1] - origin[0]
        dy = pose[1] + sin * point[0] + cos * point[1] - origin[1]
        distance, bearing = math.hypot(dx, dy), math.atan2(dy, dx)
        after = np.searchsorted(bearings, bearing) % len(bearings)
        before = after - 1 if after > 0 else len(bearings) - 1
        gap = bearings[after] - bearings[before]
        if after == 0:
            gap += math.tau
        if gap > max_gap:
            continue
        if distance < min(ranges[before], ranges[after]) - RANGE_TOLERANCE:
            conflicting += 1
        elif distance <= max(ranges[before], ranges[after]) + RANGE_TOLERANCE:
            agreeing += 1
    return agreeing, conflicting
