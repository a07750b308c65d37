"""The latch that holds a box, over two topics of standard messages, so that every answer is certain.

``latch/command`` (sensor_msgs/JointState): joint "latch", position 1 to close it, 0 to open it. The header's stamp is
the command's number: later than that of any command before. A command may come twice; it is carried out once.

``latch/state`` (sensor_msgs/JointState), as soon as a command was carried out and ten times a second besides: "load" is
1 if the latch holds a box, else 0, and "answered" the stamp, s, of the last command that was carried out, 0 before the
first. Whoever asked waits until its own stamp is answered, and asks again as long as it is not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from wherry.ros import messages as ros
from wherry.ros.decoding import MessageError, decode_stamp
from wherry.ros.encoding import encode_header

LATCH, LOAD, ANSWERED = "latch", "load", "answered"
SAME = 1e-5  # s; stamps nearer than this are of one command: float64 has 2e-7 s left of today's date
SPACING = 1e-3  # s, from one command's stamp to the next at least


@dataclass(frozen=True, slots=True)
class LatchCommand:
    """What is asked of a latch.

    Attributes:
        number: s, the command's stamp.
        close: Whether to close it; to open it otherwise.
    """

    number: float
    close: bool


@dataclass(frozen=True, slots=True)
class LatchState:
    """What a latch tells of itself.

    Attributes:
        time: s.
        loaded: Whether it holds a box.
        answered: s, the number of the last command that was carried out.
    """

    time: float
    loaded: bool
    answered: float

    def answers(self, command: LatchCommand) -> bool:
        """Whether it was told after a command was carried out."""
        return abs(self.answered - command.number) < SAME


def to_latch_command(command: LatchCommand) -> ros.JointState:
    """A command as a message."""
    return ros.JointState(encode_header(command.number, ""), (LATCH,), np.array([float(command.close)]))


def from_latch_command(message: ros.JointState) -> LatchCommand:
    """A command.

    Raises:
        MessageError: It says neither open nor closed.
    """
    position = _positions(message).get(LATCH, math.nan)
    if position not in (0.0, 1.0):
        raise MessageError(f"asks for the latch position {position}; 1 closes it, 0 opens it")
    return LatchCommand(decode_stamp(message.header.stamp), position == 1.0)


def to_latch_state(state: LatchState) -> ros.JointState:
    """A state as a message."""
    return ros.JointState(
        encode_header(state.time, ""), (LOAD, ANSWERED), np.array([float(state.loaded), state.answered])
    )


def from_latch_state(message: ros.JointState) -> LatchState:
    """A state.

    Raises:
        MessageError: It does not say whether there is a load, or which command it answers.
    """
    positions = _positions(message)
    load, answered = positions.get(LOAD, math.nan), positions.get(ANSWERED, math.nan)
    if load not in (0.0, 1.0) or not math.isfinite(answered):
        raise MessageError(f"says {positions} instead of {LOAD} (0 or 1) and {ANSWERED}")
    return LatchState(decode_stamp(message.header.stamp), load == 1.0, answered)


def _positions(message: ros.JointState) -> dict[str, float]:
    return dict(zip(message.name, message.position.tolist(), strict=False))
