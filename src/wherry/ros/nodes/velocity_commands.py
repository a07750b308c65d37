"""Publishing of velocities for a robot's base, which yields to other nodes that command the robot."""

from __future__ import annotations

import math
import time
from collections import deque
from typing import Any

from wherry.robot import Velocity
from wherry.ros import messages as ros
from wherry.ros.body_files import BodyParameters
from wherry.ros.decoding import decode_twist
from wherry.ros.encoding import encode_header, encode_twist
from wherry.ros.names import RosNames
from wherry.ros.nodes.robot_clock import RobotClock
from wherry.ros.nodes.subscriptions import Subscriptions
from wherry.ros.topics import Topic
from wherry.ros.transports.protocol import Transport

YIELD_SECONDS = 1.0  # s after the last command of another node during which nothing is sent
ECHO_BUFFER_SIZE = 200  # own commands that are remembered, to recognize them when they are received back


class VelocityCommands:
    """Publishes velocities within the robot's limits, and detects commands of other nodes.

    Args:
        transport: Connection to ROS.
        subscriptions: Subscriptions of the agent's node.
        names: Names of topics and frames.
        limits: The robot's maximum velocities.
        clock: Clock for the stamps of velocities.
        stamped: Whether the robot takes TwistStamped (ROS 2 only).
    """

    def __init__(
        self,
        transport: Transport,
        subscriptions: Subscriptions,
        names: RosNames,
        limits: BodyParameters,
        clock: RobotClock,
        *,
        stamped: bool,
    ) -> None:
        self._transport, self._subscriptions = transport, subscriptions
        self._topics, self._frame = names.topics, names.frames.base_link
        self._limits = limits
        self._clock = clock
        self._stamped = stamped
        self._sent: deque[Velocity] = deque(maxlen=ECHO_BUFFER_SIZE)
        self._yield_until = -math.inf  # s, monotonic clock
        self._topic: Topic[Any] = self._topics.cmd_vel_stamped if stamped else self._topics.cmd_vel
        transport.advertise(self._topic)
        subscriptions.add(self._topics.cmd_vel, self._on_twist)
        if transport.ros_version == 2:
            subscriptions.add(self._topics.cmd_vel_stamped, lambda message: self._on_twist(message.twist))

    @property
    def is_yielding(self) -> bool:
        """Whether another node has commanded the robot within the last `YIELD_SECONDS`."""
        return time.monotonic() < self._yield_until

    @property
    def other_publishers(self) -> int:
        """Number of other nodes that publish velocities of the same type."""
        return self._transport.count_publishers(self._topic)

    def publish(self, velocity: Velocity) -> None:
        """Send a velocity, clipped to the robot's limits."""
        velocity = Velocity(
            _clipped(velocity.linear, self._limits.max_linear), _clipped(velocity.angular, self._limits.max_angular)
        )
        with self._subscriptions.changed:
            self._sent.append(velocity)
        twist = encode_twist(velocity)
        if self._stamped:
            header = encode_header(max(self._clock.time, 0.0), self._frame)
            self._transport.publish(self._topics.cmd_vel_stamped, ros.TwistStamped(header, twist))
        else:
            self._transport.publish(self._topics.cmd_vel, twist)

    def _on_twist(self, message: ros.Twist) -> None:
        """Yield to a command that is not an echo of an own one."""
        if decode_twist(message) not in self._sent:
            self._yield_until = time.monotonic() + YIELD_SECONDS


def _clipped(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)
