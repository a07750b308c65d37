"""Recordings for the Rerun viewer: map, scan, particles and robot in 3D; terms and counts as time series."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from wherry.errors import InputError
from wherry.files import partial_file
from wherry.oomdp.conditions import Condition
from wherry.robot import BOX_HEIGHT
from wherry.trace.records import (
    CellLayout,
    LearntModel,
    MapUpdate,
    Narration,
    PerceivedState,
    Record,
    RobotSnapshot,
    RunStarted,
    Sink,
    StepTaken,
)

if TYPE_CHECKING:
    import rerun

BLUE, RED, GREEN, BROWN, YELLOW = (31, 111, 235), (209, 36, 47), (26, 156, 75), (160, 98, 45), (244, 196, 48)
WHITE = (240, 240, 240)
PATH_HEIGHT, PARTICLE_HEIGHT, SCAN_HEIGHT = 0.02, 0.03, 0.2  # m above the floor; different, so that none is covered
ROBOT_HEIGHT = 0.15  # m, height of the drawn cylinder
PARTICLE_LENGTH = 0.12  # m, length of a particle's arrow
UNKNOWN, FREE, OCCUPIED = 255, 0, 100  # values of nav_msgs/OccupancyGrid as unsigned bytes


@contextmanager
def rerun_recording(path: Path) -> Iterator[Sink]:
    """A sink that writes an .rrd file, which gets its name when the context ends.

    Args:
        path: The .rrd file.

    Raises:
        InputError: rerun-sdk is not installed, or the file cannot be written.
    """
    try:
        import rerun  # noqa: PLC0415 - an optional dependency
    except ImportError as error:
        raise InputError("--rerun", "rerun-sdk", 'is not installed: pip install "wherry[rerun]"') from error
    with partial_file(path) as partial:
        stream = rerun.RecordingStream("wherry")
        stream.save(partial, default_blueprint=_blueprint())
        try:
            yield RerunSink(stream)
        finally:
            stream.disconnect()


def _blueprint() -> rerun.blueprint.Blueprint:
    """The viewer's layout: the 3D view on the left; log, rules, terms and counts on the right."""
    from rerun import blueprint  # noqa: PLC0415

    return blueprint.Blueprint(
        blueprint.Horizontal(
            blueprint.Spatial3DView(origin="/map", name="World"),
            blueprint.Vertical(
                blueprint.TextLogView(origin="/log", name="Log"),
                blueprint.TextDocumentView(origin="/rules", name="Learnt rules"),
                blueprint.StateTimelineView(origin="/terms", name="Terms"),
                blueprint.TimeSeriesView(origin="/counts", name="Counts"),
            ),
            column_shares=[3, 2],
        ),
        collapse_panels=True,
    )


