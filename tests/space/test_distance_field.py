"""Distance fields are exact Euclidean distance transforms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_edt

from wherry.space.distance_field import DistanceField, nearest_cells, obstacle_distances
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose


@settings(max_examples=50, deadline=None)
@given(
    st.integers(1, 30),
    st.integers(1, 30),
    st.floats(0.0, 0.3),
    st.floats(0.05, 2.0),
    st.integers(0, 2**32 - 1),
)
def test_the_distance_field_agrees_with_scipy_up_to_its_limit(
    height: int, width: int, density: float, limit: float, seed: int
) -> None:
    occupied = np.random.default_rng(seed).random((height, width)) < density
    field = DistanceField.of(OccupancyGrid(occupied.astype(np.float32), 0.05), limit)
    exact = distance_transform_edt(~occupied) * 0.05 if occupied.any() else np.full(occupied.shape, np.inf)
    np.testing.assert_allclose(field.distance, np.minimum(exact, limit), atol=1e-6)


def test_points_are_looked_up_in_a_rotated_grid() -> None:
    probability = np.zeros((4, 6), np.float32)
    probability[1, 2] = 1.0  # its centre is at (2.5, 1.5) from the grid's corner
    grid = OccupancyGrid(probability, 1.0, Pose(10.0, 20.0, np.pi / 2))
    field = DistanceField.of(grid, 5.0)
    points = np.array([[8.5, 22.5], [8.5, 24.5], [6.5, 22.5], [50.0, 0.0]])
    np.testing.assert_allclose(field.at(points), [0.0, 2.0, 2.0, 5.0], atol=1e-6)


def test_obstacle_distances_have_no_limit_and_scale_with_the_spacing() -> None:
    occupied = np.zeros((2, 5), np.bool_)
    assert np.isinf(obstacle_distances(occupied)).all()
    occupied[0, 0] = True
    np.testing.assert_allclose(obstacle_distances(occupied, 0.5)[0], [0.0, 0.5, 1.0, 1.5, 2.0])
    np.testing.assert_allclose(obstacle_distances(occupied)[1, 1], np.sqrt(2.0))


def test_the_nearest_cells_are_target_cells_at_the_obstacle_distance() -> None:
    target = np.random.default_rng(1).random((20, 30)) < 0.05
    rows, columns = nearest_cells(target)
    assert target[rows, columns].all()
    offsets = np.indices(target.shape) - nearest_cells(target)
    np.testing.assert_allclose(np.hypot(*offsets), obstacle_distances(target))


def test_nearest_cells_without_a_target_are_an_error() -> None:
    with pytest.raises(ValueError, match="no target cell"):
        nearest_cells(np.zeros((3, 4), np.bool_))
