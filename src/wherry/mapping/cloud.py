"""A scan as matching sees it: points with the directions that their surfaces face."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from wherry.kernels import kernel
from wherry.robot import Scan
from wherry.space.pose import Floats, Pose

SPACING = 0.05  # m, points closer together than this say the same twice
NEAR, WIDE = 0.15, 0.3  # m; a surface's direction is that of the points so far around: of noisy ones, the wider
NEIGHBOURS = 20  # beams to either side, at most
FLATNESS = 0.35  # smallest to largest spread of a neighbourhood that still is a surface


@dataclass(frozen=True)
class Cloud:
    """Points on surfaces.

    Attributes:
        points: [N, 2] m.
        normals: [N, 2] unit vectors out of the surface, towards where it was seen from; zero where no surface is seen.
    """

    points: Floats
    normals: Floats

    @classmethod
    def of(cls, scan: Scan, lidar: Pose, range_limit: float = math.inf) -> Cloud:
        """The valid readings of a scan, thinned to `SPACING`, in the robot's frame.

        Args:
            scan: One turn of the lidar.
            lidar: Where it is mounted, in the base_link frame.
            range_limit: m, readings beyond it are left out.
        """
        ranges = np.where(scan.valid & (scan.ranges <= range_limit), scan.ranges, np.nan)
        points, normals = _surfaces(ranges, scan.angle_min, scan.angle_increment)
        return cls(lidar.transform(points), Pose(theta=lidar.theta).transform(normals))

    def seen_from(self, pose: Pose) -> Cloud:
        """The same points in the frame that ``pose`` is given in."""
        return Cloud(pose.transform(self.points), Pose(theta=pose.theta).transform(self.normals))

    def thinned(self, size: int) -> Cloud:
        """At most ``size`` of the points, evenly along the cloud."""
        if len(self.points) <= size:
            return self
        kept = np.linspace(0, len(self.points) - 1, size).round().astype(np.int64)
        return Cloud(self.points[kept], self.normals[kept])


def merged(clouds: Iterable[Cloud], cell: float) -> Cloud:
    """Several clouds of one frame as one, with a single point in each square of ``cell`` metres: the first."""
    parts = list(clouds)
    points, normals = np.vstack([part.points for part in parts]), np.vstack([part.normals for part in parts])
    squares = np.floor(points / cell).astype(np.int64)
    _, first = np.unique(squares, axis=0, return_index=True)
    kept = np.sort(first)
    return Cloud(points[kept], normals[kept])


@kernel
def _surfaces(ranges: Floats, angle_min: float, angle_increment: float) -> tuple[Floats, Floats]:
    """Thinned points [N, 2] m and their normals [N, 2], in the lidar's frame; ``ranges`` [R] m, NaN for no reading."""
    count = len(ranges)
    x, y = np.empty(count), np.empty(count)
    for i in range(count):
        angle = angle_min + angle_increment * i
        x[i], y[i] = ranges[i] * math.cos(angle), ranges[i] * math.sin(angle)
    points, normals = np.empty((count, 2)), np.empty((count, 2))
    kept, last = 0, -1
    for i in range(count):
        if math.isnan(ranges[i]):
            continue
        if last >= 0 and (x[i] - x[last]) ** 2 + (y[i] - y[last]) ** 2 < SPACING * SPACING:
            continue
        last = i
        points[kept, 0], points[kept, 1] = x[i], y[i]
        spread = 2.5 * ranges[i] * abs(angle_increment)  # a neighbour to either side, at least
        normal_x, normal_y = _normal(x, y, i, max(NEAR, spread))
        if normal_x == 0.0 and normal_y == 0.0:
            normal_x, normal_y = _normal(x, y, i, max(WIDE, spread))
        normals[kept, 0], normals[kept, 1] = normal_x, normal_y
        kept += 1
    return points[:kept].copy(), normals[:kept].copy()


@kernel
def _normal(x: Floats, y: Floats, i: int, reach: float) -> tuple[float, float]:
    """The direction in which a point's neighbours spread least, towards the lidar; zero if they lie on no line.

    Args:
        x: [R] m, all points; NaN for no reading.
        y: [R] m, likewise.
        i: The point.
        reach: m, how far away its neighbours are; they are the beams beside it, without a gap.
    """
    number, sx, sy, sxx, sxy, syy = 1, 0.0, 0.0, 0.0, 0.0, 0.0
    for side in (-1, 1):
        for step in range(1, NEIGHBOURS + 1):
            j = i + side * step
            if j < 0 or j >= len(x) or math.isnan(x[j]):
                break
            dx, dy = x[j] - x[i], y[j] - y[i]
            if dx * dx + dy * dy > reach * reach:
                break
            number += 1
            sx, sy = sx + dx, sy + dy
            sxx, sxy, syy = sxx + dx * dx, sxy + dx * dy, syy + dy * dy
    if number < 3:
        return 0.0, 0.0
    sxx, sxy, syy = sxx - sx * sx / number, sxy - sx * sy / number, syy - sy * sy / number
    middle, half = (sxx + syy) / 2.0, math.sqrt(((sxx - syy) / 2.0) ** 2 + sxy * sxy)
    if middle - half >= FLATNESS * FLATNESS * (middle + half):
        return 0.0, 0.0
    along = 0.5 * math.atan2(2.0 * sxy, sxx - syy)
    normal_x, normal_y = -math.sin(along), math.cos(along)
    towards = -1.0 if normal_x * x[i] + normal_y * y[i] > 0.0 else 1.0
    return towards * normal_x, towards * normal_y
