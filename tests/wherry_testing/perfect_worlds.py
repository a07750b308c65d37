"""Perfect maps of floor plans, and simulated scans from any pose in them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wherry.floorplan.plan import Cell, FloorPlan
from wherry.robot import Body, Scan
from wherry.simulation.lidar import Lidar, LidarSpecification
from wherry.simulation.model import BODY
from wherry.simulation.static_geometry import StaticGeometry
from wherry.space.frame import CellFrame
from wherry.space.occupancy import UNKNOWN, OccupancyGrid
from wherry.space.pose import IDENTITY, Floats, Pose

MAP_MARGIN = 0.5  # m, width of the unknown border around a map


def centre(plan: FloorPlan, cell: Cell) -> Floats:
    """Centre of a cell, [2] m, world frame."""
    return np.array(plan.centre(cell))


def heading_of(plan: FloorPlan) -> float:
    """The robot's initial heading, rad, world frame."""
    return math.atan2(plan.heading.dy, plan.heading.dx)


def frame_of(plan: FloorPlan, map_from_world: Pose = IDENTITY) -> CellFrame:
    """The cell frame of a plan on a map."""
    return CellFrame(map_from_world, plan.cell_size)


def perfect_map(plan: FloorPlan, map_from_world: Pose = IDENTITY, resolution: float = 0.05) -> OccupancyGrid:
    """The true occupancy grid of a plan; cells outside the building are unknown."""
    size = np.array([plan.width, plan.height]) * plan.cell_size
    corners = map_from_world.transform(np.array([[0, 0], [size[0], 0], size, [0, size[1]]]))
    low, high = corners.min(axis=0) - MAP_MARGIN, corners.max(axis=0) + MAP_MARGIN
    width, height = np.ceil((high - low) / resolution).astype(int)
    grid = OccupancyGrid(np.full((height, width), UNKNOWN, np.float32), resolution, Pose(float(low[0]), float(low[1])))
    cells = np.argwhere(np.ones((height, width), np.bool_))
    points = map_from_world.inverse.transform(grid.centres(cells))
    inside = np.all((points > 0) & (points < size), axis=1)
    solid = is_solid(StaticGeometry.from_plan(plan), points)
    values = np.where(solid, 1.0, np.where(inside, 0.0, UNKNOWN)).astype(np.float32)
    return OccupancyGrid(values.reshape(height, width), resolution, grid.origin)


def is_solid(geometry: StaticGeometry, points: Floats) -> NDArray[np.bool_]:
    """[N] True for points [N, 2], m, world frame, in a wall or an obstacle."""
    columns = np.searchsorted(geometry.xs, points[:, 0], side="right") - 1
    rows = np.searchsorted(geometry.ys, points[:, 1], side="right") - 1
    height, width = geometry.kinds.shape
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    solid = np.zeros(len(points), np.bool_)
    solid[inside] = geometry.kinds[rows[inside], columns[inside]] != 0
    return solid


class MovableLidar:
    """A lidar that can be placed anywhere in a world.

    Args:
        plan: The world; its boxes are ignored.
        noise: Standard deviation of every range, m.
        body: The body that carries the lidar.
        beams: Number of beams.
    """

    def __init__(self, plan: FloorPlan, noise: float = 0.0, body: Body = BODY, beams: int = 360) -> None:
        specification = LidarSpecification(noise=noise, beams=beams)
        self.body = body
        self._lidar = Lidar(specification, StaticGeometry.from_plan(plan), np.random.default_rng(7))

    def scan(self, base: Pose, boxes: Floats | None = None) -> Scan:
        """The scan of a robot with base_link at a pose in the world frame, among boxes [B, 2] m."""
        centres = np.empty((0, 2)) if boxes is None else np.asarray(boxes, dtype=np.float64).reshape(-1, 2)
        return self._lidar.scan(0.0, base @ self.body.lidar, centres, self.body.box_radius)
