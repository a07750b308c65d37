"""What every way of talking ROS offers: topics to publish on and to listen to, and nothing of generations.

`wherry.ros.transports.ros1` does it through rospy, `wherry.ros.transports.ros2` through DDS; everything else here knows
only a `Transport`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from types import TracebackType
from typing import Any, Generic, Protocol, Self

from wherry.ros.messages import M


class Quality(Enum):
    """How a topic's messages are delivered; ROS 2's QoS, and latching in ROS 1."""

    SENSOR = "the newest counts; listeners accept best effort"
    RELIABLE = "every message arrives"
    LATCHED = "every message arrives, and who comes later gets the last one"


@dataclass(frozen=True, slots=True)
class Topic(Generic[M]):
    """A named stream of messages of one type.

    Attributes:
        name: Absolute, such as "/scan", once `wherry.ros.names` has resolved it.
        message_type: What travels on it.
        quality: How.
    """

    name: str
    message_type: type[M]
    quality: Quality = Quality.RELIABLE


class Transport(Protocol):
    """A node of a ROS system; use it as a context manager, or call `close`."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None: ...

    @property
    def generation(self) -> int:
        """1 or 2: of ROS."""
        ...

    def advertise(self, topic: Topic[Any]) -> None:
        """Say that messages will be published on a topic, so that others can connect before the first one."""
        ...

    def publish(self, topic: Topic[M], message: M) -> None:
        """Send a message; `advertise` is called if it was not. Never waits for listeners."""
        ...

    def subscribe(self, topic: Topic[M], heard: Callable[[M], None]) -> None:
        """Call ``heard`` with each message of a topic.

        Calls come from a thread of the transport, never two at once over all topics, in the order of arrival on each
        topic. What a message holds is not checked yet: `wherry.ros.conversion` does that.
        """
        ...

    def publishers_of(self, topic: Topic[Any]) -> int:
        """How many others, apart from this node, publish on a topic now."""
        ...

    def subscribers_of(self, topic: Topic[Any]) -> int:
        """How many others, apart from this node, listen to a topic now."""
        ...

    def connected(self) -> bool:
        """Whether the system can still be reached: in ROS 1 that the master answers; DDS has no such thing."""
        ...

    def close(self) -> None:
        """Leave the system. No callback runs once it has returned."""
        ...
