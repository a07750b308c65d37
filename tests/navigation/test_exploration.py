"""Frontier exploration of small maps, and of a building with a lidar simulated by ray casting."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wherry.navigation.exploration import frontier_cells, next_viewpoint, visible_unknown_area
from wherry.navigation.path import Costmap
from wherry.space.mapper import GridMapper
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry.space.raycast import cast_rays

RADIUS = 0.2  # m, of the robot


def half_known() -> OccupancyGrid:
    """A 4 × 2 m room whose right half is unknown; its far wall is known."""
    probability = np.zeros((40, 80), np.float32)
    probability[:, 40:] = 0.5
    probability[[0, -1]] = probability[:, [0, -1]] = 1.0
    return OccupancyGrid(probability, 0.05)


def test_the_frontier_lies_between_free_and_unknown() -> None:
    rows, columns = np.nonzero(frontier_cells(half_known()))
    assert set(columns) == {39}
    assert len(rows) == 38


def test_each_visible_unknown_cell_counts_once() -> None:
    assert visible_unknown_area(half_known(), np.array([1.9, 1.0])) == pytest.approx(38 * 39 * 0.05**2, rel=0.03)
    assert visible_unknown_area(half_known(), np.array([-5.0, 1.0])) == 0.0


def test_the_next_viewpoint_is_an_unvisited_one_at_the_frontier() -> None:
    grid = half_known()
    costmap = Costmap.from_grid(grid, RADIUS)
    viewpoint = next_viewpoint(grid, costmap, Pose(0.5, 1.0, 0.0), np.zeros((0, 2)))
    assert viewpoint is not None
    assert 1.5 < viewpoint.position[0] < 2.0
    again = next_viewpoint(grid, costmap, Pose(0.5, 1.0, 0.0), viewpoint.position[None])
    assert again is None or np.hypot(*(again.position - viewpoint.position)) > 0.3


def test_exploration_ends_without_a_reachable_frontier() -> None:
    known = OccupancyGrid(np.where(half_known().unknown, 0.0, half_known().probability).astype(np.float32), 0.05)
    assert next_viewpoint(known, Costmap.from_grid(known, RADIUS), Pose(0.5, 1.0, 0.0), np.zeros((0, 2))) is None
    walled = half_known().probability.copy()
    walled[:, 30] = 1.0
    grid = OccupancyGrid(walled, 0.05)
    assert next_viewpoint(grid, Costmap.from_grid(grid, RADIUS), Pose(0.5, 1.0, 0.0), np.zeros((0, 2))) is None


def test_a_building_is_explored_completely() -> None:
    building = np.zeros((160, 200), np.bool_)
    building[[0, -1]] = building[:, [0, -1]] = True
    building[:, 100] = building[80, :] = True
    for row, column in ((40, 100), (120, 100), (80, 50), (80, 150)):  # doors, 0.8 m wide
        building[row - 8 : row + 8, column] = building[row, column - 8 : column + 8] = False
    angles = np.linspace(-math.pi, math.pi, 360, endpoint=False)
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    mapper, pose, visited = GridMapper(0.05), Pose(1.0, 1.0, 0.0), np.zeros((0, 2))
    for _ in range(60):
        position = np.array([pose.x, pose.y])
        ranges = cast_rays(building, 0.05, Pose(), np.array([[pose.x, pose.y, 0.0]]), angles, 12.0)[0]
        mapper.add(position, position + (ranges[:, None] + 0.01) * directions, np.ones(360, np.bool_))
        visited = np.vstack([visited, position])
        grid = mapper.grid()
        costmap = Costmap.from_grid(grid, RADIUS, known_free=np.array([[pose.x, pose.y, 0.3]]))
        viewpoint = next_viewpoint(grid, costmap, pose, visited)
        if viewpoint is None:
            break
        pose = Pose(*viewpoint.position, 0.0)
    else:
        pytest.fail("exploration did not end")
    free = np.argwhere(~building)
    cells = grid.cells_at((free[:, ::-1] + 0.5) * 0.05)
    known = grid.contains(cells)
    assert grid.free[cells[known, 0], cells[known, 1]].sum() / len(free) > 0.98
