"""The trace codec: encodes records as frames for trace files and for the page, and decodes them.

Positions near the robot are rounded to 5 mm and angles to 0.1 mrad; of the map only changed tiles are stored
(`wherry.trace.map_tiles`). Tags of record types and keys of headers are part of the file format, so they do not follow
the names of classes and attributes.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wherry.errors import InputError
from wherry.space.frame import CellFrame
from wherry.space.pose import MAX_COORDINATE, Pose
from wherry.trace.framing import Array, Arrays, Header, decode_frame, encode_frame
from wherry.trace.map_tiles import TileDecoder, TileEncoder
from wherry.trace.records import (
    CellLayout,
    LearntModel,
    LearntRule,
    MapUpdate,
    Narration,
    ObjectSnapshot,
    PerceivedState,
    Phase,
    Record,
    RobotSnapshot,
    RunStarted,
    StepTaken,
)

MAX_PARTICLES = 2_000  # particles in a frame; more are indistinguishable on a screen
POSITION_STEP = 0.005  # m, unit of stored positions
ANGLE_STEP = 1e-4  # rad, unit of stored angles
MAX_NUMBER = 1e12  # largest number in a frame, such as a time in s
DAMAGE = (KeyError, ValueError, TypeError, AttributeError, OverflowError, RecursionError, struct.error)
"""What decoding a damaged frame raises."""

TAGS: Mapping[type[Record], str] = {
    RunStarted: "Began",
    Narration: "Said",
    RobotSnapshot: "Seen",
    MapUpdate: "Explored",
    CellLayout: "CellsLaid",
    StepTaken: "Stepped",
    PerceivedState: "Perceived",
    LearntModel: "Learnt",
}
"""The tag of each record type in trace files and in the page's scripts."""

FrameParts = tuple[Header, Arrays]
"""Header and arrays of a frame."""


class Encoder:
    """Encodes the records of one trace, in their order.

    Args:
        max_particles: Particles stored per `RobotSnapshot`; larger sets are subsampled evenly.
    """

    def __init__(self, max_particles: int = MAX_PARTICLES) -> None:
        self._max_particles = max_particles
        self._tiles = TileEncoder()
        self._encoders: Mapping[type[Record], Callable[[Any], FrameParts]] = {
            RunStarted: _encode_run_started,
            Narration: _encode_narration,
            RobotSnapshot: self._encode_snapshot,
            MapUpdate: self._encode_map_update,
            CellLayout: _encode_cell_layout,
            StepTaken: _encode_step,
            PerceivedState: _encode_state,
            LearntModel: _encode_model,
        }

    def encode(self, record: Record) -> bytes:
        """The record's frame."""
        header, arrays = self._encoders[type(record)](record)
        return encode_frame({"type": TAGS[type(record)], **header}, arrays)

    def _encode_snapshot(self, snapshot: RobotSnapshot) -> FrameParts:
        """Encode positions relative to the robot, in units of `POSITION_STEP`."""
        particles = snapshot.particles[:: max(1, math.ceil(len(snapshot.particles) / self._max_particles))]
        x, y, theta = (round(value, 5) for value in _pose_values(snapshot.pose))
        header = {
            "time": round(snapshot.time, 4),
            "pose": [x, y, theta],
            "lidar": [round(value, 5) for value in _pose_values(snapshot.lidar)],
            "loaded": bool(snapshot.has_load),
        }
        position = np.array([x, y])  # the rounded one, which the decoder adds
        wrapped = np.remainder(particles[:, 2] + np.pi, 2 * np.pi) - np.pi
        headings = np.rint(wrapped / ANGLE_STEP).astype("<i2")
        return header, {
            "points": _position_steps(snapshot.points, position),
            "particles": np.column_stack([_position_steps(particles[:, :2], position), headings]).astype("<i2"),
            "path": _position_steps(snapshot.path, position),
            "boxes": _position_steps(snapshot.boxes, position),
        }

    def _encode_map_update(self, update: MapUpdate) -> FrameParts:
        keys, percent = self._tiles.changed_tiles(update.grid)
        header = {
            "time": update.time,
            "fraction": update.explored_fraction,
            "frontier": update.frontier_length,
            "map": self._tiles.anchor_number,
            "origin": _pose_values(self._tiles.anchor),
            "resolution": self._tiles.resolution,
        }
        return header, {"tiles": keys, "pixels": percent}


