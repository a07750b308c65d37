"""A ROS robot as a `Robot`: any one with ``/scan``, ``/odom``, ``/tf_static``, ``/cmd_vel`` and a latch.

The robot is stopped while the agent's last scan is too old, whether the lidar is silent or the agent fell behind.
Nothing is sent while another node commands the robot. Messages with impossible content are rejected and counted. The
run ends when the robot is lost or its clock was set back.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

from wherry.robot import Body, Odometry, Scan, Velocity
from wherry.ros import messages as ros
from wherry.ros.body_files import BodyParameters
from wherry.ros.diagnostics import ERROR, OK, WARN, diagnostic_status
from wherry.ros.names import RosNames
from wherry.ros.nodes.errors import RobotLostError
from wherry.ros.nodes.latch_client import LatchClient
from wherry.ros.nodes.measurement_queue import SCAN_MAX_AGE, MeasurementQueue
from wherry.ros.nodes.robot_clock import RobotClock
from wherry.ros.nodes.robot_transforms import RobotTransforms
from wherry.ros.nodes.subscriptions import POLL_PERIOD, Subscriptions
from wherry.ros.nodes.velocity_commands import VelocityCommands
from wherry.ros.transforms import Mount
from wherry.ros.transports.protocol import Transport

ROBOT_LOST_TIMEOUT = 10.0  # s without a scan after which the robot counts as lost
STANDSTILL = Velocity()


class RosRobot:
    """A ROS robot as a `Robot`; use it as a context manager, or call `close`.

    Args:
        transport: Connection to ROS.
        names: Names of topics and frames, and publishing rates.
        parameters: The robot's shape and limits.
        stamped: Whether the robot takes velocities with stamps (ROS 2 only).

    Attributes:
        idle_callback: Called in the agent's thread when no measurement is queued, for slow work that driving does not
            depend on.
    """

    def __init__(
        self, transport: Transport, names: RosNames, parameters: BodyParameters, *, stamped: bool = False
    ) -> None:
        topics = names.topics
        self._transport, self._topics, self._frames = transport, topics, names.frames
        self._parameters = parameters
        self._subscriptions = Subscriptions(transport)
        self._transforms = RobotTransforms(self._subscriptions, topics, names.frames)
        self._clock = RobotClock(self._subscriptions, topics.clock)
        self._measurements = MeasurementQueue(self._subscriptions, names, self._clock)
        self._latch = LatchClient(transport, self._subscriptions, topics, self._clock)
        self._velocities = VelocityCommands(
            transport, self._subscriptions, names, parameters, self._clock, stamped=stamped
        )
        self._body: Body | None = None
        self._stopped_at = -math.inf  # s, monotonic clock, when the robot was last stopped because of a stale scan
        self.idle_callback: Callable[[], None] = lambda: None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Stop the robot."""
        self._velocities.publish(STANDSTILL)

    # ---- readiness

    def wait_until_ready(self, timeout: float, *, use_sim_time: bool | None = None) -> None:
        """Wait for a scan, odometry, the latch's state, and the lidar's pose.

        Args:
            timeout: Maximum waiting time, s.
            use_sim_time: Whether the robot's clock is ``/clock``; None to use that if a node publishes it.

        Raises:
            InputError: Something is missing after ``timeout``; the error names it, and the last rejected message.
        """
        self._subscriptions.wait_for(self._missing, timeout)
        with self._subscriptions.changed:
            mount = self._mount() or Mount()
            self._measurements.mount = mount
            self._body = self._parameters.body(mount.pose)
        clocks = self._transport.count_publishers(self._topics.clock)
        self._clock.is_simulated = clocks > 0 if use_sim_time is None else use_sim_time

    def _missing(self) -> list[str]:
        """Names of the topics and transforms that have not been received yet."""
        topics, frames = self._topics, self._frames
        received = {
            topics.scan.name: self._measurements.has_received_scan,
            topics.odom.name: self._measurements.odometry is not None,
            topics.latch_state.name: self._latch.state is not None,
            f"{frames.base_link} → {frames.laser} on {topics.tf_static.name}": self._mount() is not None,
        }
        if self._measurements.has_received_scan and self._measurements.odometry is not None:
            received[self._measurements.stamp_conflict] = self._measurements.has_queued_scan
        return [name for name, is_received in received.items() if not is_received]

    def _mount(self) -> Mount | None:
        """The lidar's mount on base_link; None while it is not known."""
        if self._parameters.lidar is not None:
            return Mount(self._parameters.lidar)
        return self._transforms.find_mount()

    # ---- Robot

    @property
    def body(self) -> Body:
        """The robot's shape and limits; available once the robot is ready."""
        if self._body is None:
            raise RuntimeError("call wait_until_ready first")
        return self._body

    def receive(self) -> Scan | Odometry:
        """Wait for the next measurement; the robot is stopped if its lidar falls silent meanwhile.

        Raises:
            RobotLostError: No scan within `ROBOT_LOST_TIMEOUT`, or the robot's clock was set back.
        """
        if self._measurements.is_empty:
            self.idle_callback()
        with self._subscriptions.changed:
            while self._measurements.is_empty or self._transforms.moving_link:
                self._check_connection()
                self._subscriptions.changed.wait(POLL_PERIOD)
            return self._measurements.pop()

    def _check_connection(self) -> None:
        """Stop the robot while its lidar is silent.

        Raises:
            RobotLostError: As `receive`.
        """
        if self._measurements.clock_reset is not None:
            raise self._measurements.clock_reset
        reason = self._loss()
        if reason:
            self._velocities.publish(STANDSTILL)
            raise RobotLostError(reason)
        now = time.monotonic()
        is_stop_due = now - self._stopped_at > SCAN_MAX_AGE / 2
        if self._measurements.is_scan_stale and is_stop_due and not self._velocities.is_yielding:
            self._stopped_at = now
            self._velocities.publish(STANDSTILL)

    def _loss(self) -> str:
        """Why the robot is lost; empty if it is not."""
        if self._measurements.seconds_without_scan > ROBOT_LOST_TIMEOUT:
            return f"{self._topics.scan.name}: nothing received for {ROBOT_LOST_TIMEOUT:g} s"
        if self._measurements.seconds_without_queued_scan > ROBOT_LOST_TIMEOUT:
            return f"{self._measurements.stamp_conflict}: not received for {ROBOT_LOST_TIMEOUT:g} s"
        if self._transforms.moving_link:
            return f"{self._transforms.moving_link}: the lidar moves on the robot"
        return ""

    def command(self, velocity: Velocity) -> None:
        """Drive at a velocity; stop instead if the last scan is too old, and send nothing if another node drives.

        Raises:
            ValueError: A component is not a finite number.
        """
        if not (math.isfinite(velocity.linear) and math.isfinite(velocity.angular)):
            raise ValueError(f"a velocity must be finite, not {velocity}")
        with self._subscriptions.changed:
            is_stale, is_yielding = self._measurements.is_scan_stale, self._velocities.is_yielding
        if not is_yielding:
            self._velocities.publish(STANDSTILL if is_stale else velocity)

    def close_latch(self) -> bool:
        """Close the latch; returns whether it holds a box now.

        Raises:
            RobotLostError: It does not answer.
        """
        return self._latch.request(close=True).has_load

    def open_latch(self) -> bool:
        """Open the latch; returns whether the fork is free now.

        Raises:
            RobotLostError: It does not answer.
        """
        return not self._latch.request(close=False).has_load

    # ---- odometry, time and status of the connection

    @property
    def odometry(self) -> Odometry | None:
        """Latest odometry that `receive` returned."""
        return self._measurements.odometry

    @property
    def newest_odometry(self) -> Odometry | None:
        """Latest odometry received, which `receive` may not have returned yet."""
        return self._measurements.newest_odometry

    @property
    def time(self) -> float:
        """Latest time received on the robot's clock, s."""
        return self._clock.time

    def status(self) -> ros.DiagnosticStatus:
        """The state of the connection, for ``/diagnostics``."""
        other_publishers = self._velocities.other_publishers
        rejected = self._subscriptions.rejected
        with self._subscriptions.changed:
            is_stale, is_yielding = self._measurements.is_scan_stale, self._velocities.is_yielding
            values = {
                "scans left out": self._measurements.dropped_scans,
                "other publishers of velocities": other_publishers,
                "clock": "simulated" if self._clock.is_simulated else "real",
                **{f"corrected in {self._topics.scan.name}": text for text in self._measurements.remarks},
                **{f"refused on {topic}": count for topic, count in rejected.counts.items()},
                "last refused": rejected.last,
            }
        level, text = OK, "connected"
        if is_yielding:
            level, text = ERROR, "another node drives the robot: waiting"
        elif is_stale:
            level, text = ERROR, "the last scan is too old: stopped"
        elif not self._transport.is_connected():
            level, text = WARN, "the ROS master cannot be reached"
        elif other_publishers:
            level, text = WARN, "another node also publishes velocities"
        return diagnostic_status("wherry: robot", level, text, values)
