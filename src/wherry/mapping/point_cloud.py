"""Point clouds with surface normals, made from scans."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from wherry.kernels import kernel
from wherry.robot import Scan
from wherry.space.pose import Floats, Pose

MIN_POINT_SPACING = 0.05  # m between consecutive points; closer ones are redundant
NORMAL_RADIUS = 0.15  # m, neighbourhood that a normal is estimated from
WIDE_NORMAL_RADIUS = 0.3  # m, neighbourhood that is used where the smaller one is too noisy
MAX_NORMAL_NEIGHBOURS = 20  # beams to either side of a point that its normal is estimated from
MAX_NORMAL_SPREAD_RATIO = 0.35  # ratio of the standard deviations across and along a neighbourhood that is a line


@dataclass(frozen=True)
class PointCloud:
    """Points with surface normals.

    Attributes:
        points: Points, [N, 2] m.
        normals: Unit normals that face the sensor, [N, 2]; zero where the neighbours of a point form no line.
    """

    points: Floats
    normals: Floats

    @classmethod
    def from_scan(cls, scan: Scan, lidar: Pose, range_limit: float = math.inf) -> PointCloud:
        """The valid readings of a scan, at least `MIN_POINT_SPACING` apart, in the base_link frame.

        Args:
            scan: One revolution of the lidar.
            lidar: Pose of the lidar in the base_link frame.
            range_limit: Longest range that is used, m.
        """
        ranges = np.where(scan.valid & (scan.ranges <= range_limit), scan.ranges, np.nan)
        points, normals = _points_and_normals(ranges, scan.angles, _beam_spacing(scan))
        return cls(lidar.transform(points), Pose(theta=lidar.theta).transform(normals))

    def transformed(self, pose: Pose) -> PointCloud:
        """The cloud, carried from the frame that has ``pose`` into the frame that ``pose`` is given in."""
        return PointCloud(pose.transform(self.points), Pose(theta=pose.theta).transform(self.normals))

    def subsampled(self, size: int) -> PointCloud:
        """At most ``size`` of the points, evenly spaced along the cloud."""
        if len(self.points) <= size:
            return self
        kept = np.linspace(0, len(self.points) - 1, size).round().astype(np.int64)
        return PointCloud(self.points[kept], self.normals[kept])


def merge_clouds(clouds: Iterable[PointCloud], cell_size: float) -> PointCloud:
    """Merge clouds of one frame, keeping the first point in each square cell of side ``cell_size``, m."""
    parts = list(clouds)
    points, normals = np.vstack([part.points for part in parts]), np.vstack([part.normals for part in parts])
    cells = np.floor(points / cell_size).astype(np.int64)
    _, first = np.unique(cells, axis=0, return_index=True)
    kept = np.sort(first)
    return PointCloud(points[kept], normals[kept])


def _beam_spacing(scan: Scan) -> float:
    """Angle between consecutive beams, rad; the median where they are not evenly spaced."""
    if scan.beam_angles is None or len(scan.beam_angles) < 2:
        return abs(scan.angle_increment)
    return float(np.median(np.abs(np.diff(scan.beam_angles))))


@kernel
def _points_and_normals(ranges: Floats, angles: Floats, spacing: float) -> tuple[Floats, Floats]:
    """Points and normals of a scan.

    Args:
        ranges: Ranges, [R] m; NaN without a reading.
        angles: Directions of the beams, [R] rad, lidar frame.
        spacing: Angle between consecutive beams, rad.

    Returns:
        Points [N, 2] m and normals [N, 2] in the lidar frame.
    """
    count = len(ranges)
    x, y = np.empty(count), np.empty(count)
    for i in range(count):
        x[i], y[i] = ranges[i] * math.cos(angles[i]), ranges[i] * math.sin(angles[i])
    points, normals = np.empty((count, 2)), np.empty((count, 2))
    kept, last = 0, -1
    for i in range(count):
        if math.isnan(ranges[i]):
            continue
        if last >= 0 and (x[i] - x[last]) ** 2 + (y[i] - y[last]) ** 2 < MIN_POINT_SPACING * MIN_POINT_SPACING:
            continue
        last = i
        points[kept, 0], points[kept, 1] = x[i], y[i]
        beam_spacing = 2.5 * ranges[i] * spacing  # reaches at least one neighbour to either side
        normal_x, normal_y = _normal(x, y, i, max(NORMAL_RADIUS, beam_spacing))
        if normal_x == 0.0 and normal_y == 0.0:
            normal_x, normal_y = _normal(x, y, i, max(WIDE_NORMAL_RADIUS, beam_spacing))
        normals[kept, 0], normals[kept, 1] = normal_x, normal_y
        kept += 1
    return points[:kept].copy(), normals[:kept].copy()


@kernel
def _normal(x: Floats, y: Floats, i: int, radius: float) -> tuple[float, float]:
    """Unit normal of the line through a point's neighbours, facing the lidar; zero if they lie on no line.

    Args:
        x: x coordinates of all points, [R] m; NaN without a reading.
        y: y coordinates of all points, [R] m; NaN without a reading.
        i: Index of the point.
        radius: Largest distance of a neighbour, m; neighbours are consecutive beams without a gap.
    """
    count, sx, sy, sxx, sxy, syy = 1, 0.0, 0.0, 0.0, 0.0, 0.0
    for side in (-1, 1):
        for step in range(1, MAX_NORMAL_NEIGHBOURS + 1):
            j = i + side * step
            if j < 0 or j >= len(x) or math.isnan(x[j]):
                break
            dx, dy = x[j] - x[i], y[j] - y[i]
            if dx * dx + dy * dy > radius * radius:
                break
            count += 1
            sx, sy = sx + dx, sy + dy
            sxx, sxy, syy = sxx + dx * dx, sxy + dx * dy, syy + dy * dy
    if count < 3:
        return 0.0, 0.0
    sxx, sxy, syy = sxx - sx * sx / count, sxy - sx * sy / count, syy - sy * sy / count
    mean, half = (sxx + syy) / 2.0, math.sqrt(((sxx - syy) / 2.0) ** 2 + sxy * sxy)
    if mean - half >= MAX_NORMAL_SPREAD_RATIO * MAX_NORMAL_SPREAD_RATIO * (mean + half):
        return 0.0, 0.0
    along = 0.5 * math.atan2(2.0 * sxy, sxx - syy)
    normal_x, normal_y = -math.sin(along), math.cos(along)
    towards = -1.0 if normal_x * x[i] + normal_y * y[i] > 0.0 else 1.0
    return towards * normal_x, towards * normal_y
