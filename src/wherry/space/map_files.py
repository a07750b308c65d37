"""Map files in the format of ROS's map_server: an image, and a YAML file that describes it.

`load_map` gives the probabilities that map_server publishes on ``/map``, divided by 100, without its rounding to whole
percents. Where the map_server of ROS 1 and that of nav2 differ, nav2's is followed, unless one of the two would read
another map: such a file is refused. Sources: ``map_server/src/image_loader.cpp`` of ros-planning/navigation,
``nav2_map_server/src/map_io.cpp`` of ros-navigation/navigation2.
"""

from __future__ import annotations

import io
import math
import warnings
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError
from pydantic import BeforeValidator, ConfigDict, Field, ValidationInfo, field_validator, model_validator

from wherry.documents import MAX_REASON_CHARACTERS, Document, Flag, Number, load_yaml
from wherry.errors import InputError
from wherry.files import read_bytes, write_atomically
from wherry.space.occupancy import FREE_THRESHOLD, OCCUPIED_THRESHOLD, UNKNOWN, OccupancyGrid
from wherry.space.pose import Pose

MAX_IMAGE_SIZE = 200_000_000  # bytes of an image file
MAX_CELLS = 100_000_000  # cells of a map: 500 × 500 m at 5 cm
MAX_EXTENT = 20_000.0  # m, length of a map's side
MIN_RESOLUTION, MAX_RESOLUTION = 1e-4, 100.0  # m, sides of a cell that a file may have
MAX_COORDINATE = 1e7  # m, of the origin; UTM's northings end there
FREE_GREY, UNKNOWN_GREY, OCCUPIED_GREY = 254, 205, 0  # values of map_saver; 205 lies between the two thresholds
SCALE_THRESHOLD = (
    0.001  # of a saved map in mode scale: only probabilities below become 0, and above 1 minus it become 1
)
MAX_GREY = 255  # grey value of white
MAX_PERCENTAGE, RAW_UNKNOWN = 100, 255  # largest pixel of a known cell, and pixel of an unknown cell, in mode raw
OPAQUE = 255  # alpha of an opaque pixel; any other is unknown in mode scale
PIXELS_PER_BLOCK = 4_000_000  # pixels whose channels are averaged at once, so that memory stays small
IMAGE_SUFFIXES = (".pgm", ".png", ".bmp", ".tif", ".tiff", ".jpg", ".jpeg", ".gif", ".webp", ".ppm")
IMAGE_FORMATS = ("PPM", "PNG", "BMP", "TIFF", "JPEG", "GIF", "WEBP")  # as Pillow calls them; PPM includes PGM and PBM

Mode = Literal["trinary", "scale", "raw"]
Coordinate = Annotated[Number, Field(ge=-MAX_COORDINATE, le=MAX_COORDINATE)]
Threshold = Annotated[Number, Field(ge=0.0, le=1.0)]


def _lowered(value: object) -> object:
    """A mode in lower case, as nav2 reads it; any other value as it is."""
    return value.strip().lower() if isinstance(value, str) else value


class _MapDocument(Document):
    """The YAML file of a map; unknown fields are ignored.

    Attributes:
        image: Path of the image, relative to the YAML file.
        trinary: False for mode scale; older map_servers of ROS 1 have this field instead of ``mode``.
        mode: How grey values encode probabilities, as in map_server.
        resolution: Side of a cell, m.
        origin: Pose of the image's lower left corner in the map frame, m, m, rad.
        negate: Whether white is occupied, and not black.
        occupied_thresh: Probability above which a cell is occupied.
        free_thresh: Probability below which a cell is free.
    """

    model_config = ConfigDict(extra="ignore")

    image: Annotated[str, Field(min_length=1)]
    trinary: Flag | None = None
    mode: Annotated[Mode, BeforeValidator(_lowered)] = "trinary"
    resolution: Annotated[Number, Field(ge=MIN_RESOLUTION, le=MAX_RESOLUTION)]
    origin: list[Coordinate]
    negate: Annotated[Flag, Field(validate_default=True)] = False
    occupied_thresh: Threshold = OCCUPIED_THRESHOLD
    free_thresh: Annotated[Threshold, Field(validate_default=True)] = FREE_THRESHOLD

    @model_validator(mode="before")
    @classmethod
    def _read_trinary(cls, fields: Any) -> Any:
        """Take the mode from ``trinary`` in a file that has no ``mode``."""
        if isinstance(fields, dict) and "trinary" in fields and "mode" not in fields:
            is_scale = str(fields["trinary"]).strip().lower() in ("false", "no", "off", "n", "0")
            return {**fields, "mode": "scale" if is_scale else "trinary"}
        return fields

    @field_validator("mode")
    @classmethod
    def _agrees_with_trinary(cls, mode: Mode, info: ValidationInfo) -> Mode:
        """Raise a `ValueError` if ``trinary`` says otherwise."""
        if info.data.get("trinary") is not None and info.data["trinary"] is not (mode == "trinary"):
            raise ValueError(f"is {mode}, which contradicts trinary: {str(info.data['trinary']).lower()}")
        return mode

    @field_validator("origin")
    @classmethod
    def _has_three_coordinates(cls, origin: list[float]) -> list[float]:
        """Raise a `ValueError` unless the origin is x, y and an angle."""
        if len(origin) != 3:
            raise ValueError(f"has {len(origin)} numbers, not 3 (x in m, y in m, yaw in rad)")
        if abs(origin[2]) > 2.0 * math.pi:
            raise ValueError(f"has the yaw {origin[2]:g}, which is beyond ±2π: it must be in rad")
        return origin

    @field_validator("negate")
    @classmethod
    def _is_not_raw(cls, negate: bool, info: ValidationInfo) -> bool:
        """Raise a `ValueError` for negated percentages, of which the two map_servers read different maps."""
        if negate and info.data.get("mode") == "raw":
            raise ValueError("is 1 in mode raw, where ROS 1's map_server inverts the pixels and nav2's does not")
        return negate

    @field_validator("free_thresh")
    @classmethod
    def _check_thresholds(cls, free: float, info: ValidationInfo) -> float:
        """Raise a `ValueError` unless the thresholds are in order; raw images have none."""
        mode, occupied = info.data.get("mode"), info.data.get("occupied_thresh", 1.0)
        if mode == "trinary" and free > occupied:
            raise ValueError(f"is {free:g}, above occupied_thresh, which is {occupied:g}")
        if mode == "scale" and free >= occupied:
            raise ValueError(f"is {free:g}, not below occupied_thresh, which is {occupied:g}")
        return free


