"""Occupancy grid mapping: exact cells, then a room scanned from several poses."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wherry.space.mapper import GridMapper
from wherry.space.pose import Pose
from wherry.space.raycast import cast_rays


def test_a_beam_frees_the_cells_it_crosses_and_hits_the_one_it_ends_in() -> None:
    mapper = GridMapper(0.1)
    mapper.add(np.array([0.05, 0.05]), np.array([[0.55, 0.05]]), np.array([True]))
    grid = mapper.grid()
    cells = grid.cells_at(np.array([[x, 0.05] for x in (0.05, 0.15, 0.25, 0.35, 0.45, 0.55, 0.65)]))
    values = grid.probability[cells[:, 0], cells[:, 1]]
    np.testing.assert_allclose(values, [0.18] * 5 + [0.95, 0.5], atol=1e-6)
    assert np.count_nonzero(grid.probability != 0.5) == 6


def test_a_beam_without_a_hit_frees_all_its_cells() -> None:
    mapper = GridMapper(0.1)
    mapper.add(np.array([0.05, 0.05]), np.array([[-0.45, 0.05]]), np.array([False]))
    assert not mapper.grid().occupied.any()
    assert (mapper.grid().probability < 0.5).sum() == 6  # including the cell that it ends in


def test_a_cell_is_updated_once_per_scan_and_hits_take_precedence() -> None:
    mapper = GridMapper(0.1)
    ends = np.array([[0.55, 0.05], [0.55, 0.05], [0.95, 0.05]])
    mapper.add(np.array([0.05, 0.05]), ends, np.ones(3, np.bool_))
    grid = mapper.grid()
    row, column = grid.cells_at(np.array([[0.55, 0.05]]))[0]
    assert grid.probability[row, column] == pytest.approx(0.95, abs=1e-6)


def test_memory_grows_with_the_touched_tiles_only() -> None:
    mapper = GridMapper(0.05)
    for x in (0.0, 300.0):
        mapper.add(np.array([x, 0.0]), np.array([[x + 1.0, x], [x + 1.0, x + 1.0]]), np.ones(2, np.bool_))
    along_the_diagonal = 300 / 0.05 / 64
    assert mapper.tile_count < 3 * along_the_diagonal  # far fewer than the tiles of the square around it


def test_a_map_without_scans_is_unknown() -> None:
    assert GridMapper(0.05).grid().unknown.all()


def test_the_walls_of_a_scanned_room_are_mapped_exactly() -> None:
    room = np.pad(np.zeros((60, 100), np.bool_), 1, constant_values=True)
    mapper = GridMapper(0.05)
    angles = np.linspace(-math.pi, math.pi, 720, endpoint=False)
    for x, y in ((1.0, 1.0), (2.0, 1.5), (4.0, 2.0), (3.5, 1.0)):
        ranges = cast_rays(room, 0.05, Pose(), np.array([[x, y, 0.0]]), angles, 20.0)[0] + 0.001  # in the wall
        mapper.add(
            np.array([x, y]),
            np.array([x, y]) + ranges[:, None] * np.column_stack([np.cos(angles), np.sin(angles)]),
            np.ones(720, np.bool_),
        )
    grid = mapper.grid()
    occupied = grid.occupied_points()
    inside = (occupied > 0.05).all(axis=1) & (occupied[:, 0] < 5.05) & (occupied[:, 1] < 3.05)
    assert not inside.any()
    assert len(occupied) > 300
    assert grid.free.sum() == pytest.approx(6000, rel=0.01)
