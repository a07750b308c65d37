"""A trace as a recording for the Rerun viewer: map, scan, particles and robot in space; terms and counts in time."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from wherry.errors import InputError
from wherry.files import growing_file
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
PATH_HEIGHT, PARTICLE_HEIGHT, SCAN_HEIGHT = 0.02, 0.03, 0.2  # m over the floor, so that nothing hides anything
ROBOT_HEIGHT, BOX_HEIGHT = 0.15, 0.3  # m
ARROW = 0.12  # m, length of a particle
UNKNOWN, FREE, OCCUPIED = 255, 0, 100  # the values of nav_msgs/OccupancyGrid, as unsigned bytes


@contextmanager
def rerun_recording(path: Path) -> Iterator[Sink]:
    """A sink that writes a .rrd file, which has its name when the run is over.

    Args:
        path: The file.

    Raises:
        InputError: The viewer's library is not installed, or the file cannot be written.
    """
    try:
        import rerun  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise InputError("--rerun", "rerun-sdk", 'is not installed: pip install "wherry[rerun]"') from error
    with growing_file(path) as unfinished:
        stream = rerun.RecordingStream("wherry")
        stream.save(unfinished, default_blueprint=_layout())
        try:
            yield RerunSink(stream)
        finally:
            stream.disconnect()


def _layout() -> rerun.blueprint.Blueprint:
    """Space on the left; the log, the rules and what changes over time on the right."""
    from rerun import blueprint  # noqa: PLC0415

    return blueprint.Blueprint(
        blueprint.Horizontal(
            blueprint.Spatial3DView(origin="/map", name="World"),
            blueprint.Vertical(
                blueprint.TextLogView(origin="/log", name="What the robot does and why"),
                blueprint.TextDocumentView(origin="/rules", name="What it learnt"),
                blueprint.StateTimelineView(origin="/terms", name="Terms"),
                blueprint.TimeSeriesView(origin="/counts", name="Counts"),
            ),
            column_shares=[3, 2],
        ),
        collapse_panels=True,
    )


class RerunSink:
    """Logs every record to a stream.

    Args:
        stream: Where to.
    """

    def __init__(self, stream: rerun.RecordingStream) -> None:
        self._stream = stream
        self._terms: tuple[str, ...] = ()
        self._robot_radius = self._box_radius = 0.0

    def __call__(self, record: Record) -> None:
        """Log one record at its time."""
        if isinstance(record, RunStarted):
            self._begin(record)
            return
        self._stream.set_time("robot", duration=record.time)
        match record:
            case Narration():
                self._log("log", "TextLog", record.text, level=record.phase.upper())
            case MapUpdate():
                self._map(record)
            case RobotSnapshot():
                self._sight(record)
            case CellLayout():
                self._cells(record)
            case StepTaken():
                self._step(record)
            case PerceivedState():
                for name, sign in zip(self._terms, record.condition, strict=False):
                    self._log(["terms", name], "StateChange", state="true" if sign == "1" else "false")
            case LearntModel():
                self._rules(record)

    def _log(
        self, entity: str | list[object], archetype: str, *values: object, static: bool = False, **fields: object
    ) -> None:
        """Log one thing by its archetype's name."""
        import rerun  # noqa: PLC0415

        made: Any = getattr(rerun, archetype)(*values, **fields)
        self._stream.log(entity, made, static=static)

    def _begin(self, record: RunStarted) -> None:
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

    def _map(self, record: MapUpdate) -> None:
        import rerun  # noqa: PLC0415

        grid = record.grid
        shades = np.where(grid.unknown, UNKNOWN, np.where(grid.occupied, OCCUPIED, FREE)).astype(np.uint8)
        height, width = shades.shape
        self._log(
            "map/grid",
            "GridMap",
            # An image's first row is the northernmost.
            data=np.ascontiguousarray(shades[::-1]).tobytes(),
            format=rerun.components.ImageFormat(width=width, height=height, color_model="L", channel_datatype="U8"),
            cell_size=grid.resolution,
            translation=[grid.origin.x, grid.origin.y, 0.0],
            rotation_axis_angle=rerun.RotationAxisAngle((0.0, 0.0, 1.0), radians=grid.origin.theta),
            colormap=rerun.components.Colormap.RvizMap,
        )
        self._count("mapped", record.explored_fraction)

    def _sight(self, record: RobotSnapshot) -> None:
        pose = record.pose
        self._log("map/robot", "Transform3D", translation=[pose.x, pose.y, 0.0], quaternion=_quaternion(pose.theta))
        self._log("map/scan", "Points3D", _raised(record.points, SCAN_HEIGHT), colors=[BLUE], radii=[0.015])
        x, y, theta = record.particles.T if len(record.particles) else np.zeros((3, 0), np.float32)
        self._log(
            "map/particles",
            "Arrows3D",
            origins=_raised(np.column_stack([x, y]), PARTICLE_HEIGHT),
            vectors=_raised(ARROW * np.column_stack([np.cos(theta), np.sin(theta)]), 0.0),
            colors=[RED],
            radii=[0.004],
        )
        self._line("map/path", record.path)
        self._boxes("map/boxes", record.boxes)
        load = np.zeros((1 if record.has_load else 0, 2), np.float32)
        self._boxes("map/robot/load", load)

    def _cells(self, record: CellLayout) -> None:
        half = record.frame.cell_size / 2
        middles = [record.frame.centre(int(x), int(y)) for x, y in record.warehouse]
        self._log(
            "map/warehouse",
            "Boxes3D",
            centers=_raised(np.array(middles).reshape(-1, 2), 0.005),
            half_sizes=[(half, half, 0.005)] * len(middles),
            quaternions=[_quaternion(record.frame.origin.theta)] * len(middles),
            colors=[YELLOW],
            fill_mode="solid",
        )

    def _step(self, record: StepTaken) -> None:
        self._line("map/plan", record.plan)
        self._count("unknown", record.unknown_pairs)
        self._count("delivered", record.delivered)
        self._count("remaining", record.remaining)

    def _rules(self, record: LearntModel) -> None:
        rules = [f"- `{rule.action}` `{rule.condition}` {rule.effect}" for rule in record.rules]
        failures = [
            f"- `{action}` does nothing in " + ", ".join(f"`{c}`" for c in cs) for action, cs in record.failures
        ]
        self._log("rules", "TextDocument", "\n".join(rules + failures), media_type="text/markdown")

    def _count(self, name: str, value: float) -> None:
        self._log(f"counts/{name}", "Scalars", float(value))

    def _line(self, entity: str, points: NDArray[np.float32]) -> None:
        strips = [_raised(points, PATH_HEIGHT)] if len(points) > 1 else []
        self._log(entity, "LineStrips3D", strips, colors=[GREEN], radii=[0.02])

    def _boxes(self, entity: str, places: NDArray[np.float32]) -> None:
        count = len(places)
        self._log(
            entity,
            "Cylinders3D",
            lengths=[BOX_HEIGHT] * count,
            radii=[self._box_radius] * count,
            centers=_raised(places, BOX_HEIGHT / 2),
            colors=[BROWN],
            fill_mode="solid",
        )


def _raised(points: NDArray[Any], height: float) -> NDArray[np.float32]:
    """[N, 3] m: points of the floor, [N, 2], at a height."""
    return np.column_stack([points, np.full(len(points), height)]).astype(np.float32)


def _quaternion(theta: float) -> list[float]:
    """x, y, z, w of a turn about the vertical."""
    return [0.0, 0.0, math.sin(theta / 2), math.cos(theta / 2)]
