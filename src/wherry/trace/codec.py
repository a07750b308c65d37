"""Records as bytes: one encoding for the file that a run leaves behind and for the page that watches it.

A frame is one record::

    u32  length of what follows the checksum, little-endian, as all numbers
    u32  CRC-32 of it
    u32  length of the header
         the header, JSON: {"type": "Said", "time": 1.5, …, "arrays": [["points", "<i2", [360, 2]], …]}
         the arrays, one after the other, row by row, each beginning at a multiple of 4 bytes from the frame's begin

Positions around the robot are kept in steps of 5 mm, the map in steps of 5 %, of which only those tiles of 64 × 64
grid cells are in a frame that changed since the one before.
"""

from __future__ import annotations

import json
import math
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wherry.errors import InputError
from wherry.space.frame import CellFrame
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry.trace.records import (
    Began,
    CellsLaid,
    Explored,
    Learnt,
    LearntRule,
    Perceived,
    Record,
    Said,
    Seen,
    Stepped,
    Thing,
)

LARGEST_MAP = 64_000_000  # grid cells: 400 × 400 m at 5 cm
MOST_PARTICLES = 2_000  # in a frame; more cannot be told apart on a screen
POSITION_STEP = 0.005  # m
ANGLE_STEP = 1e-4  # rad
TILE = 64  # grid cells, a tile's side
UNKNOWN_PERCENT = 255  # ROS's -1 as an unsigned byte
PERCENT_STEP = 5
STEP_FIELDS = ("time", "condition", "action", "learning", "moved", "unknown", "delivered", "remaining")

Array = NDArray[Any]
Header = dict[str, Any]
Arrays = Mapping[str, Array]

LENGTHS = struct.Struct("<III")
_DTYPES = ("<i2", "<i4", "<f4", "|u1")


class Encoder:
    """Makes frames of the records of one trace, in their order.

    Args:
        most_particles: Of a `Seen`; larger clouds are thinned evenly.
    """

    def __init__(self, most_particles: int = MOST_PARTICLES) -> None:
        self._most_particles = most_particles
        self._tiles = _Tiles()

    def encode(self, record: Record) -> bytes:
        """One frame."""
        header, arrays = self._parts(record)
        return frame({"type": type(record).__name__, **header}, arrays)

    def _parts(self, record: Record) -> tuple[Header, Arrays]:  # noqa: PLR0911 - one for each kind of record
        match record:
            case Seen():
                return _seen_parts(record, self._most_particles)
            case Explored():
                header, arrays = self._tiles.changed(record.grid)
                return {"time": record.time, "fraction": record.fraction, "frontier": record.frontier, **header}, arrays
            case Stepped():
                header = {name: getattr(record, name) for name in STEP_FIELDS}
                return header, {"plan": record.plan.astype("<f4")}
            case CellsLaid():
                header = {"time": record.time, "origin": _numbers(record.frame.origin), "size": record.frame.cell_size}
                return header, {"warehouse": record.warehouse.astype("<i4"), "walls": record.walls.astype("<i4")}
            case Began():
                return {name: getattr(record, name) for name in Began.__slots__}, {}
            case Said():
                return {"time": record.time, "phase": record.phase, "text": record.text}, {}
            case Perceived():
                things = [{"kind": item.kind, "name": item.name, "values": dict(item.values)} for item in record.things]
                return {"time": record.time, "condition": record.condition, "things": things}, {}
            case Learnt():
                rules = [[rule.action, rule.condition, rule.effect] for rule in record.rules]
                return {"time": record.time, "rules": rules, "failures": dict(record.failures)}, {}


def frame(header: Header, arrays: Arrays) -> bytes:
    """A frame of a header and arrays."""
    described = [[name, array.dtype.str, list(array.shape)] for name, array in arrays.items()]
    text = json.dumps({**header, "arrays": described}, separators=(",", ":"), ensure_ascii=False).encode()
    text += b" " * (-len(text) % 4)
    parts = [text]
    for array in arrays.values():
        data = np.ascontiguousarray(array).tobytes()
        parts.append(data + b"\0" * (-len(data) % 4))
    body = struct.pack("<I", len(text)) + b"".join(parts)
    return struct.pack("<II", len(body), zlib.crc32(body)) + body


