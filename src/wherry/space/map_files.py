"""Maps as map_server keeps them: an image and a YAML file that says how to read it."""

from __future__ import annotations

import io
import math
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from wherry.errors import InputError
from wherry.files import read_bytes, read_text, write_atomically
from wherry.space.occupancy import FREE_BELOW, OCCUPIED_ABOVE, UNKNOWN, OccupancyGrid
from wherry.space.pose import Floats, Pose

LARGEST_YAML = 64_000  # bytes
LARGEST_IMAGE = 200_000_000  # bytes
LARGEST_GRID = 100_000_000  # cells: 500 × 500 m at 5 cm
MODES = ("trinary", "scale", "raw")
FREE_GREY, UNKNOWN_GREY, OCCUPIED_GREY = 254, 205, 0  # as map_saver writes them; 205 lies between both thresholds
RAW_UNKNOWN = 255


def save_map(grid: OccupancyGrid, path: str | Path, mode: str = "trinary") -> Path:
    """Write a map as NAME.pgm and NAME.yaml, readable by ROS 1 and ROS 2 map_server.

    Args:
        grid: The map.
        path: The YAML file; the image goes beside it.
        mode: ``trinary`` keeps free, occupied and unknown; ``scale`` keeps probabilities to 1/255, in which map_server
            (but not `load_map`) takes what is unknown for half occupied.

    Returns:
        The YAML file's path.

    Raises:
        InputError: The folder does not exist or cannot be written to.
    """
    path = Path(path).with_suffix(".yaml")
    if mode == "trinary":
        grey = np.full(grid.shape, UNKNOWN_GREY, np.uint8)
        grey[grid.free] = FREE_GREY
        grey[grid.occupied] = OCCUPIED_GREY
    elif mode == "scale":
        grey = np.round(255.0 * (1.0 - grid.probability)).astype(np.uint8)
    else:
        raise ValueError(f"mode must be trinary or scale, not {mode!r}")
    header = f"P5\n{grid.shape[1]} {grid.shape[0]}\n255\n".encode()
    image = path.with_suffix(".pgm")
    description = {
        "image": image.name,
        "mode": mode,
        "resolution": grid.resolution,
        "origin": [grid.origin.x, grid.origin.y, grid.origin.theta],
        "negate": 0,
        "occupied_thresh": OCCUPIED_ABOVE,
        "free_thresh": FREE_BELOW,
    }
    write_atomically(image, header + grey[::-1].tobytes())  # an image's first row is the map's highest y
    write_atomically(path, yaml.safe_dump(description, sort_keys=False))
    return path


def load_map(path: str | Path) -> OccupancyGrid:
    """Read a map in map_server's format.

    Thresholds that differ from this package's own are honoured: probabilities are stretched piecewise so that the
    file's thresholds fall on `FREE_BELOW` and `OCCUPIED_ABOVE`.

    Args:
        path: The YAML file.

    Raises:
        InputError: A file is missing, too large, or not what it should be; the error names the field.
    """
    path = Path(path)
    fields = _read_fields(path)
    mode = str(fields.get("mode", "trinary"))
    if mode not in MODES:
        raise InputError(path, "mode", f"must be one of {', '.join(MODES)}, not {mode!r}")
    resolution = _number(path, fields, "resolution")
    if not 1e-4 <= resolution <= 100.0:
        raise InputError(path, "resolution", f"must lie between 0.0001 and 100 m, not {resolution:g}")
    origin = _origin(path, fields)
    image = fields.get("image")
    if not isinstance(image, str) or not image:
        raise InputError(path, "image", "must name the image file")
    grey = _read_grey(path.parent / image)[::-1]
    if mode == "raw":
        return OccupancyGrid(_raw(path.parent / image, grey), resolution, origin)

    negate = fields.get("negate", 0)
    if negate not in (0, 1):
        raise InputError(path, "negate", f"must be 0 or 1, not {negate!r}")
    occupied_above = _number(path, fields, "occupied_thresh", OCCUPIED_ABOVE)
    free_below = _number(path, fields, "free_thresh", FREE_BELOW)
    if not 0.0 < free_below < occupied_above < 1.0:
        raise InputError(path, "free_thresh", "must be above 0 and below occupied_thresh, which must be below 1")
    probability = (grey if negate else 255.0 - grey) / 255.0
    if mode == "trinary":
        known = np.where(probability > occupied_above, 1.0, UNKNOWN)
        values = np.where(probability < free_below, 0.0, known)
    else:
        values = np.interp(probability, [0.0, free_below, occupied_above, 1.0], [0.0, FREE_BELOW, OCCUPIED_ABOVE, 1.0])
    return OccupancyGrid(values.astype(np.float32), resolution, origin)


def _read_fields(path: Path) -> Mapping[str, Any]:
    """The YAML file's mapping."""
    try:
        fields = yaml.safe_load(read_text(path, limit=LARGEST_YAML))
    except yaml.MarkedYAMLError as error:
        line = f"line {error.problem_mark.line + 1}" if error.problem_mark else ""
        raise InputError(path, line, f"is not YAML: {error.problem}") from error
    except yaml.YAMLError as error:
        raise InputError(path, "", "is not YAML text") from error
    if not isinstance(fields, dict):
        raise InputError(path, "", "must be a mapping with image, resolution and origin")
    return fields


def _number(path: Path, fields: Mapping[str, Any], name: str, default: float | None = None) -> float:
    """A finite number of the mapping."""
    value = fields.get(name, default)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise InputError(path, name, "is missing" if value is None else f"must be a finite number, not {value!r}")
    return float(value)


def _origin(path: Path, fields: Mapping[str, Any]) -> Pose:
    """The pose of the image's lower left corner."""
    values = fields.get("origin")
    if not isinstance(values, list) or len(values) != 3:
        raise InputError(path, "origin", "must be a list of x, y and yaw")
    return Pose.from_array(np.array([_number(path, {"origin": value}, "origin") for value in values]))


def _read_grey(path: Path) -> Floats:
    """[H, W] grey values 0 to 255 of an image, first row on top; its size is checked before its pixels are read."""
    data = read_bytes(path, limit=LARGEST_IMAGE)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            image = Image.open(io.BytesIO(data))
            if image.width * image.height > LARGEST_GRID:
                size = f"{image.width:,} × {image.height:,}"
                raise InputError(path, "size", f"{size} pixels are more than the {LARGEST_GRID:,} that a map may have")
            image.load()
    except UnidentifiedImageError as error:
        raise InputError(path, "", "is not an image that can be read (PGM, PNG, …)") from error
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise InputError(path, "", f"is a broken image: {error}") from error
    if image.mode.startswith("I"):  # 16 bits a pixel
        return np.asarray(image, dtype=np.float64) / 257.0
    return np.asarray(image.convert("L"), dtype=np.float64)


def _raw(path: Path, grey: Floats) -> NDArray[np.float32]:
    """[H, W] probabilities of an image that holds per cents, and 255 for what is unknown."""
    if ((grey > 100) & (grey != RAW_UNKNOWN)).any():
        raise InputError(path, "mode", "raw: pixels must be 0 to 100, or 255 for unknown")
    return np.where(grey == RAW_UNKNOWN, UNKNOWN, grey / 100.0).astype(np.float32)
