"""The static geometry: rectangles, faces and clearance."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from wherry.floorplan.generation import generate_world
from wherry.floorplan.plan import Cell, Direction, FloorPlan, Wall
from wherry.floorplan.world_files import find_world
from wherry.simulation.static_geometry import FREE, OBSTACLE, WALL, StaticGeometry, clearance, distances_to_rectangles

ROOM = StaticGeometry.from_plan(FloorPlan("room", 2, 1, cell_size=1.0))


def test_an_empty_room_has_four_walls_centred_on_its_edges() -> None:
    sides = {tuple(np.round(rectangle, 9)) for rectangle in ROOM.rectangles(WALL)}
    assert sides == {
        (-0.03, -0.03, 2.03, 0.03),
        (-0.03, 0.97, 2.03, 1.03),
        (-0.03, -0.03, 0.03, 1.03),
        (1.97, -0.03, 2.03, 1.03),
    }
    assert len(ROOM.rectangles(OBSTACLE)) == 0


def test_the_visible_faces_of_a_room_are_the_inner_ones() -> None:
    faces = {tuple(np.round(face, 9)) for face in ROOM.surfaces()}
    assert faces == {
        (0.03, 0.03, 0.03, 0.97),
        (1.97, 0.03, 1.97, 0.97),
        (0.03, 0.03, 1.97, 0.03),
        (0.03, 0.97, 1.97, 0.97),
    }


def test_a_wall_extends_half_its_thickness_beyond_its_ends() -> None:
    plan = FloorPlan("plan", 3, 3, cell_size=1.0, walls=frozenset({Wall.between(Cell(1, 1), Direction.EAST)}))
    outer = {
        tuple(rectangle)
        for rectangle in StaticGeometry.from_plan(FloorPlan("plan", 3, 3, cell_size=1.0)).rectangles(WALL)
    }
    (inner,) = [
        rectangle for rectangle in StaticGeometry.from_plan(plan).rectangles(WALL) if tuple(rectangle) not in outer
    ]
    assert_allclose(inner, (1.97, 0.97, 2.03, 2.03))


def test_an_obstacle_fills_its_cell() -> None:
    geometry = StaticGeometry.from_plan(FloorPlan("plan", 3, 3, cell_size=1.0, obstacles=frozenset({Cell(1, 1)})))
    assert_allclose(geometry.rectangles(OBSTACLE), [(1.0, 1.0, 2.0, 2.0)])


def test_distances_to_a_rectangle() -> None:
    square = np.array([[1.0, 1.0, 2.0, 2.0]])
    points = np.array([[1.5, 1.5], [0.0, 1.5], [1.5, 4.0], [5.0, 6.0]])
    assert_allclose(distances_to_rectangles(square, points), [0.0, 1.0, 2.0, 5.0])


@pytest.mark.parametrize("name", ["rooms", "offices", "taxi10"])
def test_rectangles_cover_all_solid_elements_and_nothing_else(name: str) -> None:
    geometry = StaticGeometry.from_plan(find_world(name))
    low, high = (geometry.xs[0], geometry.ys[0]), (geometry.xs[-1], geometry.ys[-1])
    points = np.random.default_rng(0).uniform(low, high, (20_000, 2))
    columns = np.searchsorted(geometry.xs, points[:, 0]) - 1
    rows = np.searchsorted(geometry.ys, points[:, 1]) - 1
    kinds = geometry.kinds[rows, columns]
    for kind in (WALL, OBSTACLE):
        assert_allclose(distances_to_rectangles(geometry.rectangles(kind), points) == 0, kinds == kind)
    assert_allclose(clearance(geometry, points) == 0, kinds != FREE)


@pytest.mark.parametrize("seed", range(3))
def test_in_free_space_clearance_is_the_distance_to_the_nearest_face(seed: int) -> None:
    rng = np.random.default_rng(seed)
    geometry = StaticGeometry.from_plan(generate_world(14, 11, rng))
    points = rng.uniform((0.0, 0.0), (geometry.xs[-1], geometry.ys[-1]), (5_000, 2))
    free = clearance(geometry, points) > 0
    assert free.mean() > 0.6
    assert_allclose(distances_to_rectangles(geometry.surfaces(), points[free]), clearance(geometry, points[free]))


def test_clearance_is_zero_outside_the_building() -> None:
    assert_allclose(clearance(ROOM, np.array([[-5.0, 0.5], [1.0, 9.0], [1.0, 0.5]])), [0.0, 0.0, 0.47])


def test_few_rectangles_cover_a_building() -> None:
    geometry = StaticGeometry.from_plan(find_world("rooms"))
    assert len(geometry.rectangles(WALL)) <= 25
    assert len(geometry.rectangles(OBSTACLE)) <= len(find_world("rooms").obstacles)
