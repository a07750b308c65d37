"""The simulated lidar: exact ranges to walls, obstacles and boxes, with Gaussian noise."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import kernel
from wherry.robot import Scan
from wherry.simulation.static_geometry import FREE, StaticGeometry
from wherry.space.pose import Floats, Pose


@dataclass(frozen=True, slots=True)
class LidarSpecification:
    """Parameters of a 2D lidar with a field of view of 360°.

    Attributes:
        beams: Number of beams in a scan; beam 0 points backwards (−π), as in most ROS drivers.
        rate: Rate of the scans, Hz; must divide the odometry's rate of 20 Hz.
        range_min: Shortest valid range, m; a box in the fork is 0.07 m away.
        range_max: Longest valid range, m.
        noise: Standard deviation of a range, m.
    """

    beams: int = 360
    rate: float = 10.0
    range_min: float = 0.02
    range_max: float = 12.0
    noise: float = 0.01


class Lidar:
    """Simulates scans.

    Args:
        specification: The lidar's parameters.
        geometry: The walls and obstacles; boxes are passed with each scan, as they move.
        rng: Source of the noise.

    Attributes:
        specification: The lidar's parameters.
        is_blind: Whether all ranges are replaced by NaN.
    """

    def __init__(self, specification: LidarSpecification, geometry: StaticGeometry, rng: np.random.Generator) -> None:
        self.specification = specification
        self.is_blind = False
        self._angles: Floats = np.linspace(-math.pi, math.pi, specification.beams, endpoint=False)
        self._geometry = geometry
        self._rng = rng

    def scan(self, time: float, pose: Pose, boxes: Floats, box_radius: float) -> Scan:
        """Simulate a scan whose beams are all measured at the same time.

        Args:
            time: Time of the scan, s.
            pose: The lidar in the world frame.
            boxes: [B, 2] centres of the boxes on the floor or in the fork, m, world frame.
            box_radius: Radius of a box, m.
        """
        lidar = self.specification
        ranges = exact_ranges(self._geometry, pose, self._angles, boxes, box_radius)
        ranges += lidar.noise * self._rng.standard_normal(lidar.beams)
        ranges[ranges > lidar.range_max] = math.inf
        if self.is_blind:
            ranges[:] = math.nan
        return Scan(time, ranges, -math.pi, math.tau / lidar.beams, lidar.range_min, lidar.range_max)


def exact_ranges(geometry: StaticGeometry, pose: Pose, angles: Floats, boxes: Floats, box_radius: float) -> Floats:
    """Cast rays at walls, obstacles and boxes.

    A ray steps from grid line to grid line until it enters a solid element (Amanatides & Woo 1987, here for unevenly
    spaced lines, unlike `wherry.space.raycast`); boxes are circles. MuJoCo's `mj_multiRay` returns the same ranges in
    four times the time.

    Args:
        geometry: The walls and obstacles.
        pose: Origin of the rays, world frame, within the outer walls.
        angles: [R] directions of the rays from the pose's x axis, rad.
        boxes: [B, 2] centres of the boxes, m, world frame.
        box_radius: Radius of a box, m.

    Returns:
        [R] ranges, m; 0 if the origin is in a solid element.
    """
    directions = np.column_stack([np.cos(angles + pose.theta), np.sin(angles + pose.theta)])
    return _exact_ranges(geometry.xs, geometry.ys, geometry.kinds, (pose.x, pose.y), directions, boxes, box_radius)


@kernel
def _exact_ranges(
    xs: Floats,
    ys: Floats,
    kinds: NDArray[np.uint8],
    origin: tuple[float, float],
    directions: Floats,
    boxes: Floats,
    radius: float,
) -> Floats:
    """As `exact_ranges`, for directions given as unit vectors, [R, 2], world frame."""
    x, y = origin
    first_column, first_row = np.searchsorted(xs, x, side="right") - 1, np.searchsorted(ys, y, side="right") - 1
    ranges = np.empty(len(directions))
    for r in range(len(directions)):
        dx, dy = directions[r, 0], directions[r, 1]
        right, up = int(dx > 0.0), int(dy > 0.0)
        column, row, length = first_column, first_row, 0.0
        while kinds[row, column] == FREE:
            to_column = (xs[column + right] - x) / dx if dx != 0.0 else np.inf
            to_row = (ys[row + up] - y) / dy if dy != 0.0 else np.inf
            if to_column < to_row:
                length = to_column
                column += 2 * right - 1
            else:
                length = to_row
                row += 2 * up - 1
        for b in range(len(boxes)):
            along = (boxes[b, 0] - x) * dx + (boxes[b, 1] - y) * dy
            lateral = (boxes[b, 1] - y) * dx - (boxes[b, 0] - x) * dy
            if along > 0.0 and abs(lateral) < radius:
                length = min(length, along - np.sqrt(radius * radius - lateral * lateral))
        ranges[r] = max(length, 0.0)
    return ranges