def split(frames: bytes) -> Iterator[bytes]:
    """Each of the whole frames in a row; what is left at the end is no whole frame."""
    at = 0
    while at + LENGTHS.size <= len(frames):
        end = at + 8 + LENGTHS.unpack_from(frames, at)[0]
        if end > len(frames):
            return
        yield frames[at:end]
        at = end


def _seen_parts(seen: Seen, most_particles: int) -> tuple[Header, Arrays]:
    """Positions relative to the robot, in steps."""
    particles = seen.particles[:: max(1, math.ceil(len(seen.particles) / most_particles))]
    x, y, theta = (round(value, 5) for value in _numbers(seen.pose))
    header = {
        "time": round(seen.time, 4),
        "pose": [x, y, theta],
        "lidar": [round(value, 5) for value in _numbers(seen.lidar)],
        "loaded": bool(seen.loaded),
    }
    here = np.array([x, y])  # what will be added again is the rounded position
    turned = np.remainder(particles[:, 2] + np.pi, 2 * np.pi) - np.pi
    headings = np.rint(turned / ANGLE_STEP).astype("<i2")
    arrays = {
        "points": _steps(seen.points, here),
        "particles": np.column_stack([_steps(particles[:, :2], here), headings]).astype("<i2"),
        "path": _steps(seen.path, here),
        "boxes": _steps(seen.boxes, here),
    }
    return header, arrays


def _steps(points: Array, here: Array) -> Array:
    """[N, 2] int16: how many steps points lie away from here; what is too far lies at the end of the range."""
    offsets = np.rint((points - here) / POSITION_STEP)
    return np.clip(offsets, -32767, 32767).astype("<i2")


def _numbers(pose: Pose) -> list[float]:
    return [float(pose.x), float(pose.y), float(pose.theta)]


@dataclass
class _Tiles:
    """A map as tiles of percent, so that only what changed needs to be told.

    Tiles are counted from an anchor: a grid with the same angle, and a whole number of grid cells away from it, goes on
    with the same tiles; any other one begins anew.
    """

    anchor: Pose | None = None
    resolution: float = 0.0
    number: int = 0
    pixels: dict[tuple[int, int], NDArray[np.uint8]] = field(default_factory=dict)

    def changed(self, grid: OccupancyGrid) -> tuple[Header, Arrays]:
        """The header's fields and the arrays of the tiles that differ from before."""
        column, row = self._place(grid)
        height, width = grid.shape
        first_x, first_y = column // TILE, row // TILE
        columns, rows = (column + width - 1) // TILE - first_x + 1, (row + height - 1) // TILE - first_y + 1
        canvas = np.full((rows * TILE, columns * TILE), UNKNOWN_PERCENT, np.uint8)
        top, left = row - first_y * TILE, column - first_x * TILE
        canvas[top : top + height, left : left + width] = percent_of(grid)
        blocks = canvas.reshape(rows, TILE, columns, TILE).swapaxes(1, 2)
        now = {
            (first_x + x, first_y + y): blocks[y, x]
            for y in range(rows)
            for x in range(columns)
            if (blocks[y, x] != UNKNOWN_PERCENT).any() or (first_x + x, first_y + y) in self.pixels
        }
        blank = np.full((TILE, TILE), UNKNOWN_PERCENT, np.uint8)
        now.update({key: blank for key in self.pixels if key not in now})
        differing = [key for key, tile in now.items() if not np.array_equal(tile, self.pixels.get(key, blank))]
        self.pixels.update({key: now[key].copy() for key in differing})
        assert self.anchor is not None  # noqa: S101 - _place set it
        header = {"map": self.number, "origin": _numbers(self.anchor), "resolution": self.resolution}
        tiles = np.array(differing, "<i4").reshape(-1, 2)
        pixels = np.array([now[key] for key in differing], np.uint8).reshape(-1, TILE, TILE)
        return header, {"tiles": tiles, "pixels": pixels}

    def _place(self, grid: OccupancyGrid) -> tuple[int, int]:
        """Column and row of the grid's first cell, counted from the anchor; a new anchor where it does not fit."""
        if self.anchor is not None and grid.resolution == self.resolution:
            offset = self.anchor.inverse @ grid.origin
            column, row = round(offset.x / self.resolution), round(offset.y / self.resolution)
            misfit = math.hypot(offset.x - column * self.resolution, offset.y - row * self.resolution)
            if misfit < self.resolution / 10 and abs(offset.theta) < 1e-6:
                return column, row
        self.anchor, self.resolution = grid.origin, grid.resolution
        self.number += 1
        self.pixels.clear()
        return 0, 0


