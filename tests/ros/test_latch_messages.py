"""The messages of the latch survive encoding and decoding, and ambiguous ones are rejected."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wherry.ros import messages as ros
from wherry.ros.decoding import MessageError
from wherry.ros.nodes.latch import (
    LatchCommand,
    LatchState,
    from_latch_command,
    from_latch_state,
    to_latch_command,
    to_latch_state,
)


@pytest.mark.parametrize("close", [True, False])
def test_latch_commands_survive_the_round_trip(close: bool) -> None:
    command = LatchCommand(12.345678, close)
    assert from_latch_command(to_latch_command(command)) == command


def test_a_latch_state_answers_one_command() -> None:
    command = LatchCommand(1_700_000_000.123456, close=True)
    there = from_latch_command(to_latch_command(command))
    state = from_latch_state(to_latch_state(LatchState(5.0, loaded=True, answered=there.number)))
    assert state.loaded
    assert state.answers(command)
    assert not state.answers(LatchCommand(command.number + 1e-3, close=True))


@pytest.mark.parametrize(
    "message",
    [
        ros.JointState(),
        ros.JointState(name=("latch",)),
        ros.JointState(name=("latch",), position=np.array([0.5])),
        ros.JointState(name=("latch",), position=np.array([math.nan])),
        ros.JointState(name=("load", "answered"), position=np.array([2.0, 0.0])),
        ros.JointState(name=("load", "answered"), position=np.array([1.0, math.nan])),
    ],
)
def test_latch_messages_without_a_valid_position_are_rejected(message: ros.JointState) -> None:
    with pytest.raises(MessageError):
        from_latch_command(message)
    with pytest.raises(MessageError):
        from_latch_state(message)
