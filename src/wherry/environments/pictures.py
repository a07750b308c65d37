"""Rendering of grid worlds: a floor plan with sprites, as text or as an RGB image."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from wherry.floorplan.drawing import draw_plan
from wherry.floorplan.plan import Cell, Direction, FloorPlan

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
    """An object drawn in a cell.

    Attributes:
        cell: The cell.
        letter: Its symbol in text.
        colour: Its RGB colour in images.
        size: Its width as a fraction of the cell's.
        round: Whether it is a disc; otherwise it is a square.
    """

    cell: Cell
    letter: str
    colour: Colour
    size: float
    round: bool = True


def render_text(plan: FloorPlan, sprites: Iterable[Sprite]) -> str:
    """Draw a plan with sprites as text; a cell shows at most three letters, those of sprites first."""
    letters: dict[Cell, str] = {}
    for sprite in sprites:
        letters[sprite.cell] = letters.get(sprite.cell, "") + sprite.letter
    for mark, cell in plan.marks.items():
        letters[cell] = letters.get(cell, "") + mark
    for cell in plan.warehouse:
        letters[cell] = letters.get(cell, "") + "w"
    letters |= dict.fromkeys(plan.obstacles, "###")
    return draw_plan(plan, lambda cell: letters.get(cell, "")[:3])


def render_rgb(plan: FloorPlan, sprites: Iterable[Sprite]) -> NDArray[np.uint8]:
    """Draw a plan with sprites as an image; the last sprite is on top.

    Returns:
        [48·height, 48·width, 3] RGB; row 0 is the northernmost.
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
            if plan.is_blocked(cell, direction):
                draw.line(_edge(plan, cell, direction), fill=WALL, width=WALL_PIXELS)
    for sprite in sprites:
        shape = draw.ellipse if sprite.round else draw.rectangle
        shape(_box(plan, sprite.cell, sprite.size), fill=sprite.colour, outline=WALL)
    return np.array(image)


def _box(plan: FloorPlan, cell: Cell, size: float) -> tuple[float, float, float, float]:
    """Left, top, right and bottom of a square centred in a cell, pixels; its size is a fraction of the cell's."""
    x, y, half = (cell.x + 0.5) * CELL_PIXELS, (plan.height - cell.y - 0.5) * CELL_PIXELS, size * CELL_PIXELS / 2
    return x - half, y - half, x + half, y + half


def _edge(plan: FloorPlan, cell: Cell, direction: Direction) -> tuple[float, float, float, float]:
    """The two ends of a cell's edge, pixels."""
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
