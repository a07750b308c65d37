"""Shortest paths and costmaps on small maps with known solutions."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from wherry.navigation.path import Costmap, shortest_path, travel_costs
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import IDENTITY, Pose

RADIUS = 0.2  # m, of the robot


def room(*walls: tuple[float, float, float, float], origin: Pose = IDENTITY, unknown: bool = False) -> OccupancyGrid:
    """A 4 × 4 m room at a resolution of 0.05 m with inner walls (x0, y0, x1, y1), m, or unknown areas instead."""
    probability = np.zeros((80, 80), np.float32)
    probability[[0, -1]] = probability[:, [0, -1]] = 1.0
    for x0, y0, x1, y1 in walls:
        area = slice(round(y0 / 0.05), round(y1 / 0.05)), slice(round(x0 / 0.05), round(x1 / 0.05))
        probability[area] = 0.5 if unknown else 1.0
    return OccupancyGrid(probability, 0.05, origin)


def test_clearance_is_the_distance_to_a_walls_face() -> None:
    costmap = Costmap.from_grid(room(), RADIUS)
    row, column = costmap.cell_at(np.array([1.02, 2.0]))
    assert costmap.clearance[row, column] == pytest.approx(1.025 - 0.05, abs=1e-6)


def test_a_free_path_is_a_straight_line() -> None:
    path = shortest_path(Costmap.from_grid(room(), RADIUS), np.array([1.0, 1.0]), np.array([3.0, 2.6]))
    assert path is not None
    np.testing.assert_allclose(path, [[1.0, 1.0], [3.0, 2.6]])


def test_a_path_around_a_wall_is_short_and_collision_free() -> None:
    costmap = Costmap.from_grid(room((1.9, 0.0, 2.1, 3.0)), RADIUS)
    path = shortest_path(costmap, np.array([1.0, 1.0]), np.array([3.0, 1.0]))
    assert path is not None
    shortest = 2 * math.hypot(0.9, 2.2) + 0.2
    assert shortest < np.hypot(*np.diff(path, axis=0).T).sum() < 1.1 * shortest
    for start, end in itertools.pairwise(path):
        for fraction in np.linspace(0, 1, 50):
            assert costmap.is_passable(start + fraction * (end - start))


def test_there_is_no_path_through_a_wall_or_a_narrow_gap() -> None:
    start, goal = np.array([1.0, 1.0]), np.array([3.0, 1.0])
    assert shortest_path(Costmap.from_grid(room((1.9, 0.0, 2.1, 4.0)), RADIUS), start, goal) is None
    narrow = Costmap.from_grid(room((1.9, 0.0, 2.1, 1.8), (1.9, 2.1, 2.1, 4.0)), RADIUS)
    assert shortest_path(narrow, start, goal) is None
    wide = Costmap.from_grid(room((1.9, 0.0, 2.1, 1.7), (1.9, 2.2, 2.1, 4.0)), RADIUS)
    assert shortest_path(wide, start, goal) is not None


def test_unknown_space_is_an_obstacle_by_default() -> None:
    grid = room((1.9, 0.0, 2.1, 4.0), unknown=True)
    start, goal = np.array([1.0, 1.0]), np.array([3.0, 1.0])
    assert shortest_path(Costmap.from_grid(grid, RADIUS), start, goal) is None
    assert shortest_path(Costmap.from_grid(grid, RADIUS, unknown_passable=True), start, goal) is not None
    known = np.array([[2.0, 1.0, 0.5]])
    assert shortest_path(Costmap.from_grid(grid, RADIUS, known_free=known), start, goal) is not None


def test_a_path_leads_around_disc_obstacles() -> None:
    disc = np.array([[2.0, 1.0, 0.3]])
    costmap = Costmap.from_grid(room(), RADIUS, obstacles=disc)
    path = shortest_path(costmap, np.array([1.0, 1.0]), np.array([3.0, 1.0]))
    assert path is not None
    along = np.concatenate([np.linspace(a, b, 100) for a, b in itertools.pairwise(path)])
    assert np.hypot(*(along - [2.0, 1.0]).T).min() > 0.3 + RADIUS - 0.03


def test_a_path_does_not_depend_on_the_maps_origin() -> None:
    origin = Pose(-3.0, 5.0, 2.0)
    walls = (1.9, 0.0, 2.1, 3.0)
    ends = np.array([[1.0, 1.0], [3.0, 1.0]])
    moved = origin.transform(ends)
    here = shortest_path(Costmap.from_grid(room(walls), RADIUS), ends[0], ends[1])
    there = shortest_path(Costmap.from_grid(room(walls, origin=origin), RADIUS), moved[0], moved[1])
    assert here is not None
    assert there is not None
    np.testing.assert_allclose(origin.transform(here), there, atol=1e-9)


def test_a_goal_in_a_wall_is_replaced_by_the_nearest_passable_cell() -> None:
    costmap = Costmap.from_grid(room(), RADIUS)
    goal = np.array([2.0, 0.02])
    path = shortest_path(costmap, np.array([2.0, 2.0]), goal)
    assert path is not None
    assert path[-1][1] == pytest.approx(0.275)


def test_a_start_in_collision_is_left_by_the_shortest_way() -> None:
    # From beside a wall's end, a straight line to the goal would cross the wall's corner.
    costmap = Costmap.from_grid(room((1.9, 0.0, 2.0, 1.5)), RADIUS)
    start, goal = np.array([1.78, 1.56]), np.array([3.0, 1.2])
    assert not costmap.is_passable(start)
    path = shortest_path(costmap, start, goal)
    assert path is not None
    np.testing.assert_allclose(path[0], start)
    assert np.hypot(*(path[1] - start)) < 0.15
    for begin, end in itertools.pairwise(path[1:]):
        for fraction in np.linspace(0, 1, 50):
            assert costmap.is_passable(begin + fraction * (end - begin))


def test_the_cell_with_the_largest_clearance_nearby_is_found() -> None:
    costmap = Costmap.from_grid(room(), RADIUS)
    found = costmap.centres(np.array([costmap.max_clearance_cell(np.array([0.3, 2.0]), 0.3)]))[0]
    assert found[0] == pytest.approx(0.3 + 0.3, abs=0.051)
    row, column = costmap.max_clearance_cell(np.array([0.1, 0.1]), 0.5)
    assert row == column == costmap.cell_at(np.array([0.1, 0.1]))[0] + 10


def test_travel_costs_are_path_lengths_and_infinite_without_a_path() -> None:
    costmap = Costmap.from_grid(room((1.9, 0.0, 2.1, 4.0)), RADIUS)
    costs = travel_costs(costmap, np.array([1.025, 1.025]))
    assert costs[costmap.cell_at(np.array([1.025, 3.025]))] == pytest.approx(2.0)
    assert math.isinf(costs[costmap.cell_at(np.array([3.0, 1.0]))])
