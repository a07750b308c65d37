"""Bags: what a robot senses and believes, recorded for ROS 1 and ROS 2 without ROS (the rosbags package).

What is recorded has the topics, frames and types of `wherry.ros.names`; every stamp is of the robot's one clock. A
transform comes before the scan that needs it.
"""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Callable
from pathlib import Path
from threading import Lock
from types import TracebackType
from typing import Any, Self

import numpy as np

from wherry.errors import InputError
from wherry.logs.carmen import LidarLog
from wherry.robot import Body, Odometry, Robot, Scan, Velocity
from wherry.ros import messages as ros
from wherry.ros.bags.reading import UNFINISHED
from wherry.ros.bags.storage import FORMATS, Storage
from wherry.ros.conversion import (
    NANOSECONDS,
    Link,
    MessageError,
    header_of,
    seconds_of,
    to_grid,
    to_laser_scan,
    to_odometry,
    to_path,
    to_pose,
    to_pose_array,
    to_transform,
    to_twist,
)
from wherry.ros.messages import M, Message
from wherry.ros.names import Names, load_names
from wherry.ros.nodes.latch import LatchState, to_latch_state
from wherry.ros.transports.transport import Topic, Transport
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose
from wherry.trace.records import MapUpdate, Record, RobotSnapshot, StepTaken

SAFE_EVERY = 1.0  # s of what is recorded: no more than that is lost if the process is killed by force
MAP_EVERY = 5.0  # s between two maps of a growing one, as with gmapping
NO_COVARIANCE = np.zeros(36)


