"""Maps in the text format of Carnegie Mellon's Wean Hall: a header, then one line of probabilities per map column."""

from __future__ import annotations

import codecs
import gzip
import io
import itertools
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wherry.errors import InputError
from wherry.files import read_bytes
from wherry.space.occupancy import UNKNOWN, OccupancyGrid
from wherry.space.pose import IDENTITY

MAX_FILE_SIZE = 100_000_000  # bytes, unpacked
MAX_HEADER_LINES = 100_000  # lines above the cells
MAX_CELLS = 25_000_000  # cells of a map
MAX_EXTENT = 20_000.0  # m, length of a map's side
MIN_RESOLUTION, MAX_RESOLUTION = 1e-3, 100.0  # m, sides of a cell that a file may have
RESOLUTION_KEY = "robot_specifications->resolution"  # begins the line with the side of a cell, cm
MAP_KEY = "global_map[0]:"  # begins the line with the numbers of columns and rows, after which the cells follow
CENTIMETRE = 0.01  # m


def load_wean_map(path: str | Path) -> OccupancyGrid:
    """Read a map of probabilities that cells are free, with −1 for unknown cells.

    Args:
        path: The file; gzipped if its name ends in .gz.

    Raises:
        InputError: The file cannot be read, or is not a valid map; the error names the line.
    """
    data = _unpacked(Path(path)).removeprefix(codecs.BOM_UTF8)
    lines = enumerate(io.TextIOWrapper(io.BytesIO(data), encoding="latin-1"), start=1)
    number, width, height, cell = _read_header(path, lines)
    free = np.empty((width, height), np.float32)
    for x in range(width):
        number, line = next(lines, (number + 1, ""))
        words = line.split()
        if len(words) != height:
            raise InputError(path, f"line {number}", f"has {len(words)} values, not {height}")
        try:
            free[x] = words
        except ValueError as error:
            raise InputError(path, f"line {number}", "has a word that is not a number") from error
    if not ((free <= 1.0) & ((free >= 0.0) | (free == -1.0))).all():
        raise InputError(path, "", "has values that are neither probabilities nor −1")
    occupied: NDArray[np.float32] = np.where(free < 0.0, np.float32(UNKNOWN), np.float32(1.0) - free).T
    return OccupancyGrid(occupied, cell, IDENTITY)


def _read_header(path: str | Path, lines: Iterator[tuple[int, str]]) -> tuple[int, int, int, float]:
    """The number of the header's last line, the map's columns and rows, and the side of a cell, m."""
    resolution, size = "", None
    for number, line in itertools.islice(lines, MAX_HEADER_LINES):
        if line.startswith(RESOLUTION_KEY) and not resolution:
            resolution = line.split()[-1]
        if line.startswith(MAP_KEY):
            size = number, line.split()[1:]
            break
    if size is None:
        raise InputError(path, MAP_KEY, "is missing: the file is not a Wean Hall map")
    number, words = size
    try:
        cell = float(resolution) * CENTIMETRE
        width, height = (int(word) for word in words)
    except ValueError as error:
        raise InputError(path, f"line {number}", "does not give the map's size and resolution") from error
    if not (MIN_RESOLUTION <= cell <= MAX_RESOLUTION and width > 0 and height > 0):
        raise InputError(path, f"line {number}", "gives an impossible size or resolution")
    if width * height > MAX_CELLS or max(width, height) * cell > MAX_EXTENT:
        reason = f"gives a map of more than {MAX_CELLS:,} cells or {MAX_EXTENT:,.0f} m"
        raise InputError(path, f"line {number}", reason)
    return number, width, height, cell


def _unpacked(path: Path) -> bytes:
    """Content of a file, unpacked if its name ends in .gz."""
    if path.suffix != ".gz":
        return read_bytes(path, max_bytes=MAX_FILE_SIZE)
    try:
        with gzip.open(path, "rb") as file:
            data = file.read(MAX_FILE_SIZE + 1)
    except (OSError, EOFError, ValueError, zlib.error) as error:  # ValueError: a null character in the path
        reason = getattr(error, "strerror", None) or f"is not a whole gzip file: {error}"
        raise InputError(path, "", reason) from error
    if len(data) > MAX_FILE_SIZE:
        raise InputError(path, "", f"is larger than {MAX_FILE_SIZE:,} bytes, unpacked")
    return data
