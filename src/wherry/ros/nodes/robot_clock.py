"""Time on a robot's clock, as far as its messages tell."""

from __future__ import annotations

import math

from wherry.ros import messages as ros
from wherry.ros.decoding import decode_stamp
from wherry.ros.nodes.subscriptions import Subscriptions
from wherry.ros.topics import Topic


class RobotClock:
    """The latest time on a robot's clock: of its measurements, and of ``/clock`` where time is simulated.

    Args:
        subscriptions: The node's.
        topic: ``/clock``.

    Attributes:
        time: Latest time received, s; −inf before the first message.
        is_simulated: Whether ``/clock`` is the time.
    """

    def __init__(self, subscriptions: Subscriptions, topic: Topic[ros.Clock]) -> None:
        self.time = -math.inf
        self.is_simulated = False
        subscriptions.add(topic, self._on_clock)

    def advance_to(self, stamp: float) -> None:
        """Take note of a stamp, s; the clock never goes back."""
        self.time = max(self.time, stamp)

    def _on_clock(self, message: ros.Clock) -> None:
        now = decode_stamp(message.clock)
        if self.is_simulated:
            self.advance_to(now)
