"""The perfect maps that other tests use are correct."""

from __future__ import annotations

import numpy as np
import pytest

from wherry.floorplan.world_files import built_in_worlds, find_world
from wherry.simulation.static_geometry import StaticGeometry
from wherry.space.frame import fit_cell_frame
from wherry.space.pose import Pose
from wherry_testing.perfect_worlds import is_solid, perfect_map


@pytest.mark.parametrize("name", built_in_worlds())
@pytest.mark.parametrize("theta", [0.0, 0.35, -0.7])
def test_the_cell_frame_fitted_to_a_perfect_map_is_that_of_the_plan(name: str, theta: float) -> None:
    plan = find_world(name)
    map_from_world = Pose(-2.03, 1.41, theta)
    frame = fit_cell_frame(perfect_map(plan, map_from_world).occupied_points(), plan.cell_size)
    corners = np.array([[x, y] for x in range(plan.width + 1) for y in range(plan.height + 1)]) * plan.cell_size
    local = frame.origin.inverse.transform(map_from_world.transform(corners)) / plan.cell_size
    assert np.abs(local - np.round(local)).max() * plan.cell_size < 0.03  # half a wall's thickness


def test_the_walls_of_a_perfect_map_are_solid() -> None:
    plan = find_world("small")
    grid = perfect_map(plan)
    assert is_solid(StaticGeometry.from_plan(plan), grid.occupied_points()).all()
    assert grid.free.sum() * grid.resolution**2 == pytest.approx(45 * 0.36, rel=0.12)