class Decoder:
    """Decodes the frames of one trace, in their order.

    Args:
        source: Name of the trace in errors.
    """

    def __init__(self, source: str) -> None:
        self._source = source
        self._tiles = TileDecoder()
        decoders: Mapping[type[Record], Callable[[Header, Arrays], Record]] = {
            RunStarted: _decode_run_started,
            Narration: _decode_narration,
            RobotSnapshot: _decode_snapshot,
            MapUpdate: self._decode_map_update,
            CellLayout: _decode_cell_layout,
            StepTaken: _decode_step,
            PerceivedState: _decode_state,
            LearntModel: _decode_model,
        }
        self._decoders = {TAGS[record]: decode for record, decode in decoders.items()}

    def decode(self, frame: bytes, location: str) -> Record:
        """The record of a complete frame.

        Args:
            frame: The frame.
            location: Name of the frame in errors.

        Raises:
            InputError: The frame is damaged, or a value in it is invalid.
        """
        try:
            header, arrays = decode_frame(frame)
            return self._decoders[header["type"]](header, arrays)
        except DAMAGE as error:
            raise InputError(self._source, location, f"is damaged: {type(error).__name__} {error}"[:200]) from error

    def _decode_map_update(self, header: Header, arrays: Arrays) -> MapUpdate:
        """Decode the map of all tiles up to this frame."""
        self._tiles.update(header["map"], _array_with_columns(arrays["tiles"], 2), arrays["pixels"])
        grid = self._tiles.grid(_decode_pose(header["origin"]), _positive_number(header["resolution"]))
        time, fraction, frontier = (_finite_number(header[key]) for key in ("time", "fraction", "frontier"))
        return MapUpdate(time, grid, fraction, frontier)


def _encode_run_started(started: RunStarted) -> FrameParts:
    return {name: getattr(started, name) for name in RunStarted.__slots__}, {}


def _decode_run_started(header: Header, arrays: Arrays) -> RunStarted:
    return RunStarted(
        task=str(header["task"]),
        subject=str(header["subject"]),
        learner=str(header["learner"]),
        terms=tuple(map(str, header["terms"])),
        actions=tuple(map(str, header["actions"])),
        robot_radius=_finite_number(header["robot_radius"]),
        box_radius=_finite_number(header["box_radius"]),
    )


def _encode_narration(narration: Narration) -> FrameParts:
    return {"time": narration.time, "phase": narration.phase, "text": narration.text}, {}


def _decode_narration(header: Header, arrays: Arrays) -> Narration:
    return Narration(_finite_number(header["time"]), Phase(header["phase"]), str(header["text"]))


def _decode_snapshot(header: Header, arrays: Arrays) -> RobotSnapshot:
    pose = _decode_pose(header["pose"])
    position = np.array([pose.x, pose.y])

    def points(name: str) -> NDArray[np.float32]:
        steps = _array_with_columns(arrays[name], 2)
        return np.asarray(steps * POSITION_STEP + position, np.float32)

    encoded = _array_with_columns(arrays["particles"], 3)
    particles = np.column_stack([encoded[:, :2] * POSITION_STEP + position, encoded[:, 2] * ANGLE_STEP])
    return RobotSnapshot(
        time=_finite_number(header["time"]),
        pose=pose,
        lidar=_decode_pose(header["lidar"]),
        points=points("points"),
        particles=particles.astype(np.float32),
        path=points("path"),
        boxes=points("boxes"),
        has_load=bool(header["loaded"]),
    )


def _encode_cell_layout(layout: CellLayout) -> FrameParts:
    header = {"time": layout.time, "origin": _pose_values(layout.frame.origin), "size": layout.frame.cell_size}
    return header, {"warehouse": layout.warehouse.astype("<i4"), "walls": layout.walls.astype("<i4")}


