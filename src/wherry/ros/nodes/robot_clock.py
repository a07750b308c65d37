"""The time on a robot's clock, taken from its messages."""

from __future__ import annotations

import math

from wherry.ros import messages as ros
from wherry.ros.decoding import decode_stamp
from wherry.ros.nodes.subscriptions import Subscriptions
from wherry.ros.topics import Topic


class RobotClock:
    """The latest time on a robot's clock: from its measurements, and from ``/clock`` where time is simulated.

    Args:
        subscriptions: Subscriptions of the agent's node.
        topic: Topic of the simulated time, ``/clock``.

    Attributes:
        time: Latest time received, s; −inf before the first message.
        is_simulated: Whether ``/clock`` advances the time.
    """

    def __init__(self, subscriptions: Subscriptions, topic: Topic[ros.Clock]) -> None:
        self.time = -math.inf
        self.is_simulated = False
        subscriptions.add(topic, self._on_clock)

    def advance_to(self, stamp: float) -> None:
        """Set the time to a stamp, s, unless that is earlier."""
        self.time = max(self.time, stamp)

    def _on_clock(self, message: ros.Clock) -> None:
        now = decode_stamp(message.clock)
        if self.is_simulated:
            self.advance_to(now)
