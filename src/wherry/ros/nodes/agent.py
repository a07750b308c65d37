"""What the agent knows, for RViz and whoever else listens: its trace as ROS messages.

``/map`` (latched), ``/particlecloud``, ``/plan``, ``/predicted_path``, ``/markers``, ``/diagnostics``, and on ``/tf``
the transform from map to odom. A heartbeat repeats the transform, so that it never grows old while the agent thinks,
and what was drawn once, for those who come later. What is seen and believed is drawn once the velocity that came of it
has been sent: hundreds of particles take longer to put into a message than the robot takes to decide.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator, Sequence
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from wherry.ros import messages as ros
from wherry.ros.diagnostics import OK, diagnostic_array, diagnostic_status
from wherry.ros.encoding import (
    encode_header,
    encode_occupancy_grid,
    encode_path,
    encode_pose,
    encode_pose_array,
    encode_transform,
)
from wherry.ros.names import RosNames
from wherry.ros.nodes.robot import RosRobot
from wherry.ros.transforms import StampedTransform
from wherry.ros.transports.protocol import Transport
from wherry.space.frame import CellFrame
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import IDENTITY, Pose
from wherry.trace.records import (
    CellLayout,
    LearntModel,
    MapUpdate,
    Narration,
    PerceivedState,
    Record,
    RobotSnapshot,
    RunStarted,
    StepTaken,
)

HEARTBEAT = 0.05  # s
TOLERANCE = 0.1  # s that map → odom is dated ahead, as amcl does, so that what comes meanwhile can be transformed
MOST_PARTICLES = 500  # that are shown
LONGEST_UNDRAWN = 1.0  # s; an agent that has no time to spare draws no more often
BOX_HEIGHT, TILE_HEIGHT, LINE_WIDTH, TEXT_HEIGHT = 0.30, 0.01, 0.01, 0.15  # m
RED, GREEN = ros.ColorRGBA(0.75, 0.18, 0.15, 1.0), ros.ColorRGBA(0.30, 0.62, 0.38, 0.6)
GREY, BLACK = ros.ColorRGBA(0.4, 0.4, 0.4, 0.5), ros.ColorRGBA(0.0, 0.0, 0.0, 1.0)
TRUE_COLOUR, FALSE_COLOUR = ros.ColorRGBA(0.95, 0.55, 0.10, 1.0), ros.ColorRGBA(0.35, 0.35, 0.35, 1.0)


class AgentNode:
    """A sink that publishes; use it as a context manager around the run.

    Args:
        robot: The robot of which the agent tells; it knows odometry and time.
        transport: ROS.
        names: What everything is called.
        owns_map: Whether the map is the agent's own; otherwise somebody else publishes it.
        owns_pose: Whether the transform from map to odom is the agent's own.
    """

    def __init__(
        self, robot: RosRobot, transport: Transport, names: RosNames, *, owns_map: bool = True, owns_pose: bool = True
    ) -> None:
        self._robot = robot
        self._transport = transport
        self._topics, self._frames = names.topics, names.frames
        self._diagnostics_period = 1 / names.rates.diagnostics
        self._owns_map, self._owns_pose = owns_map, owns_pose
        self._map_from_odom = IDENTITY
        self._box_radius = 0.0
        self._terms: tuple[str, ...] = ()
        self._narration: Narration | None = None
        self._condition = ""
        self._shown_boxes = 0
        self._lasting: tuple[ros.Marker, ...] = ()
        self._dated = 0.0  # s, of the last transform
        self._undrawn: RobotSnapshot | None = None
        self._drawn = math.inf  # s, of what was drawn last, or else of what came first
        robot.in_spare_time = self._draw_seen
        self._stopped = threading.Event()
        self._heart = threading.Thread(target=self._beat, name="heartbeat", daemon=True)

    def __enter__(self) -> Self:
        for topic in (self._topics.plan, self._topics.predicted_path):
            self._transport.advertise(topic)
        self._heart.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stopped.set()
        self._heart.join()
        self._robot.in_spare_time = lambda: None
        if error is None:
            self._draw_seen()

    def __call__(self, record: Record) -> None:
        """Publish what a record tells."""
        match record:
            case RunStarted():
                self._box_radius, self._terms = record.box_radius, record.terms
            case Narration():
                self._narration = record
                self._tell_diagnostics()
            case MapUpdate():
                self.tell_map(record.grid)
            case RobotSnapshot():
                self._take_in(record)
            case CellLayout():
                self._lasting = tuple(self._cells(record))
                self._draw(self._lasting)
            case StepTaken():
                plan = encode_path(record.plan, record.time, self._frames.map)
                self._transport.publish(self._topics.plan, plan)
            case PerceivedState():
                self._condition = record.condition
            case LearntModel():
                pass

    def tell_map(self, grid: OccupancyGrid) -> None:
        """Publish a map, if maps are the agent's to publish."""
        if self._owns_map:
            self._transport.publish(self._topics.map, encode_occupancy_grid(grid, self._robot.time, self._frames.map))

    # ---- the heartbeat

    def _beat(self) -> None:
        """Say again and again where odom is in the map, and how everything is."""
        beats = 0
        while not self._stopped.wait(HEARTBEAT):
            if self._owns_pose:
                self._tell_transform()
            beats += 1
            if beats * HEARTBEAT >= self._diagnostics_period:
                beats = 0
                self._tell_diagnostics()
                self._draw(self._lasting)

    def _tell_transform(self) -> None:
        now = self._robot.time
        if now <= self._dated:
            return  # transforms of the same instant are told once
        self._dated = now
        link = StampedTransform(self._frames.map, self._frames.odom, now + TOLERANCE, self._map_from_odom)
        self._transport.publish(self._topics.tf, ros.TFMessage((encode_transform(link),)))

    def _tell_diagnostics(self) -> None:
        text, phase = ("", "") if self._narration is None else (self._narration.text, self._narration.phase)
        agent = diagnostic_status("wherry: agent", OK, text, {"phase": phase, "condition": self._condition})
        message = diagnostic_array(self._robot.time, agent, self._robot.status())
        self._transport.publish(self._topics.diagnostics, message)

    # ---- what is seen and believed

    def _take_in(self, seen: RobotSnapshot) -> None:
        """Take note of where the robot is; everything else is drawn later."""
        odometry = self._robot.odometry
        if odometry is not None:
            self._map_from_odom = seen.pose @ odometry.pose.inverse
        self._undrawn = seen
        self._drawn = min(self._drawn, seen.time)
        if seen.time - self._drawn >= LONGEST_UNDRAWN:
            self._draw_seen()

    def _draw_seen(self) -> None:
        """Publish what was seen last, unless it has been; what came too fast for that is left out."""
        seen, self._undrawn = self._undrawn, None
        if seen is None:
            return
        self._drawn = seen.time
        frame, topics = self._frames.map, self._topics
        cloud = encode_pose_array(_some(seen.particles, MOST_PARTICLES), seen.time, frame)
        self._transport.publish(topics.particlecloud, cloud)
        self._transport.publish(topics.predicted_path, encode_path(seen.path, seen.time, frame))
        self._draw((*self._boxes(seen), *self._condition_bits(seen)))

    def _draw(self, markers: tuple[ros.Marker, ...]) -> None:
        if markers:
            self._transport.publish(self._topics.markers, ros.MarkerArray(markers))

    def _boxes(self, seen: RobotSnapshot) -> Iterator[ros.Marker]:
        """A cylinder for each box on the floor, and one on the robot if it carries one; those that went are removed."""
        places = [Pose(float(x), float(y)) for x, y in seen.boxes]
        if seen.has_load:
            places.append(seen.pose)
        diameter = 2 * self._box_radius
        header = encode_header(seen.time, self._frames.map)
        for number, place in enumerate(places):
            yield ros.Marker(
                header,
                "boxes",
                number,
                ros.Marker.CYLINDER,
                pose=encode_pose(place, BOX_HEIGHT / 2),
                scale=ros.Vector3(diameter, diameter, BOX_HEIGHT),
                color=RED,
            )
        for number in range(len(places), self._shown_boxes):
            yield ros.Marker(header, "boxes", number, action=ros.Marker.DELETE)
        self._shown_boxes = len(places)

    def _condition_bits(self, seen: RobotSnapshot) -> Iterator[ros.Marker]:
        """The condition above the robot, a line a term that holds; and the sign of each term in a row of squares."""
        if not self._condition:
            return
        header = encode_header(seen.time, self._frames.map)
        held = [term for term, sign in zip(self._terms, self._condition, strict=False) if sign == "1"]
        text = "\n".join([self._condition, *held])
        ahead = 0.5 + TEXT_HEIGHT * (1 + len(held)) / 2  # so that it hides neither robot nor squares from above
        above = encode_pose(Pose(seen.pose.x, seen.pose.y + ahead), 0.6)
        yield ros.Marker(
            header,
            "condition",
            0,
            ros.Marker.TEXT_VIEW_FACING,
            pose=above,
            scale=ros.Vector3(z=TEXT_HEIGHT),
            color=BLACK,
            text=text,
        )
        middle = (len(self._condition) - 1) / 2
        points = tuple(
            ros.Point(seen.pose.x + (bit - middle) * TEXT_HEIGHT, seen.pose.y + 0.4, 0.3)
            for bit in range(len(self._condition))
        )
        colours = tuple(TRUE_COLOUR if sign == "1" else FALSE_COLOUR for sign in self._condition)
        side = 0.8 * TEXT_HEIGHT
        yield ros.Marker(
            header,
            "condition",
            1,
            ros.Marker.CUBE_LIST,
            scale=ros.Vector3(side, side, side),
            color=FALSE_COLOUR,
            points=points,
            colors=colours,
        )

    def _cells(self, laid: CellLayout) -> Iterator[ros.Marker]:
        """The warehouse's cells as tiles, and the walls between cells as lines."""
        header = encode_header(laid.time, self._frames.map)
        size, frame = laid.frame.cell_size, laid.frame
        for number, (x, y) in enumerate(laid.warehouse.tolist()):
            centre = frame.centre(x, y)
            yield ros.Marker(
                header,
                "warehouse",
                number,
                ros.Marker.CUBE,
                pose=encode_pose(Pose(float(centre[0]), float(centre[1]), frame.origin.theta), TILE_HEIGHT / 2),
                scale=ros.Vector3(size, size, TILE_HEIGHT),
                color=GREEN,
            )
        ends = tuple(_point(end) for wall in laid.walls.tolist() for end in _wall_ends(frame, *wall))
        if ends:
            yield ros.Marker(
                header,
                "cells",
                0,
                ros.Marker.LINE_LIST,
                scale=ros.Vector3(LINE_WIDTH),
                color=GREY,
                points=ends,
            )


def _some(particles: NDArray[np.float32], most: int) -> NDArray[np.float32]:
    """Evenly spread ones of many; they are in no order that would matter."""
    if len(particles) <= most:
        return particles
    return particles[np.linspace(0, len(particles) - 1, most).astype(np.int64)]


def _wall_ends(frame: CellFrame, x: int, y: int, north: int) -> Sequence[tuple[float, float]]:
    """Both ends of the wall on a cell's north or east edge, m, map frame."""
    corners = [(x, y + 1), (x + 1, y + 1)] if north else [(x + 1, y), (x + 1, y + 1)]
    ends = frame.origin.transform(np.array(corners, dtype=np.float64) * frame.cell_size)
    return [(float(end[0]), float(end[1])) for end in ends]


def _point(end: tuple[float, float]) -> ros.Point:
    return ros.Point(end[0], end[1], TILE_HEIGHT)
