"""The class of walls that the grid domains share, and walls of a floor plan as its objects."""

from __future__ import annotations

from collections.abc import Iterable

from wherry.floorplan.plan import Wall
from wherry.oomdp.attributes import boolean, integer
from wherry.oomdp.objects import Object, ObjectClass

WALL = ObjectClass("Wall", (integer("x"), integer("y"), boolean("north")), static=True)
"""A wall on the north edge of cell (x, y), or else on its east edge."""


def wall_objects(walls: Iterable[Wall]) -> tuple[Object, ...]:
    """The walls as static objects, sorted, and named ``wall0``, ``wall1`` and so on; duplicates are dropped."""
    return tuple(
        WALL(f"wall{index}", x=wall.cell.x, y=wall.cell.y, north=wall.north)
        for index, wall in enumerate(sorted(set(walls)))
    )
