"""The agent's map, pose, plan and decisions as ROS messages, from the trace records of a run.

Publishes ``/map`` (latched), ``/particlecloud``, ``/plan``, ``/predicted_path``, ``/markers``, ``/diagnostics``, and on
``/tf`` the transform from map to odom. A heartbeat thread repeats the transform, so that it stays valid while the agent
computes, and the lasting markers, for late subscribers. Observations are published only when the robot is idle, since a
message of hundreds of particles takes longer to build than a control step.
"""

from __future__ import annotations

import math
import threading
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from wherry.ros import messages as ros
from wherry.ros.diagnostics import OK, diagnostic_array, diagnostic_status
from wherry.ros.encoding import encode_occupancy_grid, encode_path, encode_pose_array, encode_transform
from wherry.ros.names import RosNames
from wherry.ros.nodes.markers import BoxMarkers, cell_markers, condition_markers
from wherry.ros.nodes.robot import RosRobot
from wherry.ros.transforms import StampedTransform
from wherry.ros.transports.protocol import Transport
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import IDENTITY
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

HEARTBEAT_PERIOD = 0.05  # s
TRANSFORM_TOLERANCE = 0.1  # s that map → odom is dated ahead, as amcl does, so that newer messages can be transformed
MAX_PARTICLES = 500  # particles in a message
MAX_PUBLISH_DELAY = 1.0  # s after which an observation is published although the robot is not idle


class AgentNode:
    """A sink that publishes trace records; use it as a context manager around the run.

    Args:
        robot: The agent's robot, which provides odometry and time.
        transport: Connection to ROS.
        names: Names of topics and frames, and publishing rates.
        publishes_map: Whether ``/map`` is the agent's rather than an external stack's.
        publishes_pose: Whether map → odom is the agent's rather than an external stack's.
    """

    def __init__(
        self,
        robot: RosRobot,
        transport: Transport,
        names: RosNames,
        *,
        publishes_map: bool = True,
        publishes_pose: bool = True,
    ) -> None:
        self._robot = robot
        self._transport = transport
        self._topics, self._frames = names.topics, names.frames
        self._diagnostics_period = 1 / names.rates.diagnostics
        self._publishes_map, self._publishes_pose = publishes_map, publishes_pose
        self._map_from_odom = IDENTITY
        self._box_markers = BoxMarkers()
        self._terms: tuple[str, ...] = ()
        self._narration: Narration | None = None
        self._condition = ""
        self._lasting_markers: tuple[ros.Marker, ...] = ()
        self._transform_time = 0.0  # s, robot's clock, of the last transform
        self._unpublished: RobotSnapshot | None = None
        self._published_time = math.inf  # s, robot's clock, of the last published, else the first, observation
        robot.idle_callback = self._publish_observation
        self._is_stopped = threading.Event()
        self._heartbeat = threading.Thread(target=self._beat, name="heartbeat", daemon=True)

    def __enter__(self) -> Self:
        for topic in (self._topics.plan, self._topics.predicted_path):
            self._transport.advertise(topic)
        self._heartbeat.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._is_stopped.set()
        self._heartbeat.join()
        self._robot.idle_callback = lambda: None
        if error is None:
            self._publish_observation()

    def __call__(self, record: Record) -> None:
        """Publish a record."""
        match record:
            case RunStarted():
                self._box_markers.radius, self._terms = record.box_radius, record.terms
            case Narration():
                self._narration = record
                self._publish_diagnostics()
            case MapUpdate():
                self.publish_map(record.grid)
            case RobotSnapshot():
                self._observe(record)
            case CellLayout():
                self._lasting_markers = tuple(cell_markers(record, self._frames.map))
                self._publish_markers(self._lasting_markers)
            case StepTaken():
                self._transport.publish(self._topics.plan, encode_path(record.plan, record.time, self._frames.map))
            case PerceivedState():
                self._condition = record.condition
            case LearntModel():
                pass

    def publish_map(self, grid: OccupancyGrid) -> None:
        """Publish a map, unless an external stack publishes maps."""
        if self._publishes_map:
            self._transport.publish(self._topics.map, encode_occupancy_grid(grid, self._robot.time, self._frames.map))

    # ---- heartbeat

    def _beat(self) -> None:
        beats = 0
        while not self._is_stopped.wait(HEARTBEAT_PERIOD):
            if self._publishes_pose:
                self._publish_transform()
            beats += 1
            if beats * HEARTBEAT_PERIOD >= self._diagnostics_period:
                beats = 0
                self._publish_diagnostics()
                self._publish_markers(self._lasting_markers)

    def _publish_transform(self) -> None:
        now = self._robot.time
        if now <= self._transform_time:
            return  # tf2 warns about repeated stamps
        self._transform_time = now
        transform = StampedTransform(
            self._frames.map, self._frames.odom, now + TRANSFORM_TOLERANCE, self._map_from_odom
        )
        self._transport.publish(self._topics.tf, ros.TFMessage((encode_transform(transform),)))

    def _publish_diagnostics(self) -> None:
        text, phase = ("", "") if self._narration is None else (self._narration.text, self._narration.phase)
        agent = diagnostic_status("wherry: agent", OK, text, {"phase": phase, "condition": self._condition})
        message = diagnostic_array(self._robot.time, agent, self._robot.status())
        self._transport.publish(self._topics.diagnostics, message)

    # ---- observations

    def _observe(self, snapshot: RobotSnapshot) -> None:
        """Update map → odom at once; publish the rest when the robot is idle."""
        odometry = self._robot.odometry
        if odometry is not None:
            self._map_from_odom = snapshot.pose @ odometry.pose.inverse
        self._unpublished = snapshot
        self._published_time = min(self._published_time, snapshot.time)
        if snapshot.time - self._published_time >= MAX_PUBLISH_DELAY:
            self._publish_observation()

    def _publish_observation(self) -> None:
        """Publish the latest observation once; earlier ones that were not published are dropped."""
        snapshot, self._unpublished = self._unpublished, None
        if snapshot is None:
            return
        self._published_time = snapshot.time
        frame, topics = self._frames.map, self._topics
        particles = encode_pose_array(_subsample(snapshot.particles, MAX_PARTICLES), snapshot.time, frame)
        self._transport.publish(topics.particlecloud, particles)
        self._transport.publish(topics.predicted_path, encode_path(snapshot.path, snapshot.time, frame))
        boxes = self._box_markers.update(snapshot, frame)
        self._publish_markers((*boxes, *condition_markers(self._condition, self._terms, snapshot, frame)))

    def _publish_markers(self, markers: tuple[ros.Marker, ...]) -> None:
        if markers:
            self._transport.publish(self._topics.markers, ros.MarkerArray(markers))


def _subsample(particles: NDArray[np.float32], count: int) -> NDArray[np.float32]:
    """At most ``count`` particles at even steps; their order carries no meaning."""
    if len(particles) <= count:
        return particles
    return particles[np.linspace(0, len(particles) - 1, count).astype(np.int64)]
