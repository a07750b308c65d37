"""Relations between two objects: touch_N, touch_S, touch_E, touch_W and on (paper, section 3)."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass

from wherry.oomdp.objects import Object, ObjectKey

DIRECTIONS = {"N": (0, 1), "S": (0, -1), "E": (1, 0), "W": (-1, 0)}
"""Steps (dx, dy), cells; x points east and y north."""


@dataclass(frozen=True)
class Relation:
    """A relation between an object of one class and an object of another.

    Attributes:
        name: Its name.
        holds: Returns whether it holds between two objects.
        keys: Keys of the first and of the second object that are equal exactly if the relation holds, with which static
            objects are looked up in an index; None if the relation has no such keys.
    """

    name: str
    holds: Callable[[Object, Object], bool]
    keys: tuple[ObjectKey, ObjectKey] | None = None

    @classmethod
    def where_equal(cls, name: str, first: ObjectKey, second: ObjectKey) -> Relation:
        """The relation that holds if the first object's key equals the second's."""
        return cls(name, lambda a, b: first(a) == second(b), (first, second))


def cell_of(item: Object) -> Hashable:
    """The cell that an object is in."""
    return item.x, item.y


def wall_edge(wall: Object) -> Hashable:
    """The cell edge (x, y, is north) on which a wall is: the north edge of cell (x, y), or else its east edge."""
    return wall.x, wall.y, wall.north


def _neighbour_cell(dx: int, dy: int) -> ObjectKey:
    """The key that is the cell one step from an object's cell."""
    return lambda item: (item.x + dx, item.y + dy)


def _crossed_edge(dx: int, dy: int) -> ObjectKey:
    """The key that is the edge which a step from an object's cell crosses, in the form of `wall_edge`."""
    column_offset, row_offset, is_north_edge = min(dx, 0), min(dy, 0), dy != 0
    return lambda item: (item.x + column_offset, item.y + row_offset, is_north_edge)


ON = Relation.where_equal("on", cell_of, cell_of)
"""Both objects are in the same cell."""

TOUCH = {
    name: Relation.where_equal(f"touch_{name}", _neighbour_cell(*step), cell_of) for name, step in DIRECTIONS.items()
}
"""The second object is exactly one cell north, south, east or west of the first."""

TOUCH_EDGE = {
    name: Relation.where_equal(f"touch_{name}", _crossed_edge(*step), wall_edge) for name, step in DIRECTIONS.items()
}
"""The second object is a wall on the north, south, east or west edge of the first object's cell."""
