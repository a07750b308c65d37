"""Topics: a name, a message type, and a quality of service."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Generic

from wherry.ros.message_fields import MessageT


class QosProfile(Enum):
    """Quality of service of a topic, as a profile of ROS 2; of these, ROS 1 only has latching."""

    SENSOR = "only the newest messages count; subscribers accept best-effort delivery"
    RELIABLE = "every message is delivered"
    LATCHED = "every message is delivered, and late subscribers receive the last one"


@dataclass(frozen=True, slots=True)
class Topic(Generic[MessageT]):
    """A named stream of messages of one type.

    Attributes:
        name: Absolute name such as "/scan", once `wherry.ros.names` has resolved it.
        message_type: Class of the messages.
        qos: How messages are delivered.
    """

    name: str
    message_type: type[MessageT]
    qos: QosProfile = QosProfile.RELIABLE
