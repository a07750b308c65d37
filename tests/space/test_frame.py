"""Frames of cell grids: exact walls at any angle and offset, then points with noise."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wherry.space.frame import CellFrame, fit_cell_frame
from wherry.space.pose import Floats, Pose

CELL = 0.6  # m
WIDTH, HEIGHT = 7, 5  # cells

metres = st.floats(-50.0, 50.0)
angles = st.floats(-math.pi, math.pi)
poses = st.builds(Pose, metres, metres, angles)
numbers = st.integers(-300, 300)


def walls() -> Floats:
    """Points on the outer walls of a room of 7 × 5 cells and on two inner walls, [N, 2] m."""
    along_x, along_y = np.arange(0.025, WIDTH * CELL, 0.05), np.arange(0.025, HEIGHT * CELL, 0.05)
    parts = [(along_x, 0.0), (along_x, HEIGHT * CELL), (along_x[along_x < 3 * CELL], 2 * CELL)]
    points = [np.column_stack([x, np.full(len(x), y)]) for x, y in parts]
    parts = [(along_y, 0.0), (along_y, WIDTH * CELL), (along_y[along_y > 2 * CELL], 4 * CELL)]
    points += [np.column_stack([np.full(len(y), x), y]) for y, x in parts]
    return np.vstack(points)


def edge_distances(frame: CellFrame, points: Floats) -> Floats:
    """Distances of points from the nearest edges of cells, [N] m."""
    local = frame.origin.inverse.transform(points) / frame.cell_size
    return np.abs(local - np.round(local)).min(axis=1) * frame.cell_size


@given(st.builds(Pose, metres, metres, angles), st.floats(0.3, 2.0), numbers, numbers)
def test_the_centre_of_a_cell_is_in_the_cell(origin: Pose, size: float, x: int, y: int) -> None:
    frame = CellFrame(origin, size)
    centre = frame.centre(x, y)
    assert frame.cell_at(float(centre[0]), float(centre[1])) == (x, y)
    assert frame.cells_at(centre[None, :]).tolist() == [[x, y]]


@given(poses, st.floats(-0.49, 0.49), st.floats(-0.49, 0.49), numbers, numbers)
def test_all_points_around_the_centre_are_in_the_cell(origin: Pose, aside: float, up: float, x: int, y: int) -> None:
    frame = CellFrame(origin, CELL)
    turned = Pose(theta=origin.theta).transform(np.array([[aside * CELL, up * CELL]]))[0]
    assert frame.cells_at((frame.centre(x, y) + turned)[None, :]).tolist() == [[x, y]]


@given(poses, st.sampled_from([(1, 0), (0, 1), (-1, 0), (0, -1)]))
def test_a_heading_points_to_the_next_cell(origin: Pose, step: tuple[int, int]) -> None:
    frame = CellFrame(origin, CELL)
    heading = frame.heading(*step)
    there = frame.centre(2, 3) + CELL * np.array([math.cos(heading), math.sin(heading)])
    np.testing.assert_allclose(there, frame.centre(2 + step[0], 3 + step[1]), atol=1e-9)
    assert -math.pi <= heading <= math.pi


@settings(max_examples=40, deadline=None)
@given(poses)
def test_exact_walls_are_on_edges_at_any_angle_and_offset(place: Pose) -> None:
    points = place.transform(walls())
    frame = fit_cell_frame(points, CELL)
    assert edge_distances(frame, points).max() < 0.001
    assert abs(frame.origin.theta) <= math.radians(45.5)
    turned_by = math.remainder(frame.origin.theta - place.theta, math.pi / 2)
    assert abs(turned_by) <= math.radians(0.0101)  # half a step of the fine search


@settings(max_examples=40, deadline=None)
@given(poses)
def test_walls_are_in_cells_with_coordinates_from_zero(place: Pose) -> None:
    points = place.transform(walls())
    cells = fit_cell_frame(points, CELL).cells_at(points)
    assert cells.min() >= 0
    assert cells.min(axis=0).max() <= 2


@pytest.mark.parametrize("theta", [-0.6, -0.002, 0.0, 0.3, 0.785])
def test_noise_and_clutter_move_the_grid_by_less_than_a_centimetre(theta: float) -> None:
    rng = np.random.default_rng(3)
    place = Pose(1.7, -3.1, theta)
    exact = place.transform(walls())
    noisy = exact + rng.normal(0.0, 0.015, exact.shape)
    clutter = place.transform(rng.uniform((0.0, 0.0), (WIDTH * CELL, HEIGHT * CELL), (len(exact) // 10, 2)))
    frame = fit_cell_frame(np.vstack([noisy, clutter]), CELL)
    assert edge_distances(frame, exact).max() < 0.01