def _decode_cell_layout(header: Header, arrays: Arrays) -> CellLayout:
    frame = CellFrame(_decode_pose(header["origin"]), _positive_number(header["size"]))
    warehouse, walls = _array_with_columns(arrays["warehouse"], 2), _array_with_columns(arrays["walls"], 3)
    return CellLayout(_finite_number(header["time"]), frame, warehouse, walls)


def _encode_step(step: StepTaken) -> FrameParts:
    header = {
        "time": step.time,
        "condition": step.condition,
        "action": step.action,
        "learning": step.is_learning,
        "moved": step.has_effect,
        "unknown": step.unknown_pairs,
        "delivered": step.delivered,
        "remaining": step.remaining,
    }
    return header, {"plan": step.plan.astype("<f4")}


def _decode_step(header: Header, arrays: Arrays) -> StepTaken:
    return StepTaken(
        time=_finite_number(header["time"]),
        condition=_condition_string(header["condition"], "01"),
        action=str(header["action"]),
        is_learning=bool(header["learning"]),
        has_effect=bool(header["moved"]),
        unknown_pairs=int(_finite_number(header["unknown"])),
        delivered=int(_finite_number(header["delivered"])),
        remaining=int(_finite_number(header["remaining"])),
        plan=_array_with_columns(arrays["plan"], 2),
    )


def _encode_state(state: PerceivedState) -> FrameParts:
    objects = [{"kind": one.class_name, "name": one.name, "values": dict(one.attributes)} for one in state.objects]
    return {"time": state.time, "condition": state.condition, "things": objects}, {}


def _decode_state(header: Header, arrays: Arrays) -> PerceivedState:
    objects = (
        ObjectSnapshot(str(one["kind"]), str(one["name"]), tuple(one["values"].items())) for one in header["things"]
    )
    return PerceivedState(_finite_number(header["time"]), _condition_string(header["condition"], "01"), tuple(objects))


def _encode_model(model: LearntModel) -> FrameParts:
    rules = [[rule.action, rule.condition, rule.effect] for rule in model.rules]
    return {"time": model.time, "rules": rules, "failures": dict(model.failures)}, {}


def _decode_model(header: Header, arrays: Arrays) -> LearntModel:
    rules = (
        LearntRule(str(action), _condition_string(condition, "01*"), str(effect))
        for action, condition, effect in header["rules"]
    )
    failures = (
        (str(action), tuple(_condition_string(condition, "01*") for condition in conditions))
        for action, conditions in header["failures"].items()
    )
    return LearntModel(_finite_number(header["time"]), tuple(rules), tuple(failures))


def _position_steps(points: Array, origin: Array) -> Array:
    """[N, 2] int16, points relative to an origin in units of `POSITION_STEP`; clipped to the range of int16."""
    offsets = np.rint((points - origin) / POSITION_STEP)
    return np.clip(offsets, -32767, 32767).astype("<i2")


def _pose_values(pose: Pose) -> list[float]:
    return [float(pose.x), float(pose.y), float(pose.theta)]


def _decode_pose(values: list[object]) -> Pose:
    x, y, theta = (_finite_number(value) for value in values)
    if max(abs(x), abs(y), abs(theta)) > MAX_COORDINATE:
        raise ValueError(f"a pose is beyond {MAX_COORDINATE:g} m")
    return Pose(x, y, theta)


def _finite_number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= MAX_NUMBER:
        raise ValueError(f"{str(value)[:20]!r} is not a number, or too large")
    return float(value)


def _positive_number(value: object) -> float:
    if (number := _finite_number(value)) <= 0:
        raise ValueError(f"{value!r} is not positive")
    return number


def _array_with_columns(array: Array, columns: int) -> Array:
    """The array, checked to be of shape [N, columns]."""
    if array.ndim != 2 or array.shape[1] != columns:
        raise ValueError(f"array of shape {array.shape} instead of [N, {columns}]")
    if not np.isfinite(array).all():
        raise ValueError("an array has a number that is not finite")
    return array


def _condition_string(text: object, symbols: str) -> str:
    if not isinstance(text, str) or set(text) - set(symbols):
        raise ValueError(f"{text!r} is not a condition")
    return text