class RerunSink:
    """A sink that logs records to a recording stream.

    Args:
        stream: An open recording stream.
    """

    def __init__(self, stream: rerun.RecordingStream) -> None:
        self._stream = stream
        self._terms: tuple[str, ...] = ()
        self._robot_radius = self._box_radius = 0.0

    def __call__(self, record: Record) -> None:
        """Log a record at its time."""
        if isinstance(record, RunStarted):
            self._log_start(record)
            return
        self._stream.set_time("robot", duration=record.time)
        match record:
            case Narration():
                self._log("log", "TextLog", record.text, level=record.phase.upper())
            case MapUpdate():
                self._log_map(record)
            case RobotSnapshot():
                self._log_snapshot(record)
            case CellLayout():
                self._log_cell_layout(record)
            case StepTaken():
                self._log_step(record)
            case PerceivedState():
                self._log_terms(record.condition)
            case LearntModel():
                self._log_rules(record)

    def _log(
        self, entity: str | list[object], archetype: str, *values: object, static: bool = False, **fields: object
    ) -> None:
        """Log an entity as an archetype of the module `rerun`, given by name."""
        import rerun  # noqa: PLC0415

        data: Any = getattr(rerun, archetype)(*values, **fields)
        self._stream.log(entity, data, static=static)

    def _log_start(self, record: RunStarted) -> None:
        self._terms = record.terms
        self._robot_radius, self._box_radius = record.robot_radius, record.box_radius
        self._stream.send_recording_name(f"{record.task} {record.subject}")
        radius = record.robot_radius
        if radius:
            self._log(
                "map/robot/body",
                "Cylinders3D",
                lengths=[ROBOT_HEIGHT],
                radii=[radius],
                centers=[(0.0, 0.0, ROBOT_HEIGHT / 2)],
                colors=[WHITE],
                static=True,
            )
            self._log(
                "map/robot/heading", "Arrows3D", origins=[(0, 0, ROBOT_HEIGHT)], vectors=[(radius, 0, 0)], static=True
            )

    def _log_map(self, record: MapUpdate) -> None:
        import rerun  # noqa: PLC0415

        grid = record.grid
        shades = np.where(grid.unknown, UNKNOWN, np.where(grid.occupied, OCCUPIED, FREE)).astype(np.uint8)
        height, width = shades.shape
        self._log(
            "map/grid",
            "GridMap",
            # The first row of an image is at the top, at the largest y.
            data=np.ascontiguousarray(shades[::-1]).tobytes(),
            format=rerun.components.ImageFormat(width=width, height=height, color_model="L", channel_datatype="U8"),
            cell_size=grid.resolution,
            translation=[grid.origin.x, grid.origin.y, 0.0],
            rotation_axis_angle=rerun.RotationAxisAngle((0.0, 0.0, 1.0), radians=grid.origin.theta),
            colormap=rerun.components.Colormap.RvizMap,
        )
        self._log_count("mapped", record.explored_fraction)

    def _log_snapshot(self, record: RobotSnapshot) -> None:
        pose = record.pose
        self._log("map/robot", "Transform3D", translation=[pose.x, pose.y, 0.0], quaternion=_quaternion(pose.theta))
        self._log("map/scan", "Points3D", _raised(record.points, SCAN_HEIGHT), colors=[BLUE], radii=[0.015])
        x, y, theta = record.particles.T if len(record.particles) else np.zeros((3, 0), np.float32)
        self._log(
            "map/particles",
            "Arrows3D",
            origins=_raised(np.column_stack([x, y]), PARTICLE_HEIGHT),
            vectors=_raised(PARTICLE_LENGTH * np.column_stack([np.cos(theta), np.sin(theta)]), 0.0),
            colors=[RED],
            radii=[0.004],
        )
        self._log_line("map/path", record.path)
        self._log_boxes("map/boxes", record.boxes)
        load = np.zeros((1 if record.has_load else 0, 2), np.float32)
        self._log_boxes("map/robot/load", load)

    def _log_cell_layout(self, record: CellLayout) -> None:
        half = record.frame.cell_size / 2
        centres = [record.frame.centre(int(x), int(y)) for x, y in record.warehouse]
        self._log(
            "map/warehouse",
            "Boxes3D",
            centers=_raised(np.array(centres).reshape(-1, 2), 0.005),
            half_sizes=[(half, half, 0.005)] * len(centres),
            quaternions=[_quaternion(record.frame.origin.theta)] * len(centres),
            colors=[YELLOW],
            fill_mode="solid",
        )

    def _log_step(self, record: StepTaken) -> None:
        self._log_line("map/plan", record.plan)
        self._log_count("unknown", record.unknown_pairs)
        self._log_count("delivered", record.delivered)
        self._log_count("remaining", record.remaining)

    def _log_terms(self, condition: str) -> None:
        for name, bit in zip(self._terms, condition, strict=False):
            self._log(["terms", name], "StateChange", state="true" if bit == "1" else "false")

    def _log_rules(self, record: LearntModel) -> None:
        lines = [f"- `{rule.action}`: {rule.effect} – {self._describe(rule.condition)}" for rule in record.rules]
        for action, conditions in record.failures:
            lines.append(f"- `{action}`: no effect")
            lines += [f"    - {self._describe(condition)}" for condition in conditions]
        self._log("rules", "TextDocument", "\n".join(lines), media_type="text/markdown")

    def _describe(self, condition: str) -> str:
        """The condition as terms: "if touch_N(robot, wall) and not box.in_bot", or "always"."""
        description = Condition.parse(condition).describe(self._terms)
        return description if description == "always" else f"if {description}"

    def _log_count(self, name: str, value: float) -> None:
        self._log(f"counts/{name}", "Scalars", float(value))

    def _log_line(self, entity: str, points: NDArray[np.float32]) -> None:
        strips = [_raised(points, PATH_HEIGHT)] if len(points) > 1 else []
        self._log(entity, "LineStrips3D", strips, colors=[GREEN], radii=[0.02])

    def _log_boxes(self, entity: str, positions: NDArray[np.float32]) -> None:
        count = len(positions)
        self._log(
            entity,
            "Cylinders3D",
            lengths=[BOX_HEIGHT] * count,
            radii=[self._box_radius] * count,
            centers=_raised(positions, BOX_HEIGHT / 2),
            colors=[BROWN],
            fill_mode="solid",
        )


def _raised(points: NDArray[Any], height: float) -> NDArray[np.float32]:
    """[N, 3] m, points with the x and y of [N, 2] `points` at a height above the floor, m."""
    return np.column_stack([points, np.full(len(points), height)]).astype(np.float32)


def _quaternion(theta: float) -> list[float]:
    """Quaternion (x, y, z, w) of a rotation about the vertical axis, rad."""
    return [0.0, 0.0, math.sin(theta / 2), math.cos(theta / 2)]
