"""Ray casting against distances in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wherry.space.pose import Pose
from wherry.space.raycast import cast_rays

ROOM = np.pad(np.zeros((60, 100), np.bool_), 1, constant_values=True)  # 100 × 60 free cells surrounded by walls
RESOLUTION = 0.05


@given(
    x=st.floats(0.06, 5.04), y=st.floats(0.06, 3.04), heading=st.floats(-4.0, 4.0), angle=st.floats(-math.pi, math.pi)
)
def test_a_ray_ends_exactly_at_the_wall(x: float, y: float, heading: float, angle: float) -> None:
    found = cast_rays(ROOM, RESOLUTION, Pose(), np.array([[x, y, heading]]), np.array([angle]), 20.0)[0, 0]
    dx, dy = math.cos(heading + angle), math.sin(heading + angle)
    to_x = (((5.05 if dx > 0 else 0.05) - x) / dx) if dx != 0 else math.inf
    to_y = (((3.05 if dy > 0 else 0.05) - y) / dy) if dy != 0 else math.inf
    assert found == pytest.approx(min(to_x, to_y), abs=1e-9)


def test_ranges_do_not_depend_on_the_origin_of_the_grid() -> None:
    origin = Pose(3.0, -2.0, 0.7)
    inside = Pose(1.0, 1.5, 0.3)
    angles = np.linspace(-math.pi, math.pi, 50)
    here = cast_rays(ROOM, RESOLUTION, Pose(), inside.as_array()[None], angles, 20.0)
    there = cast_rays(ROOM, RESOLUTION, origin, (origin @ inside).as_array()[None], angles, 20.0)
    np.testing.assert_allclose(here, there, atol=1e-9)


def test_a_ray_without_a_hit_is_infinite() -> None:
    open_field = np.zeros((10, 10), np.bool_)
    angles = np.linspace(-math.pi, math.pi, 9)
    assert np.isinf(cast_rays(open_field, 1.0, Pose(), np.array([[5.0, 5.0, 0.0]]), angles, 30.0)).all()
    assert np.isinf(cast_rays(ROOM, RESOLUTION, Pose(), np.array([[1.0, 1.0, 0.0]]), np.array([0.0]), 4.0)).all()


def test_a_ray_from_outside_enters_the_grid() -> None:
    found = cast_rays(ROOM, RESOLUTION, Pose(), np.array([[-1.0, 1.0, 0.0], [-1.0, 1.0, math.pi]]), np.zeros(1), 20.0)
    np.testing.assert_allclose(found[:, 0], [1.0, math.inf])


def test_a_ray_that_starts_in_a_wall_has_length_zero() -> None:
    assert cast_rays(ROOM, RESOLUTION, Pose(), np.array([[0.01, 1.0, 0.3]]), np.zeros(1), 20.0)[0, 0] == 0.0
