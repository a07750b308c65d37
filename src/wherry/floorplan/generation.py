"""Random floor plans, and boxes at random places."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from wherry.errors import InputError
from wherry.floorplan.plan import DEFAULT_BOX_COUNT, Cell, Direction, FloorPlan, Wall


def place_boxes(plan: FloorPlan, count: int, rng: np.random.Generator) -> FloorPlan:
    """Put boxes on random cells: none in the warehouse, at the start, next to each other, or in the only way.

    Args:
        plan: A plan with a robot; boxes drawn on it are dropped.
        count: How many.
        rng: Where the randomness comes from.

    Raises:
        InputError: The count is negative, or there is no room for so many.
    """
    if count < 0:
        raise InputError(plan.name, "boxes", f"must be 0 or more, not {count}")
    if plan.start is None:
        raise InputError(plan.name, "drawing", "has no robot (one of > ^ < v)")
    taken = set(plan.warehouse) | {plan.start}
    candidates = sorted(set(plan.distances(plan.start)) - taken)
    chosen: set[Cell] = set()
    for index in rng.permutation(len(candidates)):
        if len(chosen) == count:
            break
        cell = candidates[index]
        if not chosen & set(_around(cell)) and plan.is_passable(chosen | {cell}):
            chosen.add(cell)
    if len(chosen) < count:
        raise InputError(plan.name, "boxes", f"there is room for {len(chosen)} boxes, not for {count}")
    return plan.with_boxes(sorted(chosen, key=lambda cell: (cell.y, cell.x)))


def _around(cell: Cell) -> list[Cell]:
    """The eight cells around one."""
    return [Cell(cell.x + dx, cell.y + dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1) if dx or dy]


def generate_world(
    width: int,
    height: int,
    rng: np.random.Generator,
    *,
    name: str = "generated",
    box_count: int = DEFAULT_BOX_COUNT,
    smallest_room: int = 3,
    obstacle_share: float = 0.03,
) -> FloorPlan:
    """Draw up random rooms with doorways, obstacles, a warehouse and a robot; all open cells are connected.

    A wall with a doorway cuts the plan in two, and so on for each part (recursive division), until the parts are rooms.

    Args:
        width: Cells.
        height: Cells.
        rng: Where the randomness comes from.
        name: What to call the world.
        box_count: How many boxes are to be placed.
        smallest_room: Cells along a room's shorter side, at least.
        obstacle_share: How much of the floor to fill.

    Raises:
        InputError: The sizes or counts make no sense.
    """
    if not 0 <= obstacle_share <= 0.2:
        raise InputError(name, "obstacle share", f"must be 0 to 0.2, not {obstacle_share}")
    if smallest_room < 1 or width < 3 or height < 3:
        raise InputError(name, "size", "must be at least 3 × 3 cells, with rooms of one cell or more")
    walls = frozenset(_divide(_Rectangle(0, 0, width, height), smallest_room, rng))
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
        if len(obstacles) < round(obstacle_share * len(cells)) and not obstacles & set(_around(cell)):
            obstacles |= {cell} if _can_be_filled(floor, cell) else set()
    return replace(floor, start=start, heading=heading, obstacles=frozenset(obstacles))


def _can_be_filled(plan: FloorPlan, cell: Cell) -> bool:
    """Whether the ways through a cell can go round it through the eight cells around it."""
    ways = [cell.towards(direction) for direction in Direction if not plan.blocked(cell, direction)]
    around = set(_around(cell))
    return set(ways) <= plan.reach(ways[:1], lambda _, neighbour: neighbour in around)


@dataclass(frozen=True, slots=True)
class _Rectangle:
    """Cells from ``left`` and ``bottom`` on."""

    left: int
    bottom: int
    width: int
    height: int


def _divide(area: _Rectangle, smallest: int, rng: np.random.Generator) -> Iterator[Wall]:
    """The walls that cut an area into rooms, each with a doorway of one or two cells."""
    if max(area.width, area.height) < 2 * smallest + 1:
        return
    upright = area.width > area.height if area.width != area.height else bool(rng.integers(2))
    side, length = (area.width, area.height) if upright else (area.height, area.width)
    cut = int(rng.integers(smallest, side - smallest + 1))
    door_width = min(length, int(rng.integers(1, 3)))
    door = int(rng.integers(length - door_width + 1))
    for step in range(length):
        if not door <= step < door + door_width:
            dx, dy = (cut - 1, step) if upright else (step, cut - 1)
            yield Wall(Cell(area.left + dx, area.bottom + dy), north=not upright)
    if upright:
        parts = replace(area, width=cut), replace(area, left=area.left + cut, width=area.width - cut)
    else:
        parts = replace(area, height=cut), replace(area, bottom=area.bottom + cut, height=area.height - cut)
    for part in parts:
        yield from _divide(part, smallest, rng)


def _inner_walls(cells: frozenset[Cell]) -> frozenset[Wall]:
    """The edges between neighbouring cells of a set."""
    pairs = ((cell, direction) for cell in cells for direction in (Direction.NORTH, Direction.EAST))
    return frozenset(Wall.between(cell, direction) for cell, direction in pairs if cell.towards(direction) in cells)