def percent_of(grid: OccupancyGrid) -> NDArray[np.uint8]:
    """[H, W] P(occupied) in percent as in nav_msgs/OccupancyGrid, in steps of 5; 255 for exactly 50 %: unknown."""
    percent: NDArray[np.uint8] = (np.rint(grid.probability * (100 / PERCENT_STEP)) * PERCENT_STEP).astype(np.uint8)
    percent[np.abs(grid.probability - 0.5) < 0.5 / 100] = UNKNOWN_PERCENT
    return percent


class Decoder:
    """Makes records of the frames of one trace, in their order.

    Args:
        source: What to call it in errors.
    """

    def __init__(self, source: str) -> None:
        self._source = source
        self._tiles: dict[tuple[int, int], NDArray[np.uint8]] = {}
        self._map = 0

    def decode(self, data: bytes, where: str) -> Record:
        """The record of a frame.

        Args:
            data: A whole frame.
            where: What to call it in errors.

        Raises:
            InputError: It is damaged, or says what no record can say.
        """
        try:
            header, arrays = _opened(data)
            makers: Mapping[str, Callable[[Header, Arrays], Record]] = {
                "Began": _began,
                "Said": _said,
                "Seen": _seen,
                "Explored": self._explored,
                "CellsLaid": _cells_laid,
                "Stepped": _stepped,
                "Perceived": _perceived,
                "Learnt": _learnt,
            }
            return makers[header["type"]](header, arrays)
        except (KeyError, ValueError, TypeError, AttributeError, struct.error) as error:
            raise InputError(self._source, where, f"is damaged: {type(error).__name__} {error}"[:200]) from error

    def _explored(self, header: Header, arrays: Arrays) -> Explored:
        """The map so far, put together from this frame's tiles and those before."""
        if header["map"] != self._map:
            self._map = header["map"]
            self._tiles.clear()
        keys = [(int(x), int(y)) for x, y in _shaped(arrays["tiles"], 2)]
        pixels = arrays["pixels"]
        if pixels.shape != (len(keys), TILE, TILE):
            raise ValueError(f"{len(keys)} tiles with pixels of shape {pixels.shape}")
        self._tiles.update(zip(keys, pixels, strict=True))
        resolution = _positive(header["resolution"])
        grid = _joined(self._tiles, resolution, _pose(header["origin"]))
        return Explored(_number(header["time"]), grid, _number(header["fraction"]), _number(header["frontier"]))


def _joined(tiles: Mapping[tuple[int, int], NDArray[np.uint8]], resolution: float, anchor: Pose) -> OccupancyGrid:
    """One grid of tiles."""
    if not tiles:
        return OccupancyGrid(np.full((1, 1), 0.5, np.float32), resolution, anchor)
    keys = np.array(sorted(tiles))
    low, high = keys.min(axis=0), keys.max(axis=0) + 1
    if int(np.prod(high - low)) * TILE**2 > LARGEST_MAP:
        raise ValueError("the map is too large")
    percent = np.full(tuple((high - low)[::-1] * TILE), UNKNOWN_PERCENT, np.uint8)
    for (x, y), tile in tiles.items():
        row, column = (y - low[1]) * TILE, (x - low[0]) * TILE
        percent[row : row + TILE, column : column + TILE] = tile
    probability = np.where(percent == UNKNOWN_PERCENT, 0.5, percent / 100.0).astype(np.float32)
    corner = anchor @ Pose(float(low[0]) * TILE * resolution, float(low[1]) * TILE * resolution)
    return OccupancyGrid(probability, resolution, corner)


