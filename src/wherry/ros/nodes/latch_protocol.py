"""The latch that holds a box: commands and states as standard messages, so that every command is acknowledged.

``latch/command`` (sensor_msgs/JointState): joint "latch" at position 1 to close it, 0 to open it. The header's stamp
identifies the command and must be later than that of any command before. A command may be sent again; it is carried out
once.

``latch/state`` (sensor_msgs/JointState), published after each command and ten times a second: "load" is 1 if the latch
holds a box, else 0; "answered" is the stamp, s, of the last command that was carried out, 0 before the first. The
client repeats its command until "answered" is the command's stamp.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from wherry.ros import messages as ros
from wherry.ros.decoding import MessageError, decode_stamp
from wherry.ros.encoding import encode_header

LATCH, LOAD, ANSWERED = "latch", "load", "answered"  # joint names
STAMP_TOLERANCE = 1e-5  # s; float64 resolves 2e-7 s at today's dates
MIN_STAMP_SPACING = 1e-3  # s between the stamps of two commands


@dataclass(frozen=True, slots=True)
class LatchCommand:
    """A request to close or open the latch.

    Attributes:
        stamp: Stamp that identifies the command, s.
        close: Whether to close the latch rather than open it.
    """

    stamp: float
    close: bool


@dataclass(frozen=True, slots=True)
class LatchState:
    """What a latch reports.

    Attributes:
        time: Time of the report, s.
        has_load: Whether the latch holds a box.
        answered: Stamp of the last command that was carried out, s; 0 before the first.
    """

    time: float
    has_load: bool
    answered: float

    def answers(self, command: LatchCommand) -> bool:
        """Whether ``command`` is the last one that was carried out."""
        return abs(self.answered - command.stamp) < STAMP_TOLERANCE


def encode_latch_command(command: LatchCommand) -> ros.JointState:
    """Convert a command to a message."""
    return ros.JointState(encode_header(command.stamp, ""), (LATCH,), np.array([float(command.close)]))


def decode_latch_command(message: ros.JointState) -> LatchCommand:
    """Convert a message to a command.

    Raises:
        MessageError: The position is neither 0 nor 1.
    """
    position = _positions(message).get(LATCH, math.nan)
    if position not in (0.0, 1.0):
        raise MessageError(f"asks for the latch position {position}; 1 closes it, 0 opens it")
    return LatchCommand(decode_stamp(message.header.stamp), position == 1.0)


def encode_latch_state(state: LatchState) -> ros.JointState:
    """Convert a state to a message."""
    positions = np.array([float(state.has_load), state.answered])
    return ros.JointState(encode_header(state.time, ""), (LOAD, ANSWERED), positions)


def decode_latch_state(message: ros.JointState) -> LatchState:
    """Convert a message to a state.

    Raises:
        MessageError: "load" is neither 0 nor 1, or "answered" is missing or not finite.
    """
    positions = _positions(message)
    load, answered = positions.get(LOAD, math.nan), positions.get(ANSWERED, math.nan)
    if load not in (0.0, 1.0) or not math.isfinite(answered):
        raise MessageError(f"has the joints {positions} instead of {LOAD} (0 or 1) and {ANSWERED}")
    return LatchState(decode_stamp(message.header.stamp), load == 1.0, answered)


def _positions(message: ros.JointState) -> dict[str, float]:
    return dict(zip(message.name, message.position.tolist(), strict=False))
