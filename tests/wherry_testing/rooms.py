"""A small building for tests: exact ranges from analytic walls, and an occupancy grid with noisy walls."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from wherry.robot import Odometry, Scan, Velocity
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose

Floats = NDArray[np.float64]
LIDAR = Pose(-0.14, 0.0, 0.0)  # base_link frame
SIZE = 9.6  # m, side of the building
WALL_THICKNESS = 0.06  # m


def _wall(x0: float, y0: float, x1: float, y1: float) -> tuple[float, float, float, float]:
    """The rectangle (x0, y0, x1, y1) m of a wall along a line."""
    half = WALL_THICKNESS / 2
    return min(x0, x1) - half, min(y0, y1) - half, max(x0, x1) + half, max(y0, y1) + half


WALLS = np.array(
    [
        _wall(0, 0, SIZE, 0),
        _wall(0, SIZE, SIZE, SIZE),
        _wall(0, 0, 0, SIZE),
        _wall(SIZE, 0, SIZE, SIZE),
        _wall(3.6, 0, 3.6, 1.8),  # a doorway of one cell at y = 1.8 … 2.4 m
        _wall(3.6, 2.4, 3.6, 6.6),
        _wall(3.6, 7.8, 3.6, SIZE),  # a doorway of two cells
        _wall(0, 4.8, 1.2, 4.8),
        _wall(1.8, 4.8, 3.6, 4.8),
        _wall(3.6, 5.4, 5.4, 5.4),
        _wall(6.0, 5.4, SIZE, 5.4),
        _wall(6.6, 0, 6.6, 3.0),
        _wall(6.6, 3.6, 6.6, 5.4),
        (7.8, 7.2, 8.4, 7.8),  # filled cells
        (1.2, 1.8, 1.8, 2.4),
        (4.8, 7.8, 5.4, 8.4),
    ]
)


@dataclass(frozen=True)
class Building:
    """Obstacles in the map frame.

    Attributes:
        rectangles: [N, 4] x0, y0, x1, y1 m.
        circles: Centre x m, centre y m and radius m of each circle.
    """

    rectangles: Floats = field(default_factory=lambda: WALLS)
    circles: tuple[tuple[float, float, float], ...] = ()

    def ranges(self, lidar: Pose, angles: Floats, max_range: float = math.inf) -> Floats:
        """[R] m, exact ranges at angles [R] rad, lidar frame; inf beyond ``max_range``."""
        direction = np.column_stack([np.cos(angles + lidar.theta), np.sin(angles + lidar.theta)])
        start = np.array([lidar.x, lidar.y])
        with np.errstate(divide="ignore", invalid="ignore"):
            low = (self.rectangles[None, :, :2] - start) / direction[:, None, :]
            high = (self.rectangles[None, :, 2:] - start) / direction[:, None, :]
        enter = np.nanmax(np.minimum(low, high), axis=2)
        leave = np.nanmin(np.maximum(low, high), axis=2)
        found = np.where((enter <= leave) & (enter > 0), enter, np.inf).min(axis=1)
        for x, y, radius in self.circles:
            along = direction @ (np.array([x, y]) - start)
            miss = (x - start[0]) ** 2 + (y - start[1]) ** 2 - along**2
            inside = radius**2 - miss
            near = along - np.sqrt(np.maximum(inside, 0.0))
            found = np.where((inside > 0) & (near > 0), np.minimum(found, near), found)
        return np.where(found <= max_range, found, np.inf)

    def scan(self, time: float, base: Pose, rng: np.random.Generator | None = None, sigma: float = 0.01) -> Scan:
        """The scan of a lidar with 360 beams and a range of 12 m at a pose of base_link."""
        increment = math.tau / 360
        angles = -math.pi + increment * np.arange(360)
        ranges = self.ranges(base @ LIDAR, angles, 12.0)
        if rng is not None:
            ranges = ranges + sigma * rng.standard_normal(360)
        return Scan(time, ranges, -math.pi, increment, 0.05, 12.0)

    def grid(self, resolution: float = 0.05, origin: Pose = Pose(-0.513, -0.487, 0.0), seed: int = 0) -> OccupancyGrid:  # noqa: B008
        """The map: cells with walls are occupied, other cells of the building are free, all else is unknown."""
        rng = np.random.default_rng(seed)
        cells = math.ceil((SIZE + 1.0) / resolution)
        hits = np.zeros((cells, cells))
        for x0, y0, x1, y1 in self.rectangles:
            xs, ys = np.arange(x0, x1, 0.002), np.arange(y0, y1, 0.002)
            sides = [
                np.column_stack([xs, np.full_like(xs, y0)]),
                np.column_stack([xs, np.full_like(xs, y1)]),
                np.column_stack([np.full_like(ys, x0), ys]),
                np.column_stack([np.full_like(ys, x1), ys]),
            ]
            points = np.concatenate(sides)
            points += 0.01 * rng.standard_normal(points.shape)
            column, row = np.floor(origin.inverse.transform(points) / resolution).astype(int).T
            inside = (column >= 0) & (row >= 0) & (column < cells) & (row < cells)
            np.add.at(hits, (row[inside], column[inside]), 1)
        rows, columns = np.indices(hits.shape)
        centres = origin.transform(np.column_stack([columns.ravel() + 0.5, rows.ravel() + 0.5]) * resolution)
        indoors = ((centres > 0) & (centres < SIZE)).all(axis=1).reshape(hits.shape)
        probability = np.where(indoors, 0.05, 0.5)
        probability[hits > 0.25 * resolution / 0.002] = 0.95
        return OccupancyGrid(probability.astype(np.float32), resolution, origin)


WAYPOINTS = ((0.9, 0.9), (2.7, 0.9), (2.7, 2.1), (4.5, 2.1), (5.7, 3.3), (7.5, 3.3), (8.7, 1.5), (7.5, 3.3), (5.7, 3.3))
WAYPOINTS += ((5.7, 6.3), (4.5, 7.2), (2.4, 7.2), (1.5, 5.7), (1.5, 3.6), (0.9, 3.0), (0.9, 0.9))


def drive(
    waypoints: tuple[tuple[float, float], ...] = WAYPOINTS, rate: float = 10.0, speed: float = 0.4, turn: float = 1.0
) -> Iterator[Pose]:
    """True poses along waypoints at a rate in Hz: turns on the spot, straight drives."""
    pose = Pose(*waypoints[0], 0.0)
    yield pose
    for x, y in waypoints[1:]:
        bearing = math.atan2(y - pose.y, x - pose.x)
        left = math.remainder(bearing - pose.theta, math.tau)
        for _ in range(math.ceil(abs(left) / turn * rate)):
            pose = Pose(pose.x, pose.y, pose.theta + left / math.ceil(abs(left) / turn * rate))
            yield pose
        steps = math.ceil(math.hypot(x - pose.x, y - pose.y) / speed * rate)
        start = pose
        for step in range(1, steps + 1):
            pose = Pose(start.x + (x - start.x) * step / steps, start.y + (y - start.y) * step / steps, bearing)
            yield pose


def wheel_odometry(
    truth: list[Pose], rng: np.random.Generator, scale: float = 0.03, turn_scale: float = 0.03, rate: float = 10.0
) -> list[Odometry]:
    """Odometry at true poses, with systematic errors of a few percent and random noise."""
    pose = Pose(3.0, -2.0, 1.0)
    found = [Odometry(0.0, pose, Velocity())]
    for i in range(1, len(truth)):
        step = truth[i].relative_to(truth[i - 1])
        length = math.hypot(step.x, step.y)
        moved = Pose(
            step.x * (1 + scale) + 0.05 * length * rng.standard_normal(),
            step.y,
            step.theta * (1 - turn_scale) + 0.05 * abs(step.theta) * rng.standard_normal() + 0.02 * length,
        )
        pose = pose @ moved
        found.append(Odometry(i / rate, pose, Velocity()))
    return found
