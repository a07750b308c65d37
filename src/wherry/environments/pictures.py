"""Grid worlds as pictures: the floor plan, and sprites standing on it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from wherry.floorplan.plan import Cell, Direction, FloorPlan
from wherry.floorplan.world_files import drawing

CELL_PIXELS = 48
WALL_PIXELS = 4

Colour = tuple[int, int, int]

FLOOR: Colour = (245, 245, 240)
GRID: Colour = (222, 222, 215)
WALL: Colour = (40, 42, 54)
WAREHOUSE: Colour = (249, 226, 150)
MARK: Colour = (120, 120, 130)


@dataclass(frozen=True, slots=True)
class Sprite:
    """Something that stands in a cell.

    Attributes:
        cell: Where.
        letter: How it is written in text.
        colour: How it is painted.
        size: Its width as a share of the cell's.
        round: Whether it is a disc; else it is a square.
    """

    cell: Cell
    letter: str
    colour: Colour
    size: float
    round: bool = True


def render_text(plan: FloorPlan, sprites: Iterable[Sprite]) -> str:
    """Draw a plan with sprites as text; in a cell stand at most three letters, sprites before the plan's own."""
    letters: dict[Cell, str] = {}
    for sprite in sprites:
        letters[sprite.cell] = letters.get(sprite.cell, "") + sprite.letter
    for mark, cell in plan.marks.items():
        letters[cell] = letters.get(cell, "") + mark
    for cell in plan.warehouse:
        letters[cell] = letters.get(cell, "") + "w"
    letters |= dict.fromkeys(plan.obstacles, "###")
    return drawing(plan, lambda cell: letters.get(cell, "")[:3])


def render_rgb(plan: FloorPlan, sprites: Iterable[Sprite]) -> NDArray[np.uint8]:
    """Paint a plan with sprites on it, the last one on top.

    Returns:
        [48·height, 48·width, 3] RGB, row 0 in the north.
    """
    image = Image.new("RGB", (plan.width * CELL_PIXELS, plan.height * CELL_PIXELS), FLOOR)
    draw = ImageDraw.Draw(image)
    marks = {cell: mark for mark, cell in plan.marks.items()}
    every = [Cell(x, y) for y in range(plan.height) for x in range(plan.width)]
    for cell in every:
        filled = WALL if cell in plan.obstacles else WAREHOUSE if cell in plan.warehouse else FLOOR
        draw.rectangle(_box(plan, cell, 1.0), fill=filled, outline=GRID)
        if cell in marks:
            left, top, *_ = _box(plan, cell, 0.8)
            draw.text((left, top), marks[cell], fill=MARK)
    for cell in every:
        for direction in Direction:
            if plan.blocked(cell, direction):
                draw.line(_edge(plan, cell, direction), fill=WALL, width=WALL_PIXELS)
    for sprite in sprites:
        shape = draw.ellipse if sprite.round else draw.rectangle
        shape(_box(plan, sprite.cell, sprite.size), fill=sprite.colour, outline=WALL)
    return np.array(image)


def _box(plan: FloorPlan, cell: Cell, size: float) -> tuple[float, float, float, float]:
    """Left, top, right, bottom pixels of a square in the middle of a cell."""
    x, y, half = (cell.x + 0.5) * CELL_PIXELS, (plan.height - cell.y - 0.5) * CELL_PIXELS, size * CELL_PIXELS / 2
    return x - half, y - half, x + half, y + half


def _edge(plan: FloorPlan, cell: Cell, direction: Direction) -> tuple[float, float, float, float]:
    """Both ends of a cell's edge, pixels."""
    left, top, right, bottom = _box(plan, cell, 1.0)
    match direction:
        case Direction.NORTH:
            return left, top, right, top
        case Direction.SOUTH:
            return left, bottom, right, bottom
        case Direction.EAST:
            return right, top, right, bottom
        case Direction.WEST:
            return left, top, left, bottom
