"""Floor plans: cells, walls, reachability, random boxes and random worlds."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.floorplan.generation import generate_world, place_boxes
from wherry.floorplan.plan import Cell, Direction, FloorPlan, Wall
from wherry.floorplan.world_files import parse_world

CORRIDOR = FloorPlan("corridor", 7, 1, start=Cell(0, 0), warehouse=frozenset({Cell(6, 0)}))


@pytest.mark.parametrize("direction", Direction)
def test_wall_is_the_same_from_both_its_sides(direction: Direction) -> None:
    cell = Cell(3, 5)
    assert Wall.between(cell, direction) == Wall.between(cell.neighbour(direction), direction.opposite)


def test_edges_walls_and_obstacles_block_steps() -> None:
    plan = FloorPlan(
        "plan", 2, 2, walls=frozenset({Wall.between(Cell(0, 0), Direction.EAST)}), obstacles=frozenset({Cell(0, 1)})
    )
    blocked = {direction for direction in Direction if plan.is_blocked(Cell(0, 0), direction)}
    assert blocked == set(Direction)
    assert {direction for direction in Direction if not plan.is_blocked(Cell(1, 0), direction)} == {Direction.NORTH}
    assert not plan.is_connected()


def test_distances_are_along_paths_around_walls() -> None:
    plan = FloorPlan("plan", 3, 2, walls=frozenset({Wall.between(Cell(0, 0), Direction.EAST)}))
    assert plan.distances(Cell(0, 0))[Cell(1, 0)] == 3
    assert Cell(1, 0) not in plan.distances(Cell(0, 0), avoid=[Cell(0, 1)])


def test_plan_can_be_pickled() -> None:
    plan = FloorPlan("plan", 2, 2, marks={"R": Cell(1, 1)})
    assert pickle.loads(pickle.dumps(plan)) == plan  # noqa: S301
    assert hash(plan) == hash(pickle.loads(pickle.dumps(plan)))  # noqa: S301


def test_boxes_that_can_be_delivered_in_some_order_are_reachable() -> None:
    # The box at 2 can be delivered only after the one at 4, which the robot reaches through 2 with an empty fork.
    plan = CORRIDOR.with_boxes([Cell(2, 0), Cell(4, 0)])
    assert plan.reachable_boxes() == plan.boxes
    assert plan.unreachable_boxes() == ()


def test_two_adjacent_boxes_block_a_corridor() -> None:
    # With the first box in the fork the robot cannot enter the cell of the second.
    plan = CORRIDOR.with_boxes([Cell(2, 0), Cell(3, 0)])
    assert plan.reachable_boxes() == ()


def test_only_a_walled_in_box_is_unreachable() -> None:
    walls = {Wall.between(Cell(1, 1), direction) for direction in Direction}
    plan = FloorPlan(
        "plan",
        4,
        3,
        walls=frozenset(walls),
        start=Cell(0, 0),
        warehouse=frozenset({Cell(3, 0)}),
        boxes=(Cell(1, 1), Cell(3, 2)),
    )
    assert plan.reachable_boxes() == (Cell(3, 2),)
    assert plan.unreachable_boxes() == (Cell(1, 1),)


def test_no_box_is_reachable_if_the_warehouse_is_not() -> None:
    plan = FloorPlan(
        "plan",
        3,
        1,
        walls=frozenset({Wall.between(Cell(1, 0), Direction.EAST)}),
        start=Cell(0, 0),
        warehouse=frozenset({Cell(2, 0)}),
        boxes=(Cell(1, 0),),
    )
    assert plan.unreachable_boxes() == (Cell(1, 0),)


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"width": 0}, "width"),
        ({"height": 1_001}, "height"),
        ({"cell_size": 0.2}, "cell"),
        ({"cell_size": float("nan")}, "cell"),
        ({"box_count": -1}, "boxes"),
        ({"name": " "}, "name"),
        ({"name": "two\nlines"}, "name"),
        ({"boxes": (Cell(1, 1), Cell(1, 1))}, "box"),
        ({"boxes": (Cell(9, 1),)}, "box"),
        ({"boxes": (Cell(2, 2),)}, "box"),
        ({"boxes": (Cell(0, 2),)}, "box"),
        ({"boxes": (Cell(0, 0),)}, "box"),
        ({"start": Cell(2, 2)}, "robot"),
        ({"warehouse": frozenset({Cell(-1, 0)})}, "warehouse"),
        ({"walls": frozenset({Wall(Cell(2, 0), north=False)})}, "wall"),
        ({"marks": {"r": Cell(0, 0)}}, "mark"),
        ({"marks": {"R": Cell(1, 1), "G": Cell(1, 1)}}, "mark"),
    ],
)
def test_invalid_plan_is_refused_with_its_field(changes: dict[str, object], field: str) -> None:
    valid: dict[str, object] = {
        "name": "plan",
        "width": 3,
        "height": 3,
        "start": Cell(0, 0),
        "warehouse": frozenset({Cell(0, 2)}),
        "obstacles": frozenset({Cell(2, 2)}),
    }
    FloorPlan(**valid)  # type: ignore[arg-type]
    with pytest.raises(InputError) as error:
        FloorPlan(**{**valid, **changes})  # type: ignore[arg-type]
    assert error.value.field == field


@pytest.mark.parametrize("seed", range(5))
def test_random_boxes_are_apart_and_reachable(seed: int) -> None:
    world = generate_world(12, 10, np.random.default_rng(seed))
    plan = place_boxes(world, 6, np.random.default_rng(seed))
    assert len(plan.boxes) == 6
    assert not set(plan.boxes) & (plan.warehouse | {plan.start})
    for first in plan.boxes:
        assert all(max(abs(first.x - box.x), abs(first.y - box.y)) > 1 for box in plan.boxes if box != first)
    assert plan.is_passable(set(plan.boxes))
    assert plan.reachable_boxes() == plan.boxes
    assert plan == place_boxes(world, 6, np.random.default_rng(seed))


def test_random_boxes_never_block_a_corridor() -> None:
    with pytest.raises(InputError, match="room for 0 boxes, not for 1"):
        place_boxes(CORRIDOR, 1, np.random.default_rng(0))


def test_number_of_boxes_out_of_range_is_refused() -> None:
    world = generate_world(6, 6, np.random.default_rng(0))
    with pytest.raises(InputError, match="not for 100"):
        place_boxes(world, 100, np.random.default_rng(0))
    with pytest.raises(InputError, match="0 or more, not -1"):
        place_boxes(world, -1, np.random.default_rng(0))
    with pytest.raises(InputError, match="no robot"):
        place_boxes(FloorPlan("plan", 3, 3), 1, np.random.default_rng(0))


@pytest.mark.parametrize(("width", "height"), [(3, 3), (8, 6), (17, 17), (40, 12), (5, 31)])
@pytest.mark.parametrize("seed", range(4))
def test_random_world_is_connected(width: int, height: int, seed: int) -> None:
    plan = generate_world(width, height, np.random.default_rng(seed), obstacle_fraction=0.08)
    assert (plan.width, plan.height) == (width, height)
    assert plan.is_connected()
    assert len(plan.warehouse) == 4
    assert plan.start is not None
    assert plan.start not in plan.warehouse | plan.obstacles
    assert plan == generate_world(width, height, np.random.default_rng(seed), obstacle_fraction=0.08)


def test_random_world_has_walls_and_obstacles() -> None:
    plan = generate_world(17, 17, np.random.default_rng(0))
    assert len(plan.walls) > 60
    assert len(plan.obstacles) == round(0.03 * (17 * 17 - 4))
    assert plan != generate_world(17, 17, np.random.default_rng(1))


@pytest.mark.parametrize(
    "arguments", [{"width": 2}, {"height": 5_000}, {"obstacle_fraction": 0.9}, {"min_room_size": 0}]
)
def test_random_world_with_a_size_out_of_range_is_refused(arguments: dict[str, float]) -> None:
    with pytest.raises(InputError):
        generate_world(**{"width": 9, "height": 9, "rng": np.random.default_rng(0), **arguments})  # type: ignore[arg-type]


def test_robots_and_boxes_can_be_on_marks() -> None:
    plan = parse_world(
        "wherry-world: 1\nname: marks\n\n+---+---+---+\n|>R |oG | wB|\n+---+---+---+\n", source="marks.txt"
    )
    assert plan.marks == {"R": plan.start, "G": plan.boxes[0], "B": Cell(2, 0)}