class Bag:
    """A bag that is being recorded; a context manager.

    Until it is closed it is called PATH.active, and so is what is left of it if the process is killed by force: all but
    the last second (`SAFE_EVERY`). ``rosbag reindex``, ``mcap recover`` and ``ros2 bag reindex`` then make a bag of it.

    Args:
        path: Its name; the suffix says which kind, see `FORMATS`.

    Raises:
        InputError: rosbags is not installed, the suffix is of no kind of bag, something of that name is there, or it
            cannot be written to.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._unfinished = self.path.with_name(self.path.name + UNFINISHED)
        self._connections: dict[tuple[str, type[Message]], Any] = {}
        self._next_save = -np.inf  # s
        self._lock = Lock()
        self._check()
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._storage: Storage | None = FORMATS[self.path.suffix](self.path, self._unfinished)
        except ImportError as error:
            raise InputError(path, "", "is to be a ROS bag: pip install 'wherry[bags]' to record one") from error
        except OSError as error:
            raise InputError(path, "", f"cannot be written: {error.strerror}") from error

    def _check(self) -> None:
        """Refuse names that say no kind of bag, and to write over anything."""
        if self.path.suffix not in FORMATS:
            raise InputError("--record", str(self.path), "is neither .bag (ROS 1), .mcap, nor a folder's name (ROS 2)")
        if self.path.exists():
            raise InputError("--record", str(self.path), "is there already; recordings are not written over")
        if self._unfinished.exists():
            raise InputError(
                "--record", str(self._unfinished), "is there, of a recording that was cut off; move it away"
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def write(self, topic: Topic[M], message: M, seconds: float) -> None:
        """Add a message; from any thread.

        Args:
            topic: With its absolute name.
            message: Of the topic's type.
            seconds: s, on the robot's clock.

        Raises:
            InputError: The disk is full or gone.
            ValueError: The bag is closed.
        """
        with self._lock:
            if self._storage is None:
                raise ValueError(f"{self.path} is closed")
            try:
                key = (topic.name, topic.message_type)
                if key not in self._connections:
                    self._connections[key] = self._storage.connect(topic)
                self._storage.write(self._connections[key], message, round(seconds * NANOSECONDS))
                if seconds >= self._next_save:
                    self._next_save = seconds + SAFE_EVERY
                    self._storage.save()
            except OSError as error:
                raise InputError(self._unfinished, "", f"cannot be written any further: {error.strerror}") from error

    def close(self) -> None:
        """Make it a whole bag and give it its name; what comes after the first call does nothing.

        Raises:
            InputError: It cannot be written; what there is keeps the unfinished name.
        """
        with self._lock:
            storage, self._storage = self._storage, None
            if storage is None:
                return
            try:
                storage.close()
                storage.finished.rename(self.path)
                if self._unfinished.is_dir():
                    shutil.rmtree(self._unfinished)
            except OSError as error:
                raise InputError(self._unfinished, "", f"cannot be finished: {error.strerror}") from error


class Recording:
    """Records a robot and what its driver believes: hand out `robot` instead of the robot, and use this as a sink.

    Topics and frames have their customary names.

    Args:
        bag: Where to; the caller closes it.
        laser_height: m, of the lidar over base_link.
    """

    def __init__(self, bag: Bag, *, laser_height: float = 0.0) -> None:
        names = load_names()
        self._bag = bag
        self._topics, self._frames = names.topics, names.frames
        self._laser_height = laser_height
        self._odometry: Odometry | None = None
        self._next_map = -np.inf

    def robot(self, robot: Robot) -> RecordedRobot:
        """The same robot, recorded."""
        return RecordedRobot(robot, self)

    def __call__(self, record: Record) -> None:
        """Record what was told, if ROS has a message for it."""
        if isinstance(record, RobotSnapshot):
            self._seen(record)
        elif isinstance(record, MapUpdate):
            if record.time >= self._next_map or record.explored_fraction >= 1.0:
                self._next_map = record.time + MAP_EVERY
                self.map(record.grid, record.time)
        elif isinstance(record, StepTaken):
            self._bag.write(self._topics.plan, to_path(record.plan, record.time, self._frames.map), record.time)

    def measured(self, measurement: Scan | Odometry, lidar: Pose) -> None:
        """Record a measurement.

        Args:
            measurement: What the robot measured.
            lidar: The lidar's pose in base_link.
        """
        if isinstance(measurement, Odometry):
            if self._odometry is None:
                self._write_mount(measurement.time, lidar)
            self._odometry = measurement
            link = Link(self._frames.odom, self._frames.base_link, measurement.time, measurement.pose)
            self._write_link(link)
            odometry = to_odometry(measurement, self._frames.odom, self._frames.base_link, NO_COVARIANCE)
            self._bag.write(self._topics.odom, odometry, measurement.time)
        else:
            self._bag.write(self._topics.scan, to_laser_scan(measurement, self._frames.laser), measurement.time)

    def commanded(self, velocity: Velocity, seconds: float) -> None:
        """Record what the wheels were told at an instant, s."""
        self._bag.write(self._topics.cmd_vel, to_twist(velocity), seconds)

    def latched(self, seconds: float, *, loaded: bool) -> None:
        """Record whether the latch holds a box since an instant, s."""
        self._bag.write(self._topics.latch_state, to_latch_state(LatchState(seconds, loaded, 0.0)), seconds)

    def believed(self, pose: Pose, particles: Floats, seconds: float) -> None:
        """Record where the robot is believed to be at an instant, s.

        Args:
            pose: base_link in the map frame.
            particles: [N, 3] x m, y m, θ rad, map frame; may be empty.
            seconds: s; odometry of it was recorded before.
        """
        if self._odometry is not None:
            map_from_odom = pose @ self._odometry.pose.inverse
            self._write_link(Link(self._frames.map, self._frames.odom, seconds, map_from_odom))
        if len(particles):
            header = header_of(seconds, self._frames.map)
            estimate = ros.PoseWithCovariance(to_pose(pose), _covariance(particles, pose))
            self._bag.write(self._topics.amcl_pose, ros.PoseWithCovarianceStamped(header, estimate), seconds)
            cloud = to_pose_array(particles, seconds, self._frames.map)
            self._bag.write(self._topics.particlecloud, cloud, seconds)

    def map(self, grid: OccupancyGrid, seconds: float) -> None:
        """Record a map."""
        self._bag.write(self._topics.map, to_grid(grid, seconds, self._frames.map), seconds)

    def _seen(self, record: RobotSnapshot) -> None:
        self.believed(record.pose, record.particles.astype(np.float64), record.time)
        path = to_path(record.path, record.time, self._frames.map)
        self._bag.write(self._topics.predicted_path, path, record.time)

    def _write_mount(self, seconds: float, lidar: Pose) -> None:
        link = Link(self._frames.base_link, self._frames.laser, seconds, lidar)
        message = ros.TFMessage((to_transform(link, self._laser_height),))
        self._bag.write(self._topics.tf_static, message, seconds)

    def _write_link(self, link: Link) -> None:
        self._bag.write(self._topics.tf, ros.TFMessage((to_transform(link),)), link.time)


def _covariance(particles: Floats, mean: Pose) -> Floats:
    """[36] as ROS has it, over x, y, z and the rotations about them: how far particles are from a pose."""
    off = particles - mean.as_array()
    off[:, 2] = np.arctan2(np.sin(off[:, 2]), np.cos(off[:, 2]))
    covariance = np.zeros((6, 6))
    covariance[np.ix_((0, 1, 5), (0, 1, 5))] = off.T @ off / len(off)
    return covariance.ravel()


class RecordedRobot:
    """A robot like the one that it wraps, but for that everything is recorded.

    Args:
        robot: What drives.
        recording: Told everything.
    """

    def __init__(self, robot: Robot, recording: Recording) -> None:
        self._robot = robot
        self._recording = recording
        self._time = 0.0

    @property
    def body(self) -> Body:
        """The robot's shape and limits."""
        return self._robot.body

    def receive(self) -> Scan | Odometry:
        """Return the next measurement."""
        measurement = self._robot.receive()
        self._time = measurement.time
        self._recording.measured(measurement, self.body.lidar)
        return measurement

    def command(self, velocity: Velocity) -> None:
        """Drive so."""
        self._robot.command(velocity)
        self._recording.commanded(velocity, self._time)

    def close_latch(self) -> bool:
        """Close the latch; return whether it holds a box now."""
        holds = self._robot.close_latch()
        self._recording.latched(self._time, loaded=holds)
        return holds

    def open_latch(self) -> bool:
        """Open the latch; return whether the fork is free now."""
        is_free = self._robot.open_latch()
        self._recording.latched(self._time, loaded=not is_free)
        return is_free


