"""Random floor plans, and boxes at random cells."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from wherry.errors import InputError
from wherry.floorplan.plan import DEFAULT_BOX_COUNT, Cell, Direction, FloorPlan, Wall


def place_boxes(plan: FloorPlan, count: int, rng: np.random.Generator) -> FloorPlan:
    """Place boxes in random cells: not in the warehouse, at the start or next to each other, and blocking no path.

    Args:
        plan: A plan with a robot; boxes drawn on it are dropped.
        count: Number of boxes.
        rng: Random generator.

    Raises:
        InputError: The count is negative, or there is no room for that many boxes.
    """
    if count < 0:
        raise InputError(plan.name, "boxes", f"must be 0 or more, not {count}")
    if plan.start is None:
        raise InputError(plan.name, "drawing", "has no robot (one of > ^ < v)")
    taken = set(plan.warehouse) | {plan.start}
    candidates = sorted(set(plan.distances(plan.start)) - taken)
    chosen = set[Cell]()
    for index in rng.permutation(len(candidates)):
        if len(chosen) == count:
            break
        cell = candidates[index]
        if not chosen & set(_surrounding(cell)) and plan.is_passable(chosen | {cell}):
            chosen.add(cell)
    if len(chosen) < count:
        raise InputError(plan.name, "boxes", f"there is room for {len(chosen)} boxes, not for {count}")
    return plan.with_boxes(sorted(chosen, key=lambda cell: (cell.y, cell.x)))


def _surrounding(cell: Cell) -> list[Cell]:
    """The eight cells around a cell."""
    return [Cell(cell.x + dx, cell.y + dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1) if dx or dy]


def generate_world(
    width: int,
    height: int,
    rng: np.random.Generator,
    *,
    name: str = "generated",
    box_count: int = DEFAULT_BOX_COUNT,
    min_room_size: int = 3,
    obstacle_fraction: float = 0.03,
) -> FloorPlan:
    """Generate random rooms with doorways, obstacles, a warehouse and a robot; all open cells are connected.

    Recursive division: a wall with a doorway divides an area into two, which are divided in turn until they are rooms.

    Args:
        width: Number of columns.
        height: Number of rows.
        rng: Random generator.
        name: Name of the world.
        box_count: Number of boxes at random cells in the world.
        min_room_size: Smallest length of a room's side, cells.
        obstacle_fraction: Fraction of the cells that become obstacles, 0 to 0.2.

    Raises:
        InputError: A size, count or fraction is out of range.
    """
    if not 0 <= obstacle_fraction <= 0.2:
        raise InputError(name, "obstacle_fraction", f"must be 0 to 0.2, not {obstacle_fraction}")
    if min_room_size < 1 or width < 3 or height < 3:
        raise InputError(name, "size", "must be at least 3 × 3 cells, with rooms of one cell or more")
    walls = frozenset(_divide(_Rectangle(0, 0, width, height), min_room_size, rng))
    corner = Cell(int(rng.choice([0, width - 2])), int(rng.choice([0, height - 2])))
    warehouse = frozenset(Cell(corner.x + dx, corner.y + dy) for dx in range(2) for dy in range(2))
    floor = FloorPlan(
        name, width, height, walls=walls - _inner_walls(warehouse), warehouse=warehouse, box_count=box_count
    )
    cells = [cell for cell in floor.cells() if cell not in warehouse]
    shuffled = [cells[index] for index in rng.permutation(len(cells))]
    start, heading = shuffled.pop(), list(Direction)[rng.integers(len(Direction))]
    obstacles: set[Cell] = set()
    for cell in shuffled:
        if len(obstacles) < round(obstacle_fraction * len(cells)) and not obstacles & set(_surrounding(cell)):
            obstacles |= {cell} if _can_be_obstacle(floor, cell) else set()
    return replace(floor, start=start, heading=heading, obstacles=frozenset(obstacles))


def _can_be_obstacle(plan: FloorPlan, cell: Cell) -> bool:
    """Whether the neighbours of a cell stay connected through the eight cells around it when it becomes an obstacle."""
    neighbours = [cell.neighbour(direction) for direction in Direction if not plan.is_blocked(cell, direction)]
    surrounding = set(_surrounding(cell))
    return set(neighbours) <= plan.reachable_from(neighbours[:1], lambda _, neighbour: neighbour in surrounding)


@dataclass(frozen=True, slots=True)
class _Rectangle:
    """An area of cells, whose first column is ``left`` and whose first row is ``bottom``."""

    left: int
    bottom: int
    width: int
    height: int


def _divide(area: _Rectangle, smallest: int, rng: np.random.Generator) -> Iterator[Wall]:
    """The walls that divide an area into rooms, each with a doorway of one or two cells."""
    if max(area.width, area.height) < 2 * smallest + 1:
        return
    is_vertical = area.width > area.height if area.width != area.height else bool(rng.integers(2))
    side, length = (area.width, area.height) if is_vertical else (area.height, area.width)
    cut = int(rng.integers(smallest, side - smallest + 1))
    door_width = min(length, int(rng.integers(1, 3)))
    door = int(rng.integers(length - door_width + 1))
    for step in range(length):
        if not door <= step < door + door_width:
            dx, dy = (cut - 1, step) if is_vertical else (step, cut - 1)
            yield Wall(Cell(area.left + dx, area.bottom + dy), north=not is_vertical)
    if is_vertical:
        parts = replace(area, width=cut), replace(area, left=area.left + cut, width=area.width - cut)
    else:
        parts = replace(area, height=cut), replace(area, bottom=area.bottom + cut, height=area.height - cut)
    for part in parts:
        yield from _divide(part, smallest, rng)


def _inner_walls(cells: frozenset[Cell]) -> frozenset[Wall]:
    """The edges between adjacent cells of a set."""
    pairs = ((cell, direction) for cell in cells for direction in (Direction.NORTH, Direction.EAST))
    return frozenset(Wall.between(cell, direction) for cell, direction in pairs if cell.neighbour(direction) in cells)
