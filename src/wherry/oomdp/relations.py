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
        keys: Keys of the first and the second object that are equal exactly if the relation holds, so that a relation
            to static objects can be looked up in an index; None where there are no such keys.
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
    """The cell edge of a wall with attributes x, y, north: the cell's north edge, otherwise its east edge."""
    return wall.x, wall.y, wall.north


def _step(dx: int, dy: int) -> ObjectKey:
    return lambda item: (item.x + dx, item.y + dy)


def _edge(dx: int, dy: int) -> ObjectKey:
    west, south, north = min(dx, 0), min(dy, 0), dy != 0
    return lambda item: (item.x + west, item.y + south, north)


ON = Relation.where_equal("on", cell_of, cell_of)
"""Both objects are in the same cell."""

TOUCH = {name: Relation.where_equal(f"touch_{name}", _step(*step), cell_of) for name, step in DIRECTIONS.items()}
"""The second object is exactly one cell north, south, east or west of the first."""

TOUCH_EDGE = {name: Relation.where_equal(f"touch_{name}", _edge(*step), wall_edge) for name, step in DIRECTIONS.items()}
"""The second object is a wall on the north, south, east or west edge of the first object's cell."""
