"""Map files in the format of ROS's map_server: an image, and a YAML file that describes it."""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError
from pydantic import ConfigDict, Field, ValidationInfo, field_validator

from wherry.documents import Document, load_yaml
from wherry.errors import InputError
from wherry.files import read_bytes, write_atomically
from wherry.space.occupancy import FREE_THRESHOLD, OCCUPIED_THRESHOLD, UNKNOWN, OccupancyGrid
from wherry.space.pose import Floats, Pose

MAX_IMAGE_SIZE = 200_000_000  # bytes of an image file
MAX_CELLS = 100_000_000  # cells of a map: 500 × 500 m at 5 cm
MIN_RESOLUTION, MAX_RESOLUTION = 1e-4, 100.0  # m, sides of a cell that a file may have
FREE_GREY, UNKNOWN_GREY, OCCUPIED_GREY = 254, 205, 0  # values of map_saver; 205 lies between the two thresholds
RAW_UNKNOWN = 255  # value of an unknown pixel in mode raw


class _MapDocument(Document):
    """The YAML file of a map; unknown fields are ignored.

    Attributes:
        image: Path of the image, relative to the YAML file.
        mode: How grey values encode probabilities, as in map_server.
        resolution: Side of a cell, m.
        origin: Pose of the image's lower left corner in the map frame, m, m, rad.
        negate: 1 if white is occupied, 0 if black is.
        occupied_thresh: Probability above which a cell is occupied.
        free_thresh: Probability below which a cell is free.
    """

    model_config = ConfigDict(extra="ignore")

    image: Annotated[str, Field(min_length=1)]
    mode: Literal["trinary", "scale", "raw"] = "trinary"
    resolution: Annotated[float, Field(ge=MIN_RESOLUTION, le=MAX_RESOLUTION)]
    origin: Annotated[list[float], Field(min_length=3, max_length=3)]
    negate: Annotated[int, Field(strict=False, ge=0, le=1)] = 0
    occupied_thresh: float = OCCUPIED_THRESHOLD
    free_thresh: Annotated[float, Field(validate_default=True)] = FREE_THRESHOLD

    @field_validator("free_thresh")
    @classmethod
    def _check_thresholds(cls, free: float, info: ValidationInfo) -> float:
        """Raise a `ValueError` unless the thresholds are in order; raw images have none."""
        if info.data.get("mode") != "raw" and not 0.0 < free < info.data.get("occupied_thresh", 0.0) < 1.0:
            raise ValueError("must be above 0 and below occupied_thresh, which must be below 1")
        return free


def save_map(grid: OccupancyGrid, path: str | Path, mode: Literal["trinary", "scale"] = "trinary") -> Path:
    """Write a map as NAME.pgm and NAME.yaml, readable by ROS 1 and ROS 2 map_server.

    Args:
        grid: The map.
        path: The YAML file; the image is written next to it.
        mode: ``trinary`` keeps free, occupied and unknown; ``scale`` keeps probabilities to 1/255, but map_server,
            unlike `load_map`, does not read unknown cells of such an image as unknown.

    Returns:
        Path of the YAML file.

    Raises:
        InputError: The folder does not exist or cannot be written to.
        ValueError: The mode is another one.
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
        "occupied_thresh": OCCUPIED_THRESHOLD,
        "free_thresh": FREE_THRESHOLD,
    }
    write_atomically(image, header + grey[::-1].tobytes())  # an image's first row is the map's largest y
    write_atomically(path, yaml.safe_dump(description, sort_keys=False))
    return path


def load_map(path: str | Path) -> OccupancyGrid:
    """Read a map in map_server's format.

    Probabilities are scaled piecewise linearly, so that the file's thresholds become `FREE_THRESHOLD` and
    `OCCUPIED_THRESHOLD`.

    Args:
        path: The YAML file.

    Raises:
        InputError: A file is missing, too large, or invalid; the error names the field.
    """
    path = Path(path)
    document = load_yaml(path, _MapDocument)
    image = path.parent / document.image
    grey = _read_grey(image)[::-1]  # an image's first row is the map's largest y
    probability = _raw(image, grey) if document.mode == "raw" else _probability(document, grey)
    return OccupancyGrid(probability, document.resolution, Pose.from_array(np.array(document.origin)))


def _probability(document: _MapDocument, grey: Floats) -> NDArray[np.float32]:
    """Probabilities of grey values [H, W] in modes trinary and scale, [H, W]."""
    occupied, free = document.occupied_thresh, document.free_thresh
    probability = (grey if document.negate else 255.0 - grey) / 255.0
    if document.mode == "trinary":
        known = np.where(probability > occupied, 1.0, UNKNOWN)
        values = np.where(probability < free, 0.0, known)
    else:
        values = np.interp(probability, [0.0, free, occupied, 1.0], [0.0, FREE_THRESHOLD, OCCUPIED_THRESHOLD, 1.0])
    return values.astype(np.float32)


def _read_grey(path: Path) -> Floats:
    """Grey values 0 to 255 of an image, [H, W], top row first; the size is checked before the pixels are decoded."""
    data = read_bytes(path, max_bytes=MAX_IMAGE_SIZE)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            image = Image.open(io.BytesIO(data))
            if image.width * image.height > MAX_CELLS:
                size = f"{image.width:,} × {image.height:,}"
                raise InputError(path, "size", f"{size} pixels are more than the {MAX_CELLS:,} that a map may have")
            image.load()
    except UnidentifiedImageError as error:
        raise InputError(path, "", "is not an image that can be read (PGM, PNG, …)") from error
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise InputError(path, "", f"is a broken image: {error}") from error
    if image.mode.startswith("I"):  # 16 bits per pixel
        return np.asarray(image, dtype=np.float64) / 257.0
    return np.asarray(image.convert("L"), dtype=np.float64)


def _raw(path: Path, grey: Floats) -> NDArray[np.float32]:
    """Probabilities of a raw image, whose pixels are percentages or 255 for unknown, [H, W]."""
    if ((grey > 100) & (grey != RAW_UNKNOWN)).any():
        raise InputError(path, "mode", "raw: pixels must be 0 to 100, or 255 for unknown")
    return np.where(grey == RAW_UNKNOWN, UNKNOWN, grey / 100.0).astype(np.float32)
