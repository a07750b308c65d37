"""The agent's side of the latch protocol: send a command until its answer is received."""

from __future__ import annotations

import time

from wherry.ros import messages as ros
from wherry.ros.names import Topics
from wherry.ros.nodes.errors import RobotLostError
from wherry.ros.nodes.latch_protocol import (
    MIN_STAMP_SPACING,
    LatchCommand,
    LatchState,
    decode_latch_state,
    encode_latch_command,
)
from wherry.ros.nodes.robot_clock import RobotClock
from wherry.ros.nodes.subscriptions import Subscriptions
from wherry.ros.transports.protocol import Transport

ANSWER_TIMEOUT = 0.5  # s from a command to its repetition
MAX_ATTEMPTS = 10  # transmissions of one command


class LatchClient:
    """Closes and opens a latch.

    Args:
        transport: Connection to ROS.
        subscriptions: Subscriptions of the agent's node.
        topics: Names of the latch's topics.
        clock: Clock for the stamps of commands.

    Attributes:
        state: Latest state received; None before the first one.
    """

    def __init__(self, transport: Transport, subscriptions: Subscriptions, topics: Topics, clock: RobotClock) -> None:
        self._transport, self._subscriptions, self._topics, self._clock = transport, subscriptions, topics, clock
        self._last_stamp = 0.0  # s, of the last command
        self.state: LatchState | None = None
        transport.advertise(topics.latch_command)
        subscriptions.add(topics.latch_state, self._on_state)

    def request(self, *, close: bool) -> LatchState:
        """Send a command until it is answered; returns the state after it.

        Raises:
            RobotLostError: `MAX_ATTEMPTS` transmissions were not answered.
        """
        self._last_stamp = max(self._clock.time, self._last_stamp + MIN_STAMP_SPACING)
        command = LatchCommand(self._last_stamp, close)
        for _ in range(MAX_ATTEMPTS):
            self._transport.publish(self._topics.latch_command, encode_latch_command(command))
            if (state := self._wait_for_answer(command)) is not None:
                return state
        raise RobotLostError(f"{self._topics.latch_state.name}: the latch does not answer")

    def _wait_for_answer(self, command: LatchCommand) -> LatchState | None:
        deadline = time.monotonic() + ANSWER_TIMEOUT
        with self._subscriptions.changed:
            while (remaining := deadline - time.monotonic()) > 0.0:
                if self.state is not None and self.state.answers(command):
                    return self.state
                self._subscriptions.changed.wait(remaining)
        return None

    def _on_state(self, message: ros.JointState) -> None:
        self.state = decode_latch_state(message)
