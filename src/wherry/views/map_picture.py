"""Pictures of occupancy grids with trajectories, points and a legend drawn on them."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats

Colour = tuple[int, int, int]

MIN_WIDTH = 480  # pixels, smallest width of an enlarged map and of a legend
MIN_TEXT_SIZE = 14  # pixels, height of the legend's text
SCALE_BARS = (1, 2, 5, 10, 20, 50, 100)  # m, lengths of the scale bar
MAX_SCALE_BAR_SHARE = 1 / 5  # share of the picture's width that the scale bar may take


class MapPicture:
    """A picture of a map to draw on in map coordinates; free is white, occupied black, unknown grey.

    Args:
        grid: The map.
        is_enlarged: Whether a small map is enlarged to `MIN_WIDTH` pixels.
    """

    def __init__(self, grid: OccupancyGrid, *, is_enlarged: bool = False) -> None:
        self._grid = grid
        self._scale = math.ceil(MIN_WIDTH / max(grid.shape)) if is_enlarged else 1
        grey = np.rint(255.0 * (1.0 - grid.probability[::-1])).astype(np.uint8)
        enlarged = grey.repeat(self._scale, axis=0).repeat(self._scale, axis=1)
        self._image = Image.fromarray(enlarged).convert("RGB")
        self._height = self._image.height
        self._draw = ImageDraw.Draw(self._image)

    def line(self, points: Floats, colour: Colour, width: int = 1) -> None:
        """Draw a line, ``width`` pixels wide, through points [N, 2] m of the map frame."""
        self._draw.line(self._pixels(points), fill=colour, width=width)

    def points(self, points: Floats, colour: Colour) -> None:
        """Draw points [N, 2] m of the map frame, a pixel each."""
        self._draw.point(self._pixels(points), fill=colour)

    def add_legend(self, entries: Sequence[tuple[str, Colour]]) -> None:
        """Add a legend of coloured lines and a scale bar below the map."""
        width = max(self._image.width, MIN_WIDTH)
        text_size = max(MIN_TEXT_SIZE, width // 60)
        image = Image.new("RGB", (width, self._height + 2 * text_size), "white")
        image.paste(self._image)
        self._image, self._draw = image, ImageDraw.Draw(image)
        font, middle = ImageFont.load_default(text_size), self._height + text_size
        x = float(text_size)
        for name, colour in entries:
            self._draw.line([(x, middle), (x + text_size, middle)], fill=colour, width=3)
            self._draw.text((x + 1.4 * text_size, middle), name, fill="black", font=font, anchor="lm")
            x += 3.0 * text_size + self._draw.textlength(name, font=font)
        pixels_per_metre = self._scale / self._grid.resolution
        fitting = (bar for bar in SCALE_BARS if bar * pixels_per_metre < MAX_SCALE_BAR_SHARE * width)
        metres = max(fitting, default=SCALE_BARS[0])
        right = width - text_size
        left = right - metres * pixels_per_metre
        self._draw.line([(left, middle), (right, middle)], fill="black", width=3)
        self._draw.text((left - 0.4 * text_size, middle), f"{metres} m", fill="black", font=font, anchor="rm")

    def png(self) -> bytes:
        """The picture as a PNG file."""
        buffer = io.BytesIO()
        self._image.save(buffer, "PNG")
        return buffer.getvalue()

    def _pixels(self, points: Floats) -> list[tuple[float, float]]:
        """X and y, in pixels, of points [N, 2] m of the map frame."""
        cells = self._grid.origin.inverse.transform(points) / self._grid.resolution * self._scale
        return [(float(x), float(self._height - y)) for x, y in cells]
