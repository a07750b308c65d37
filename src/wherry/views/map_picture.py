"""Pictures of occupancy grids with trajectories, points, markers, a legend and a scale bar."""

from __future__ import annotations

import enum
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats

Colour = tuple[int, int, int]

MIN_WIDTH = 480  # pixels, smallest width of an enlarged map and of a legend
MIN_TEXT_SIZE = 14  # pixels, height of the legend's text
TEXT_SHARE = 1 / 60  # height of the legend's text as a share of the picture's width
LINE_SHARE = 1 / 400  # width of trajectories as a share of the picture's width
MIN_LINE_WIDTH = 2  # pixels, smallest width of trajectories
STROKE_SHARE = 0.2  # width of the legend's lines as a share of the text's height
SCALE_BARS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)  # m, lengths of the scale bar
MAX_SCALE_BAR_SHARE = 1 / 5  # share of the picture's width that the scale bar may take


class Symbol(enum.Enum):
    """What an entry of the legend stands for."""

    LINE = enum.auto()
    POINTS = enum.auto()
    RING = enum.auto()
    DISC = enum.auto()


@dataclass(frozen=True, slots=True)
class LegendEntry:
    """An entry of a legend.

    Attributes:
        name: Its text.
        colour: Colour of what is drawn.
        symbol: Its kind.
    """

    name: str
    colour: Colour
    symbol: Symbol = Symbol.LINE


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
        self._width = max(self._image.width, MIN_WIDTH)
        self._line_width = max(MIN_LINE_WIDTH, round(self._width * LINE_SHARE))

    def line(self, points: Floats, colour: Colour, width: int | None = None) -> None:
        """Draw a line through points [N, 2] m of the map frame, ``width`` pixels wide or as wide as trajectories."""
        self._draw.line(self._pixels(points), fill=colour, width=width or self._line_width, joint="curve")

    def points(self, points: Floats, colour: Colour) -> None:
        """Draw points [N, 2] m of the map frame as squares as wide as a trajectory."""
        for x, y in self._pixels(points):
            self._dot(x, y, self._line_width, colour)

    def marker(self, point: Floats, colour: Colour, symbol: Symbol) -> None:
        """Draw a ring or a disc around a point [2] m of the map frame."""
        (centre,) = self._pixels(point[None, :])
        self._symbol(centre, 2.5 * self._line_width, colour, symbol)

    def add_legend(self, entries: Sequence[LegendEntry]) -> None:
        """Add a legend and a scale bar below the map, in as many rows as they need."""
        text_size = max(MIN_TEXT_SIZE, round(self._width * TEXT_SHARE))
        font = ImageFont.load_default(text_size)
        widths = [3.0 * text_size + font.getlength(entry.name) for entry in entries]
        metres, bar = self._scale_bar()
        label = f"{metres:g} m"
        rows, rest = _rows([*widths, bar + font.getlength(label) + text_size], self._width - 2.0 * text_size)
        image = Image.new("RGB", (self._width, self._height + round((rows[-1] + 1) * 2 * text_size)), "white")
        image.paste(self._image)
        self._image, self._draw = image, ImageDraw.Draw(image)
        for entry, row, start in zip(entries, rows[:-1], rest[:-1], strict=True):
            x, middle = start + text_size, self._height + (2 * row + 1) * text_size
            self._symbol((x + text_size / 2, middle), text_size / 2, entry.colour, entry.symbol)
            self._draw.text((x + 1.4 * text_size, middle), entry.name, fill="black", font=font, anchor="lm")
        right, middle = self._width - text_size, self._height + (2 * rows[-1] + 1) * text_size
        ends = [(right - bar, middle), (right, middle)]
        stroke = round(text_size * STROKE_SHARE)
        self._draw.line(ends, fill="black", width=stroke)
        for x, _ in ends:
            self._draw.line([(x, middle - text_size / 3), (x, middle + text_size / 3)], fill="black", width=stroke)
        self._draw.text((right - bar - 0.5 * text_size, middle), label, fill="black", font=font, anchor="rm")

    def png(self) -> bytes:
        """The picture as a PNG file."""
        buffer = io.BytesIO()
        self._image.save(buffer, "PNG")
        return buffer.getvalue()

    def _scale_bar(self) -> tuple[float, float]:
        """Length of the scale bar, m and pixels."""
        pixels_per_metre = self._scale / self._grid.resolution
        fitting = (bar for bar in SCALE_BARS if bar * pixels_per_metre < MAX_SCALE_BAR_SHARE * self._width)
        metres = max(fitting, default=SCALE_BARS[0])
        return metres, metres * pixels_per_metre

    def _symbol(self, centre: tuple[float, float], radius: float, colour: Colour, symbol: Symbol) -> None:
        """Draw the symbol of a legend's entry or a marker; radius in pixels."""
        x, y = centre
        box = [x - radius, y - radius, x + radius, y + radius]
        match symbol:
            case Symbol.LINE:
                self._draw.line([(x - radius, y), (x + radius, y)], fill=colour, width=round(2 * radius * STROKE_SHARE))
            case Symbol.POINTS:
                for dx, dy in ((-0.7, 0.4), (0.0, -0.5), (0.6, 0.3)):
                    self._dot(x + dx * radius, y + dy * radius, round(2 * radius * STROKE_SHARE), colour)
            case Symbol.RING:
                self._draw.ellipse(box, fill="white", outline=colour, width=max(2, round(radius / 3)))
            case Symbol.DISC:
                self._draw.ellipse(box, fill=colour, outline="white", width=1)

    def _dot(self, x: float, y: float, width: int, colour: Colour) -> None:
        """Draw a square around a pixel."""
        left, top = math.floor(x - (width - 1) / 2), math.floor(y - (width - 1) / 2)
        self._draw.rectangle([left, top, left + width - 1, top + width - 1], fill=colour)

    def _pixels(self, points: Floats) -> list[tuple[float, float]]:
        """X and y, in pixels, of points [N, 2] m of the map frame."""
        cells = self._grid.origin.inverse.transform(points) / self._grid.resolution * self._scale
        return [(float(x), float(self._height - y)) for x, y in cells]


def _rows(widths: Sequence[float], available: float) -> tuple[list[int], list[float]]:
    """Row and left end, in pixels, of each piece of a text that is broken into rows of the available width."""
    rows, starts, row, x = [], [], 0, 0.0
    for width in widths:
        if x > 0.0 and x + width > available:
            row, x = row + 1, 0.0
        rows.append(row)
        starts.append(x)
        x += width
    return rows, starts