def save_map(grid: OccupancyGrid, path: str | Path, mode: Literal["trinary", "scale"] = "trinary") -> Path:
    """Write a map as an image and NAME.yaml, readable by ROS 1 and ROS 2 map_server.

    Args:
        grid: The map.
        path: The YAML file; the image is written next to it.
        mode: ``trinary`` keeps free, occupied and unknown in NAME.pgm, which suits amcl and costmaps; ``scale`` keeps
            probabilities to 1/255 in NAME.png, whose transparent pixels are the cells of probability 0.5, unknown.

    Returns:
        Path of the YAML file.

    Raises:
        InputError: The folder does not exist or cannot be written to.
        ValueError: The mode is another one.
    """
    path = Path(path).with_suffix(".yaml")
    if mode == "trinary":
        image, content = path.with_suffix(".pgm"), _trinary_image(grid)
        occupied, free = OCCUPIED_THRESHOLD, FREE_THRESHOLD
    elif mode == "scale":
        image, content = path.with_suffix(".png"), _scale_image(grid)
        occupied, free = 1.0 - SCALE_THRESHOLD, SCALE_THRESHOLD
    else:
        raise ValueError(f"mode must be trinary or scale, not {mode!r}")
    description = {
        "image": image.name,
        "mode": mode,
        "resolution": grid.resolution,
        "origin": [grid.origin.x, grid.origin.y, grid.origin.theta],
        "negate": 0,
        "occupied_thresh": occupied,
        "free_thresh": free,
    }
    write_atomically(image, content)
    write_atomically(path, yaml.safe_dump(description, sort_keys=False))
    return path


def _trinary_image(grid: OccupancyGrid) -> bytes:
    """The PGM file of a map's free, occupied and unknown cells."""
    grey = np.full(grid.shape, UNKNOWN_GREY, np.uint8)
    grey[grid.free] = FREE_GREY
    grey[grid.occupied] = OCCUPIED_GREY
    header = f"P5\n{grid.shape[1]} {grid.shape[0]}\n255\n".encode()
    return header + grey[::-1].tobytes()  # an image's first row is the map's largest y


def _scale_image(grid: OccupancyGrid) -> bytes:
    """The PNG file of a map's probabilities, transparent where they are unknown."""
    occupied = SCALE_THRESHOLD + (1.0 - 2.0 * SCALE_THRESHOLD) * grid.probability  # what map_server undoes
    pixels = np.empty((*grid.shape, 4), np.uint8)  # RGBA: nav2's reader loses the alpha of grey images
    pixels[..., :3] = np.round(MAX_GREY * (1.0 - occupied))[..., None]
    pixels[..., 3] = np.where(grid.probability == UNKNOWN, 0, OPAQUE)
    file = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels[::-1])).save(file, "PNG")
    return file.getvalue()


