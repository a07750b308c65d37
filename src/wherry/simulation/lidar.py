"""The simulated lidar: exact rays against walls, obstacles and boxes, then the noise of a real one."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import kernel
from wherry.robot import Scan
from wherry.simulation.solids import Solids
from wherry.space.pose import Floats, Pose


@dataclass(frozen=True, slots=True)
class LidarSpecification:
    """A small time-of-flight lidar that turns all the way round.

    Attributes:
        beams: In a turn; beam 0 looks backwards, as is usual in ROS.
        rate: Hz; a whole number of the odometry's periods of 0.05 s lies between two scans.
        range_min: m; a box in the fork is 0.07 m away.
        range_max: m.
        noise: σ, m, of every range.
    """

    beams: int = 360
    rate: float = 10.0
    range_min: float = 0.02
    range_max: float = 12.0
    noise: float = 0.01


class Lidar:
    """Makes scans.

    Args:
        specification: Its data sheet.
        solids: The walls and obstacles; boxes are given with each scan, as they move.
        rng: Where the noise comes from.

    Attributes:
        blind: Whether every reading fails.
    """

    def __init__(self, specification: LidarSpecification, solids: Solids, rng: np.random.Generator) -> None:
        self.specification = specification
        self.blind = False
        self._angles: Floats = np.linspace(-math.pi, math.pi, specification.beams, endpoint=False)
        self._solids = solids
        self._rng = rng

    def scan(self, time: float, pose: Pose, boxes: Floats, box_radius: float) -> Scan:
        """One turn of the lidar, measured at one instant.

        Args:
            time: s.
            pose: The lidar's, in the world frame.
            boxes: [B, 2] m, world frame, the middles of the boxes on the floor or in the fork.
            box_radius: m.
        """
        lidar = self.specification
        ranges = cast_rays(self._solids, pose, self._angles, boxes, box_radius)
        ranges += lidar.noise * self._rng.standard_normal(lidar.beams)
        ranges[ranges > lidar.range_max] = math.inf
        if self.blind:
            ranges[:] = math.nan
        return Scan(time, ranges, -math.pi, math.tau / lidar.beams, lidar.range_min, lidar.range_max)


def cast_rays(solids: Solids, pose: Pose, angles: Floats, boxes: Floats, box_radius: float) -> Floats:
    """How far the nearest surface is along each ray, exactly.

    A ray steps from line to line of the solids' grid until it enters a solid element (Amanatides and Woo 1987, on lines
    that are not evenly spaced); boxes are circles. MuJoCo's `mj_multiRay` gives the same in four times the time.

    Args:
        solids: The walls and obstacles.
        pose: Where the rays start, in the world frame, within the outer walls.
        angles: [R] rad, their directions, from the pose's x axis.
        boxes: [B, 2] m, world frame, the middles of cylinders.
        box_radius: m.

    Returns:
        [R] m; 0 if the rays start in something solid.
    """
    directions = np.column_stack([np.cos(angles + pose.theta), np.sin(angles + pose.theta)])
    return _cast_rays(solids.xs, solids.ys, solids.kinds, (pose.x, pose.y), directions, boxes, box_radius)


@kernel
def _cast_rays(
    xs: Floats,
    ys: Floats,
    kinds: NDArray[np.uint8],
    origin: tuple[float, float],
    directions: Floats,
    boxes: Floats,
    radius: float,
) -> Floats:
    """As `cast_rays`, for directions [R, 2] of length 1."""
    x, y = origin
    first_column, first_row = np.searchsorted(xs, x, side="right") - 1, np.searchsorted(ys, y, side="right") - 1
    ranges = np.empty(len(directions))
    for r in range(len(directions)):
        dx, dy = directions[r, 0], directions[r, 1]
        right, up = int(dx > 0.0), int(dy > 0.0)
        column, row, length = first_column, first_row, 0.0
        while kinds[row, column] == 0:
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
            beside = (boxes[b, 1] - y) * dx - (boxes[b, 0] - x) * dy
            if along > 0.0 and abs(beside) < radius:
                length = min(length, along - np.sqrt(radius * radius - beside * beside))
        ranges[r] = max(length, 0.0)
    return ranges
