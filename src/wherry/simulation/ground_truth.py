"""The true map of a world: what a mapper without any error makes of it."""

from __future__ import annotations

import math

import numpy as np

from wherry.floorplan.plan import FloorPlan
from wherry.simulation.faults import cell_pose, reachable_cells
from wherry.simulation.simulator import build
from wherry.space.mapper import GridMapper
from wherry.space.occupancy import OccupancyGrid

RESOLUTION = 0.05  # m, side of the map's cells
VIEWS_PER_CELL = 4  # headings at which the lidar scans in every reachable cell


def true_map(plan: FloorPlan) -> OccupancyGrid:
    """Map a world without its boxes from noisy scans at true poses in every cell that the robot can reach.

    Args:
        plan: The building, with a robot.

    Raises:
        InputError: The plan has no robot.
    """
    empty = build(plan.with_boxes(()), np.random.default_rng(0))
    mapper = GridMapper(RESOLUTION)
    no_boxes = np.empty((0, 2))
    for cell in reachable_cells(plan):
        for view in range(VIEWS_PER_CELL):
            lidar = cell_pose(plan, cell, view * math.tau / VIEWS_PER_CELL) @ empty.robot.body.lidar
            ends = lidar.transform(empty.lidar.scan(0.0, lidar, no_boxes, 0.1).points())
            mapper.add(lidar.as_array()[:2], ends, np.ones(len(ends), np.bool_))
    return mapper.grid()
