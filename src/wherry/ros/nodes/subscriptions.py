"""Subscriptions of one node: their callbacks share a lock, and messages that cannot be used are counted."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from functools import partial

from wherry.errors import InputError
from wherry.ros.decoding import MessageError
from wherry.ros.diagnostics import RejectedMessages
from wherry.ros.message_fields import MessageT
from wherry.ros.topics import Topic
from wherry.ros.transports.protocol import Transport

POLL_PERIOD = 0.05  # s between checks of conditions that change without a message, such as deadlines


class Subscriptions:
    """Calls callbacks one at a time with a lock held, and wakes up waiting threads after each message.

    A callback rejects a message by raising `MessageError`.

    Args:
        transport: Connection to ROS.

    Attributes:
        changed: Re-entrant lock of all state that callbacks write; it is notified after each message.
        rejected: Counts of rejected messages by topic.
    """

    def __init__(self, transport: Transport) -> None:
        self.changed = threading.Condition()
        self.rejected = RejectedMessages()
        self._transport = transport

    def add(self, topic: Topic[MessageT], callback: Callable[[MessageT], None]) -> None:
        """Call ``callback`` with each message of a topic."""
        self._transport.subscribe(topic, partial(self._receive, topic.name, callback))

    def wait_for(self, missing: Callable[[], Sequence[str]], timeout: float) -> None:
        """Wait until ``missing`` returns an empty sequence.

        Args:
            missing: Returns names of the data not received yet, for the error; called with the lock held.
            timeout: Maximum waiting time, s.

        Raises:
            InputError: Something is still missing after ``timeout``.
        """
        deadline = time.monotonic() + timeout
        with self.changed:
            while names := missing():
                if time.monotonic() >= deadline:
                    reason = f"; rejected {self.rejected.last}" if self.rejected.last else ""
                    raise InputError("ROS", "", f"{', '.join(names)}: not received within {timeout:g} s{reason}")
                self.changed.wait(POLL_PERIOD)

    def _receive(self, topic: str, callback: Callable[[MessageT], None], message: MessageT) -> None:
        with self.changed:
            try:
                callback(message)
            except MessageError as error:
                self.rejected.add(topic, error)
            self.changed.notify_all()
