from __future__ import annotations

import math

import numpy as np
import pytest

from wherry.ros import messages as ros
from wherry.ros.decoding import MessageError
from wherry.ros.nodes.latch_protocol import (
    LatchCommand,
    LatchState,
    decode_latch_command,
    decode_latch_state,
    encode_latch_command,
    encode_latch_state,
)


@pytest.mark.parametrize("close", [True, False])
def test_commands_are_converted_without_loss(close: bool) -> None:
    command = LatchCommand(12.345678, close)
    assert decode_latch_command(encode_latch_command(command)) == command


def test_answer_belongs_to_one_command() -> None:
    command = LatchCommand(1_700_000_000.123456, close=True)
    received = decode_latch_command(encode_latch_command(command))
    state = decode_latch_state(encode_latch_state(LatchState(5.0, has_load=True, answered=received.stamp)))
    assert state.has_load
    assert state.answers(command)
    assert not state.answers(LatchCommand(command.stamp + 1e-3, close=True))


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
def test_invalid_messages_are_rejected(message: ros.JointState) -> None:
    with pytest.raises(MessageError):
        decode_latch_command(message)
    with pytest.raises(MessageError):
        decode_latch_state(message)
