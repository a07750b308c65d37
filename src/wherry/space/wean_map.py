"""Maps in the text format of Carnegie Mellon's Wean Hall: a header, then one line of probabilities per map column."""

from __future__ import annotations

import gzip
import zlib
from pathlib import Path

import numpy as np

from wherry.errors import InputError
from wherry.files import read_bytes
from wherry.space.occupancy import UNKNOWN, OccupancyGrid
from wherry.space.pose import IDENTITY

MAX_FILE_SIZE = 200_000_000  # bytes, unpacked
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
    lines = _unpacked(Path(path)).decode("latin-1").splitlines()
    start = next((i for i, line in enumerate(lines) if line.startswith(MAP_KEY)), None)
    if start is None:
        raise InputError(path, MAP_KEY, "is missing: the file is not a Wean Hall map")
    resolution = next((line.split()[-1] for line in lines[:start] if line.startswith(RESOLUTION_KEY)), None)
    try:
        cell = float(resolution or "") * CENTIMETRE
        width, height = (int(word) for word in lines[start].split()[1:])
    except ValueError as error:
        raise InputError(path, f"line {start + 1}", "does not give the map's size and resolution") from error
    if not (0.0 < cell < 100.0 and width > 0 and height > 0):
        raise InputError(path, f"line {start + 1}", "gives an impossible size or resolution")
    free = np.empty((width, height))
    for x in range(width):
        number = start + 1 + x
        words = lines[number].split() if number < len(lines) else []
        if len(words) != height:
            raise InputError(path, f"line {number + 1}", f"has {len(words)} values, not {height}")
        try:
            free[x] = words
        except ValueError as error:
            raise InputError(path, f"line {number + 1}", "has a word that is not a number") from error
    if not ((free <= 1.0) & ((free >= 0.0) | (free == -1.0))).all():
        raise InputError(path, "", "has values that are neither probabilities nor −1")
    occupied = np.where(free < 0.0, UNKNOWN, 1.0 - free).T
    return OccupancyGrid(occupied.astype(np.float32), cell, IDENTITY)


def _unpacked(path: Path) -> bytes:
    """Content of a file, unpacked if its name ends in .gz."""
    if path.suffix != ".gz":
        return read_bytes(path, max_bytes=MAX_FILE_SIZE)
    try:
        with gzip.open(path, "rb") as file:
            data = file.read(MAX_FILE_SIZE + 1)
    except (OSError, EOFError, zlib.error) as error:
        reason = getattr(error, "strerror", None) or f"is not a whole gzip file: {error}"
        raise InputError(path, "", reason) from error
    if len(data) > MAX_FILE_SIZE:
        raise InputError(path, "", f"is larger than {MAX_FILE_SIZE:,} bytes, unpacked")
    return data