class RecordedTransport:
    """A transport like the one that it wraps, but for that all that is heard and published through it is recorded.

    What belongs to no instant of its own counts as of the last scan or odometry, so that the bag has one clock, that of
    the robot; what comes before the first of them waits for it. Transforms are listened to even if nobody else does.

    Args:
        transport: ROS.
        bag: Where to; the caller closes it.
        names: What everything is called.
    """

    def __init__(self, transport: Transport, bag: Bag, names: Names) -> None:
        self._transport = transport
        self._bag = bag
        self._clocks = {names.topics.scan.name, names.topics.odom.name}
        self._heard: set[str] = set()
        self._lock = Lock()
        self._is_finished = False
        self._now: float | None = None
        self._waiting: list[tuple[Topic[Any], Message]] = []
        self.subscribe(names.topics.tf, lambda message: None)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    @property
    def generation(self) -> int:
        """As of the transport."""
        return self._transport.generation

    def advertise(self, topic: Topic[M]) -> None:
        """As the transport."""
        self._transport.advertise(topic)

    def publish(self, topic: Topic[M], message: M) -> None:
        """As the transport; and recorded, unless it comes back because it is listened to as well."""
        self._transport.publish(topic, message)
        if topic.name not in self._heard:
            self._record(topic, message)

    def subscribe(self, topic: Topic[M], heard: Callable[[M], None]) -> None:
        """As the transport; and recorded."""
        self._heard.add(topic.name)

        def record_and_hear(message: M) -> None:
            with contextlib.suppress(InputError):  # of a full disk `publish` tells, in the agent's own thread
                self._record(topic, message)
            heard(message)

        self._transport.subscribe(topic, record_and_hear)

    def publishers_of(self, topic: Topic[M]) -> int:
        """As the transport."""
        return self._transport.publishers_of(topic)

    def subscribers_of(self, topic: Topic[M]) -> int:
        """As the transport."""
        return self._transport.subscribers_of(topic)

    def connected(self) -> bool:
        """As the transport."""
        return self._transport.connected()

    def close(self) -> None:
        """As the transport."""
        self._transport.close()

    def finish(self) -> None:
        """Record nothing more, so that the bag can be closed; everything else goes on."""
        with self._lock:
            self._is_finished = True

    def _record(self, topic: Topic[Any], message: Message) -> None:
        with self._lock:
            if self._is_finished:
                return
            if topic.name in self._clocks:
                assert isinstance(message, ros.LaserScan | ros.Odometry)  # noqa: S101 - the topics' types
                with contextlib.suppress(MessageError):  # the robot refuses it, and tells; it is recorded all the same
                    seconds = seconds_of(message.header.stamp)
                    self._now = seconds if self._now is None else max(self._now, seconds)
            self._waiting.append((topic, message))
            if self._now is None:
                return
            for waiting, held in self._waiting:
                self._bag.write(waiting, held, self._now)
            self._waiting.clear()


class LogRecording:
    """Records what a log holds, with what was found out about each of its scans.

    Args:
        bag: Where to; the caller closes it.
        log: The log.
    """

    def __init__(self, bag: Bag, log: LidarLog) -> None:
        self._recording = Recording(bag)
        self._log = log
        self._written = 0  # odometry so far

    def scan(self, index: int, pose: Pose, particles: Floats) -> None:
        """Record a scan, the odometry up to it, and where the robot was.

        Args:
            index: Of the scan; each once, in order.
            pose: base_link in the map frame then.
            particles: [N, 3] x m, y m, θ rad, map frame; may be empty.
        """
        scan = self._log.scans[index]
        self._write_odometry(scan.time)
        self._recording.believed(pose, particles, scan.time)
        self._recording.measured(scan, self._log.lidar)
        if index == len(self._log.scans) - 1:
            self._write_odometry(np.inf)

    def _write_odometry(self, until: float) -> None:
        """Record the odometry up to an instant, s, that was not yet."""
        odometry = self._log.odometry
        while self._written < len(odometry.times) and odometry.times[self._written] <= until:
            now = Pose.from_array(odometry.poses[self._written])
            measured = Odometry(float(odometry.times[self._written]), now, Velocity())
            self._recording.measured(measured, self._log.lidar)
            self._written += 1

    def map(self, grid: OccupancyGrid, seconds: float) -> None:
        """Record a map, s."""
        self._recording.map(grid, seconds)
