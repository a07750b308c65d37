"""Cells of a grid in the map frame: conversion to points and back, and distances to a point."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wherry.space.grid_cells import cell_centres, cells_at
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose

ORIGIN = Pose(-2.0, 1.0, 0.7)


def test_a_cell_contains_its_centre() -> None:
    cells = np.array([[0, 0], [3, 1], [-2, 5]])
    np.testing.assert_array_equal(cells_at(cell_centres(cells, ORIGIN, 0.25), ORIGIN, 0.25), cells)


def test_cells_are_rows_and_columns() -> None:
    assert cells_at(np.array([[0.3, 0.1]]), Pose(), 0.25).tolist() == [[0, 1]]
    np.testing.assert_allclose(cell_centres(np.array([[0, 1]]), Pose(), 0.25), [[0.375, 0.125]])


@pytest.mark.parametrize("window", [(slice(None), slice(None)), (slice(1, 3), slice(2, 9))])
def test_distances_to_a_point_are_those_of_the_centres(window: tuple[slice, slice]) -> None:
    grid = OccupancyGrid(np.zeros((5, 6), np.float32), 0.25, ORIGIN)
    centres = grid.centres(np.argwhere(np.ones(grid.shape, np.bool_))).reshape(5, 6, 2)
    point = np.array([-1.5, 1.2])
    expected = np.hypot(*(centres - point).transpose(2, 0, 1))[window]
    np.testing.assert_allclose(grid.distances_to(point, window), expected, atol=1e-12)
    assert math.isclose(grid.distances_to(centres[2, 3])[2, 3], 0.0, abs_tol=1e-12)
