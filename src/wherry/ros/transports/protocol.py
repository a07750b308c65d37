"""The protocol of a ROS node's connection, common to ROS 1 and ROS 2.

`wherry.ros.transports.ros1` implements it with rospy, `wherry.ros.transports.ros2` with DDS. All other code depends on
this protocol only.
"""

from __future__ import annotations

from collections.abc import Callable
from types import TracebackType
from typing import Any, Protocol, Self

from wherry.ros.message_fields import MessageT
from wherry.ros.messages import String
from wherry.ros.topics import Topic


class Transport(Protocol):
    """A node of a ROS system; use it as a context manager, or call `close`."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None: ...

    @property
    def ros_version(self) -> int:
        """1 or 2."""
        ...

    def advertise(self, topic: Topic[Any]) -> None:
        """Announce that messages will be published on a topic, so that subscribers can connect before the first one."""
        ...

    def publish(self, topic: Topic[MessageT], message: MessageT) -> None:
        """Publish a message, advertising the topic first if needed. Never waits for subscribers."""
        ...

    def subscribe(self, topic: Topic[MessageT], callback: Callable[[MessageT], None]) -> None:
        """Call ``callback`` with each message of a topic.

        Callbacks run on a thread of the transport, one at a time over all topics, in the order of arrival on each
        topic. Messages are not validated here; `wherry.ros.decoding` does that.
        """
        ...

    def count_publishers(self, topic: Topic[Any]) -> int:
        """How many other nodes publish on a topic now."""
        ...

    def count_subscribers(self, topic: Topic[Any]) -> int:
        """How many other nodes subscribe to a topic now."""
        ...

    def is_connected(self) -> bool:
        """Whether the ROS system can be reached: in ROS 1 whether the master answers; always true in ROS 2."""
        ...

    def announce_sim_time(self) -> None:
        """Tell all nodes that time is simulated: a parameter of the master in ROS 1; in ROS 2 each node has its own."""
        ...

    def publish_robot_description(self, topic: Topic[String], urdf: str) -> None:
        """Publish a robot's URDF: as a parameter of the topic's name in ROS 1, as a latched message in ROS 2."""
        ...

    def close(self) -> None:
        """Leave the system. No callback runs after it has returned."""
        ...
