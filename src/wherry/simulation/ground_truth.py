"""The true map of a world: the occupancy grid of scans taken at true poses."""

from __future__ import annotations

import math

import numpy as np

from wherry.floorplan.plan import FloorPlan
from wherry.simulation.faults import cell_pose, reachable_cells
from wherry.simulation.simulator import build
from wherry.space.mapper import GridMapper
from wherry.space.occupancy import OccupancyGrid

RESOLUTION = 0.05  # m, side of the map's grid cells
HEADINGS_PER_CELL = 4  # scans at evenly spaced headings in every reachable cell


def true_map(plan: FloorPlan) -> OccupancyGrid:
    """Map a world without its boxes from noisy scans at true poses in every reachable cell.

    Args:
        plan: A floor plan with a robot.

    Raises:
        InputError: The plan has no robot.
    """
    empty = build(plan.with_boxes(()), np.random.default_rng(0))
    mapper = GridMapper(RESOLUTION)
    no_boxes = np.empty((0, 2))
    for cell in reachable_cells(plan):
        for turn in range(HEADINGS_PER_CELL):
            lidar = cell_pose(plan, cell, turn * math.tau / HEADINGS_PER_CELL) @ empty.robot.body.lidar
            end_points = lidar.transform(empty.lidar.scan(0.0, lidar, no_boxes, 0.1).points())
            mapper.add(lidar.as_array()[:2], end_points, np.ones(len(end_points), np.bool_))
    return mapper.grid()