def _opened(data: bytes) -> tuple[Header, dict[str, Array]]:
    """Header and arrays of a frame."""
    length, checksum, header_length = LENGTHS.unpack_from(data)
    if len(data) != 8 + length or zlib.crc32(data[8:]) != checksum:
        raise ValueError("its checksum does not fit")
    at = LENGTHS.size + header_length
    header = json.loads(data[LENGTHS.size : at])
    arrays = {}
    for name, dtype, shape in header["arrays"]:
        if dtype not in _DTYPES or not all(isinstance(side, int) and side >= 0 for side in shape):
            raise ValueError(f"an array of {dtype} {shape}")
        count = math.prod(shape)
        arrays[str(name)] = np.frombuffer(data, dtype, count, at).reshape(shape)
        at += count * np.dtype(dtype).itemsize
        at += -at % 4
    return header, arrays


def _number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{value!r} is no number")
    return float(value)


def _positive(value: object) -> float:
    if (number := _number(value)) <= 0:
        raise ValueError(f"{value!r} is not positive")
    return number


def _pose(values: list[object]) -> Pose:
    x, y, theta = (_number(value) for value in values)
    return Pose(x, y, theta)


def _shaped(array: Array, columns: int) -> Array:
    """The array, if it has so many columns."""
    if array.ndim != 2 or array.shape[1] != columns:
        raise ValueError(f"an array of shape {array.shape} instead of [N, {columns}]")
    return array


def _bits(text: object, signs: str) -> str:
    if not isinstance(text, str) or set(text) - set(signs):
        raise ValueError(f"{text!r} is no condition")
    return text


def _began(header: Header, arrays: Arrays) -> Began:
    return Began(
        task=str(header["task"]),
        subject=str(header["subject"]),
        learner=str(header["learner"]),
        terms=tuple(map(str, header["terms"])),
        actions=tuple(map(str, header["actions"])),
        robot_radius=_number(header["robot_radius"]),
        box_radius=_number(header["box_radius"]),
    )


def _said(header: Header, arrays: Arrays) -> Said:
    return Said(_number(header["time"]), str(header["phase"]), str(header["text"]))


def _seen(header: Header, arrays: Arrays) -> Seen:
    pose = _pose(header["pose"])
    here = np.array([pose.x, pose.y])

    def points(name: str) -> NDArray[np.float32]:
        placed: NDArray[np.float32] = (_shaped(arrays[name], 2) * POSITION_STEP + here).astype(np.float32)
        return placed

    cloud = _shaped(arrays["particles"], 3)
    particles = np.column_stack([cloud[:, :2] * POSITION_STEP + here, cloud[:, 2] * ANGLE_STEP]).astype(np.float32)
    return Seen(
        time=_number(header["time"]),
        pose=pose,
        lidar=_pose(header["lidar"]),
        points=points("points"),
        particles=particles,
        path=points("path"),
        boxes=points("boxes"),
        loaded=bool(header["loaded"]),
    )


def _cells_laid(header: Header, arrays: Arrays) -> CellsLaid:
    frame = CellFrame(_pose(header["origin"]), _positive(header["size"]))
    return CellsLaid(_number(header["time"]), frame, _shaped(arrays["warehouse"], 2), _shaped(arrays["walls"], 3))


def _stepped(header: Header, arrays: Arrays) -> Stepped:
    return Stepped(
        time=_number(header["time"]),
        condition=_bits(header["condition"], "01"),
        action=str(header["action"]),
        learning=bool(header["learning"]),
        moved=bool(header["moved"]),
        unknown=int(_number(header["unknown"])),
        delivered=int(_number(header["delivered"])),
        remaining=int(_number(header["remaining"])),
        plan=_shaped(arrays["plan"], 2),
    )


def _perceived(header: Header, arrays: Arrays) -> Perceived:
    things = (Thing(str(item["kind"]), str(item["name"]), tuple(item["values"].items())) for item in header["things"])
    return Perceived(_number(header["time"]), _bits(header["condition"], "01"), tuple(things))


def _learnt(header: Header, arrays: Arrays) -> Learnt:
    rules = (
        LearntRule(str(action), _bits(condition, "01*"), str(effect)) for action, condition, effect in header["rules"]
    )
    failures = (
        (str(action), tuple(_bits(condition, "01*") for condition in conditions))
        for action, conditions in header["failures"].items()
    )
    return Learnt(_number(header["time"]), tuple(rules), tuple(failures))