def load_map(path: str | Path) -> OccupancyGrid:
    """Read a map in map_server's format.

    In mode trinary, pixels are free (0), occupied (1) or unknown (0.5). In mode scale, those between the thresholds
    have the fraction of the way from one to the other as their probability, and those that are not opaque are unknown.
    In mode raw, pixels are percentages, or 255 for unknown. The grey value of a pixel is the mean of its channels, in
    mode trinary including alpha.

    Args:
        path: The YAML file.

    Raises:
        InputError: A file is missing, too large, or invalid; the error names the field.
    """
    path = Path(path)
    if path.suffix.lower() in IMAGE_SUFFIXES:
        raise InputError(path, "", "is an image: a map is read from the YAML file that describes it")
    document = load_yaml(path, _MapDocument)
    image = _read_image(path, path.parent / document.image)
    extent = max(image.size) * document.resolution
    if extent > MAX_EXTENT:
        reason = f"{document.resolution:g} m gives a map of {extent:,.0f} m, more than {MAX_EXTENT:,.0f} m"
        raise InputError(path, "resolution", f"{reason}, with {image.width:,} × {image.height:,} pixels")
    probability = np.empty((image.height, image.width), np.float32)
    rows = max(1, PIXELS_PER_BLOCK // image.width)
    for top in range(0, image.height, rows):
        block = image.crop((0, top, image.width, min(top + rows, image.height)))
        probability[top : top + rows] = _probability(document, block, path.parent / document.image)
    return OccupancyGrid(probability[::-1], document.resolution, Pose.from_array(np.array(document.origin)))


def _probability(document: _MapDocument, image: Image.Image, source: Path) -> NDArray[np.float32]:
    """Probabilities of an image's pixels, [H, W], top row first."""
    sums, channels, alpha = _sums(image, source, with_alpha=document.mode == "trinary")
    shades = np.arange(MAX_GREY * channels + 1) / channels  # grey value of each sum, 0 to 255
    if document.mode == "raw":
        if (invalid := (sums > MAX_PERCENTAGE * channels) & (sums != RAW_UNKNOWN * channels)).any():
            found = f"{sums[invalid][0] / channels:g}"
            raise InputError(source, "mode", f"raw: pixels must be 0 to 100, or 255 for unknown, not {found}")
        table = np.where(shades > MAX_PERCENTAGE, UNKNOWN, shades / 100.0)
        percentages: NDArray[np.float32] = table.astype(np.float32)[sums]
        return percentages
    darkness = (shades if document.negate else MAX_GREY - shades) / MAX_GREY
    occupied, free = document.occupied_thresh, document.free_thresh
    between = np.full_like(darkness, UNKNOWN)
    if document.mode == "scale":
        between = (darkness - free) / (occupied - free)
    table = np.where(darkness > occupied, 1.0, np.where(darkness < free, 0.0, between))
    probability: NDArray[np.float32] = table.astype(np.float32)[sums]
    if document.mode == "scale" and alpha is not None:
        probability[alpha < OPAQUE] = UNKNOWN
    return probability


def _read_image(description: Path, path: Path) -> Image.Image:
    """Decode an image, whose size is checked before its pixels are decoded."""
    try:
        data = read_bytes(path, max_bytes=MAX_IMAGE_SIZE)
    except InputError as error:
        raise InputError(description, "image", f"{path}: {error.reason}") from error
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow's, about sizes and broken metadata
            image = Image.open(io.BytesIO(data), formats=IMAGE_FORMATS)
            _check_size(image, path)
            image.load()
    except InputError:
        raise
    except UnidentifiedImageError as error:
        raise InputError(path, "", "is not an image that can be read (PGM, PNG, …)") from error
    except Exception as error:  # Pillow's decoders raise many kinds on damaged files
        raise InputError(path, "", f"is a broken image: {error}"[:MAX_REASON_CHARACTERS]) from error
    return image


def _check_size(image: Image.Image, path: Path) -> None:
    """Raise an error if an image has more pixels than a map may have cells."""
    if image.width * image.height > MAX_CELLS:
        size = f"{image.width:,} × {image.height:,}"
        raise InputError(path, "size", f"{size} pixels are more than the {MAX_CELLS:,} that a map may have")


def _sums(
    image: Image.Image, source: Path, *, with_alpha: bool
) -> tuple[NDArray[np.integer[Any]], int, NDArray[np.uint8] | None]:
    """Sum of each pixel's channels, [H, W], the number of channels, and alpha, [H, W], None for an opaque image.

    A sum divided by the number of channels is the grey value, 0 to 255; a pixel of 16 bits counts as 257 channels.
    Alpha is among the channels if ``with_alpha``.
    """
    if image.mode.startswith("I"):
        values = np.asarray(image)
        if values.min() < 0 or values.max() > np.iinfo(np.uint16).max:
            raise InputError(source, "", "has pixels of more than 16 bits, which map_server does not read")
        return values.astype(np.uint16), 257, None
    if image.mode == "F":
        raise InputError(source, "", "has pixels of floating point, which map_server does not read")
    is_transparent = image.has_transparency_data
    if image.mode in ("1", "L") and not is_transparent:
        return np.asarray(image.convert("L")), 1, None
    pixels = np.asarray(image.convert("RGBA"))
    channels = 4 if with_alpha and is_transparent else 3
    return pixels[..., :channels].sum(axis=-1, dtype=np.uint16), channels, pixels[..., 3] if is_transparent else None
