"""Rendering of grid worlds: a floor plan with sprites, as text or as an RGB image."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from wherry.floorplan.drawing import draw_plan
from wherry.floorplan.plan import Cell, Direction, FloorPlan

CELL_PIXELS = 48  # side of a cell
WALL_PIXELS = 4  # thickness of a wall

Colour = tuple[int, int, int]
"""Red, green and blue, 0 to 255."""

FLOOR_COLOUR: Colour = (245, 245, 240)
GRID_COLOUR: Colour = (222, 222, 215)
WALL_COLOUR: Colour = (40, 42, 54)
WAREHOUSE_COLOUR: Colour = (249, 226, 150)
MARK_COLOUR: Colour = (120, 120, 130)


@dataclass(frozen=True, slots=True)
class Sprite:
    """An object drawn in a cell.

    Attributes:
        cell: The cell.
        letter: Its character in text.
        colour: Its RGB colour in images.
        size: Its width as a fraction of the width of the cell.
        is_disc: Whether it is drawn as a disc; otherwise as a square.
    """

    cell: Cell
    letter: str
    colour: Colour
    size: float
    is_disc: bool = True


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
    image = Image.new("RGB", (plan.width * CELL_PIXELS, plan.height * CELL_PIXELS), FLOOR_COLOUR)
    draw = ImageDraw.Draw(image)
    marks = {cell: mark for mark, cell in plan.marks.items()}
    cells = [Cell(x, y) for y in range(plan.height) for x in range(plan.width)]
    for cell in cells:
        fill = WALL_COLOUR if cell in plan.obstacles else WAREHOUSE_COLOUR if cell in plan.warehouse else FLOOR_COLOUR
        draw.rectangle(_square(plan, cell, 1.0), fill=fill, outline=GRID_COLOUR)
        if cell in marks:
            left, top, *_ = _square(plan, cell, 0.8)
            draw.text((left, top), marks[cell], fill=MARK_COLOUR)
    for cell in cells:
        for direction in Direction:
            if plan.is_blocked(cell, direction):
                draw.line(_edge(plan, cell, direction), fill=WALL_COLOUR, width=WALL_PIXELS)
    for sprite in sprites:
        shape = draw.ellipse if sprite.is_disc else draw.rectangle
        shape(_square(plan, sprite.cell, sprite.size), fill=sprite.colour, outline=WALL_COLOUR)
    return np.array(image)


def _square(plan: FloorPlan, cell: Cell, size: float) -> tuple[float, float, float, float]:
    """Left, top, right and bottom, pixels, of a square in the centre of a cell; size is a fraction of the cell's."""
    x, y, half = (cell.x + 0.5) * CELL_PIXELS, (plan.height - cell.y - 0.5) * CELL_PIXELS, size * CELL_PIXELS / 2
    return x - half, y - half, x + half, y + half


def _edge(plan: FloorPlan, cell: Cell, direction: Direction) -> tuple[float, float, float, float]:
    """The two ends of a cell's edge, pixels."""
    left, top, right, bottom = _square(plan, cell, 1.0)
    match direction:
        case Direction.NORTH:
            return left, top, right, top
        case Direction.SOUTH:
            return left, bottom, right, bottom
        case Direction.EAST:
            return right, top, right, bottom
        case Direction.WEST:
            return left, top, left, bottom
