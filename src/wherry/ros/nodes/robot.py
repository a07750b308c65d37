"""Any robot of ROS as a `Robot`: with ``/scan``, ``/odom``, ``/tf_static``, ``/cmd_vel`` and a latch.

It drives only on what it trusts. It sends zero velocity when the last scan is too old, be it that the lidar fell silent
or that the agent fell behind; it sends nothing while somebody else commands the robot; messages that cannot be are
refused and counted; and when the robot is gone for good, or its clock was set back, it says so and ends.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable
from types import TracebackType
from typing import Any, Self

from wherry.errors import InputError
from wherry.robot import Body, Odometry, Scan, Velocity
from wherry.ros import messages as ros
from wherry.ros.body_files import BodyParameters
from wherry.ros.decoding import (
    MessageError,
    decode_laser_scan,
    decode_odometry,
    decode_stamp,
    decode_transform,
    decode_twist,
)
from wherry.ros.diagnostics import ERROR, OK, WARN, RejectedMessages, diagnostic_status
from wherry.ros.encoding import encode_header, encode_twist
from wherry.ros.names import RosNames
from wherry.ros.nodes.latch import SPACING, LatchCommand, LatchState, from_latch_state, to_latch_command
from wherry.ros.nodes.measurements import Row, StampGuard, TimeWentBackError
from wherry.ros.topics import Topic
from wherry.ros.transports.protocol import Transport
from wherry.space.pose import Pose

STALE = 0.4  # s; with a scan older than that, the robot does not drive
LOST = 10.0  # s without a scan after which the robot is gone
POLL = 0.05  # s
MOST_BEHIND = 10  # scans that wait for the agent; of more, only the last one is of use
LATCH_PATIENCE, LATCH_TRIES = 0.5, 10  # s that a latch has to answer in, and how often it is asked
YIELDING = 1.0  # s after somebody else's last command until the robot is driven again
ECHOES = 200  # own commands that may still come back
LONGEST_CHAIN = 20  # frames from the lidar to base_link
STANDSTILL = Velocity()


class RobotLostError(Exception):
    """The robot cannot be reached any more, or is not the one that it was."""


class RosRobot:
    """A robot of ROS as a `Robot`; use it as a context manager, or call `close`.

    Args:
        transport: ROS.
        names: What everything is called.
        parameters: The robot's shape and limits.
        stamped: Whether it wants its velocities with stamps (ROS 2 only).

    Attributes:
        in_spare_time: Called in the agent's thread whenever there is nothing to do but to wait for a measurement: where
            whatever takes long and is not needed for driving has its place.
    """

    def __init__(
        self, transport: Transport, names: RosNames, parameters: BodyParameters, *, stamped: bool = False
    ) -> None:
        self._transport = transport
        self._topics, self._frames = names.topics, names.frames
        self._parameters = parameters
        self._stamped = stamped
        self._body: Body | None = None
        self._news = threading.Condition()  # guards everything below
        self._row = Row()
        self._guards = {topic.name: StampGuard(topic.name) for topic in (self._topics.scan, self._topics.odom)}
        self._ready: deque[Odometry | Scan] = deque()
        self._refusals = RejectedMessages()
        self._left_out = 0
        self._fault: TimeWentBackError | None = None
        self._newest = -math.inf  # s, the robot's clock
        self._heard_at = math.inf  # s, monotonic clock: when the last scan came
        self._scanned = -math.inf  # s, the robot's clock: of which time the last scan was
        self._delivered = -math.inf  # s, likewise, of the last scan that the agent got
        self._odometry: Odometry | None = None
        self._links: dict[str, ros.TransformStamped] = {}
        self._latch: LatchState | None = None
        self._number = 0.0
        self._sent: deque[Velocity] = deque(maxlen=ECHOES)
        self._yield_until = -math.inf  # s, monotonic clock
        self._stood_at = -math.inf  # s, monotonic clock: when zero was last sent of its own accord
        self._simulated = False
        self.in_spare_time: Callable[[], None] = lambda: None
        self._connect()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Stop the robot."""
        self._send(STANDSTILL)

    def _connect(self) -> None:
        topics, transport = self._topics, self._transport
        self._command_topic: Topic[Any] = topics.cmd_vel
        if self._stamped:
            self._command_topic = topics.cmd_vel_stamped
        transport.advertise(self._command_topic)
        transport.advertise(topics.latch_command)
        transport.subscribe(topics.tf_static, self._hear_links)
        transport.subscribe(topics.clock, self._hear_clock)
        transport.subscribe(topics.odom, self._hear_odometry)
        transport.subscribe(topics.scan, self._hear_scan)
        transport.subscribe(topics.latch_state, self._hear_latch)
        transport.subscribe(topics.cmd_vel, self._hear_twist)
        if transport.ros_version == 2:
            transport.subscribe(topics.cmd_vel_stamped, lambda message: self._hear_twist(message.twist))

    def wait_until_ready(self, patience: float, *, use_sim_time: bool | None = None) -> None:
        """Wait until everything that is needed has been heard.

        Args:
            patience: s.
            use_sim_time: Whether ``/clock`` is the time; None for whether anybody publishes it.

        Raises:
            InputError: Something is missing; the error names it, and what was refused.
        """
        deadline = time.monotonic() + patience
        with self._news:
            while missing := self._missing():
                if time.monotonic() >= deadline:
                    refused = f"; refused {self._refusals.last}" if self._refusals.last else ""
                    raise InputError("ROS", ", ".join(missing), f"not heard within {patience:g} s{refused}")
                self._news.wait(POLL)
            lidar = self._parameters.lidar or self._lidar()
            self._body = self._parameters.body(lidar or Pose())
        clocks = self._transport.count_publishers(self._topics.clock)
        self._simulated = clocks > 0 if use_sim_time is None else use_sim_time

    def _missing(self) -> list[str]:
        """What has to be heard first."""
        topics, frames = self._topics, self._frames
        needs = {
            topics.scan.name: self._scanned > -math.inf,
            topics.odom.name: self._odometry is not None,
            topics.latch_state.name: self._latch is not None,
            f"{frames.base_link} → {frames.laser} on {topics.tf_static.name}": bool(
                self._parameters.lidar or self._lidar()
            ),
        }
        return [need for need, met in needs.items() if not met]

    # ---- Robot

    @property
    def body(self) -> Body:
        """The robot's shape and limits; known once it is ready."""
        if self._body is None:
            raise RuntimeError("call wait_until_ready first")
        return self._body

    def receive(self) -> Scan | Odometry:
        """Wait for the next measurement; meanwhile the robot is stopped if its lidar falls silent.

        Raises:
            RobotLostError: Nothing has come for long, or the robot's clock went back.
        """
        if not self._ready:
            self.in_spare_time()
        with self._news:
            while not self._ready:
                self._check()
                self._news.wait(POLL)
            self._leave_out()
            measurement = self._ready.popleft()
            if isinstance(measurement, Scan):
                self._delivered = measurement.time
            else:
                self._odometry = measurement
            return measurement

    def command(self, velocity: Velocity) -> None:
        """Drive so; stands instead while the agent's last scan is too old, and yields to whoever else drives.

        Raises:
            ValueError: A component is not a finite number.
        """
        if not (math.isfinite(velocity.linear) and math.isfinite(velocity.angular)):
            raise ValueError(f"a velocity must be finite, not {velocity}")
        with self._news:
            stale, yielding = self._is_stale(), self._is_yielding()
        if not yielding:
            self._send(STANDSTILL if stale else self._within_limits(velocity))

    def close_latch(self) -> bool:
        """Close the latch; return whether it holds a box now.

        Raises:
            RobotLostError: It does not answer.
        """
        return self._ask(close=True).loaded

    def open_latch(self) -> bool:
        """Ask to let go of the load; return whether the fork is free now.

        Raises:
            RobotLostError: It does not answer.
        """
        return not self._ask(close=False).loaded

    # ---- for those who tell others

    @property
    def odometry(self) -> Odometry | None:
        """The last odometry that the agent got."""
        return self._odometry

    @property
    def time(self) -> float:
        """s, the robot's clock as far as it was heard."""
        return self._newest

    def status(self) -> ros.DiagnosticStatus:
        """How the connection is."""
        others = self._transport.count_publishers(self._command_topic)
        with self._news:
            stale, yielding = self._is_stale(), self._is_yielding()
            values = {
                "scans left out": self._left_out,
                "other publishers of velocities": others,
                "clock": "simulated" if self._simulated else "real",
                **{f"refused on {topic}": count for topic, count in self._refusals.counts.items()},
                "last refused": self._refusals.last,
            }
        if yielding:
            return diagnostic_status("wherry: robot", ERROR, "somebody else drives the robot: I wait", values)
        if stale:
            return diagnostic_status("wherry: robot", ERROR, "the last scan is too old: I stand", values)
        if not self._transport.is_connected():
            return diagnostic_status("wherry: robot", WARN, "the ROS master cannot be reached", values)
        if others:
            return diagnostic_status("wherry: robot", WARN, "somebody else could drive the robot too", values)
        return diagnostic_status("wherry: robot", OK, "well", values)

    # ---- on the transport's thread

    def _hear_links(self, message: ros.TFMessage) -> None:
        with self._news:
            self._links.update({link.child_frame_id.lstrip("/"): link for link in message.transforms})
            self._news.notify_all()

    def _hear_clock(self, message: ros.Clock) -> None:
        def hear() -> None:
            now = decode_stamp(message.clock)
            if self._simulated:
                self._newest = max(self._newest, now)

        self._take_in(self._topics.clock.name, hear)

    def _hear_odometry(self, message: ros.Odometry) -> None:
        def hear() -> None:
            odometry = decode_odometry(message, self._frames.odom, self._frames.base_link)
            self._guards[self._topics.odom.name].check(odometry.time)
            if self._odometry is None:
                self._odometry = odometry
            self._newest = max(self._newest, odometry.time)
            self._ready.extend(self._row.hear_odometry(odometry))

        self._take_in(self._topics.odom.name, hear)

    def _hear_scan(self, message: ros.LaserScan) -> None:
        def hear() -> None:
            scan = decode_laser_scan(message, self._frames.laser)
            self._guards[self._topics.scan.name].check(scan.time)
            self._scanned, self._heard_at = scan.time, time.monotonic()
            self._newest = max(self._newest, scan.time)
            self._ready.extend(self._row.hear_scan(scan))

        self._take_in(self._topics.scan.name, hear)

    def _hear_latch(self, message: ros.JointState) -> None:
        def hear() -> None:
            self._latch = from_latch_state(message)

        self._take_in(self._topics.latch_state.name, hear)

    def _hear_twist(self, message: ros.Twist) -> None:
        """A command that is none of the last ones from here is somebody else's."""

        def hear() -> None:
            if decode_twist(message) not in self._sent:
                self._yield_until = time.monotonic() + YIELDING

        self._take_in(self._topics.cmd_vel.name, hear)

    def _take_in(self, topic: str, hear: Callable[[], None]) -> None:
        """Take a message in, or refuse it."""
        with self._news:
            try:
                hear()
            except MessageError as error:
                self._refusals.add(topic, error)
            except TimeWentBackError as error:
                self._fault = error
            self._news.notify_all()

    # ---- details; with the lock held, but for `_ask`

    def _lidar(self) -> Pose | None:
        """The lidar in base_link's frame, as the static transforms say; None if they do not.

        Raises:
            InputError: One of them tilts it, or is broken.
        """
        base, frame, pose = self._frames.base_link.lstrip("/"), self._frames.laser.lstrip("/"), Pose()
        for _ in range(LONGEST_CHAIN):
            if frame == base:
                return pose
            if frame not in self._links:
                return None
            try:
                link = decode_transform(self._links[frame])
            except MessageError as error:
                raise InputError(self._topics.tf_static.name, frame, str(error)) from error
            frame, pose = link.parent, link.pose @ pose
        raise InputError(self._topics.tf_static.name, self._frames.laser, "the transforms form a circle")

    def _check(self) -> None:
        """Stop the robot if its lidar has fallen silent; give up if it is gone."""
        if self._fault is not None:
            raise RobotLostError(str(self._fault)) from self._fault
        now = time.monotonic()
        if now - self._heard_at > LOST:
            self._send(STANDSTILL)
            raise RobotLostError(f"{self._topics.scan.name}: nothing heard for {LOST:g} s")
        if self._is_stale() and now - self._stood_at > STALE / 2 and not self._is_yielding():
            self._stood_at = now
            self._send(STANDSTILL)

    def _is_stale(self) -> bool:
        """Whether the agent's last scan is too old to drive by."""
        behind = self._newest - self._delivered
        silent = 0.0 if self._simulated else time.monotonic() - self._heard_at
        return max(behind, silent) > STALE

    def _is_yielding(self) -> bool:
        return time.monotonic() < self._yield_until

    def _leave_out(self) -> None:
        """Of many scans that wait, the agent gets the last one."""
        waiting = [measurement for measurement in self._ready if isinstance(measurement, Scan)]
        if len(waiting) > MOST_BEHIND:
            self._left_out += len(waiting) - 1
            kept = [item for item in self._ready if isinstance(item, Odometry) or item is waiting[-1]]
            self._ready = deque(kept)

    def _within_limits(self, velocity: Velocity) -> Velocity:
        linear, angular = self._parameters.max_linear, self._parameters.max_angular
        return Velocity(
            min(max(velocity.linear, -linear), linear),
            min(max(velocity.angular, -angular), angular),
        )

    def _send(self, velocity: Velocity) -> None:
        with self._news:
            self._sent.append(velocity)
        twist = encode_twist(velocity)
        if self._stamped:
            header = encode_header(max(self._newest, 0.0), self._frames.base_link)
            self._transport.publish(self._topics.cmd_vel_stamped, ros.TwistStamped(header, twist))
        else:
            self._transport.publish(self._topics.cmd_vel, twist)

    def _ask(self, *, close: bool) -> LatchState:
        """Ask the latch until it has answered."""
        self._number = max(self._newest, self._number + SPACING)
        command = LatchCommand(self._number, close)
        for _ in range(LATCH_TRIES):
            self._transport.publish(self._topics.latch_command, to_latch_command(command))
            deadline = time.monotonic() + LATCH_PATIENCE
            with self._news:
                while (left := deadline - time.monotonic()) > 0.0:
                    if self._latch is not None and self._latch.answers(command):
                        return self._latch
                    self._news.wait(left)
        raise RobotLostError(f"{self._topics.latch_state.name}: the latch does not answer")
