"""Scans into log-odds: exact cells first, then a room seen from many places."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wherry.space.mapper import GridMapper
from wherry.space.pose import Pose
from wherry.space.raycast import cast_rays


def test_one_beam_frees_what_it_crosses_and_fills_where_it_ends() -> None:
    mapper = GridMapper(0.1)
    mapper.add(np.array([0.05, 0.05]), np.array([[0.55, 0.05]]), np.array([True]))
    grid = mapper.grid()
    cells = grid.cells_at(np.array([[x, 0.05] for x in (0.05, 0.15, 0.25, 0.35, 0.45, 0.55, 0.65)]))
    values = grid.probability[cells[:, 0], cells[:, 1]]
    np.testing.assert_allclose(values, [0.18] * 5 + [0.95, 0.5], atol=1e-6)
    assert np.count_nonzero(grid.probability != 0.5) == 6


def test_a_beam_without_a_hit_frees_only() -> None:
    mapper = GridMapper(0.1)
    mapper.add(np.array([0.05, 0.05]), np.array([[-0.45, 0.05]]), np.array([False]))
    assert not mapper.grid().occupied.any()
    assert (mapper.grid().probability < 0.5).sum() == 6  # the cell that it ends in too


def test_a_cell_is_observed_once_a_scan_and_hits_come_first() -> None:
    mapper = GridMapper(0.1)
    ends = np.array([[0.55, 0.05], [0.55, 0.05], [0.95, 0.05]])
    mapper.add(np.array([0.05, 0.05]), ends, np.ones(3, np.bool_))
    grid = mapper.grid()
    row, column = grid.cells_at(np.array([[0.55, 0.05]]))[0]
    assert grid.probability[row, column] == pytest.approx(0.95, abs=1e-6)


def test_far_apart_scans_cost_only_what_they_touch() -> None:
    mapper = GridMapper(0.05)
    for x in (0.0, 300.0):
        mapper.add(np.array([x, 0.0]), np.array([[x + 1.0, x], [x + 1.0, x + 1.0]]), np.ones(2, np.bool_))
    assert mapper.tile_count < 3 * (300 / 0.05 / 64)  # the long diagonal beams, not the square between them


def test_nothing_added_is_nothing_known() -> None:
    assert GridMapper(0.05).grid().unknown.all()


def test_a_room_seen_from_inside_has_its_walls_where_they_are() -> None:
    room = np.pad(np.zeros((60, 100), np.bool_), 1, constant_values=True)
    mapper = GridMapper(0.05)
    angles = np.linspace(-math.pi, math.pi, 720, endpoint=False)
    for x, y in ((1.0, 1.0), (2.0, 1.5), (4.0, 2.0), (3.5, 1.0)):
        ranges = cast_rays(room, 0.05, Pose(), np.array([[x, y, 0.0]]), angles, 20.0)[0] + 0.001  # just into the wall
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
