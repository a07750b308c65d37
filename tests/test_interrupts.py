"""Ctrl-C, also where Python would drop it."""

from __future__ import annotations

import signal
import sys
import time

import pytest

from wherry.interrupts import interrupts_are_kept


class Pressed:
    """Somebody presses Ctrl-C while it is being deleted."""

    def __del__(self) -> None:
        signal.raise_signal(signal.SIGINT)


def test_ctrl_c_while_an_object_is_deleted_stops_the_run() -> None:
    def run() -> None:
        Pressed()
        time.sleep(10.0)

    with pytest.raises(KeyboardInterrupt), interrupts_are_kept():
        run()


def test_other_faults_while_an_object_is_deleted_are_told_as_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    class Faulty:
        def __del__(self) -> None:
            raise ValueError("told")

    told = []
    monkeypatch.setattr(sys, "unraisablehook", lambda fault: told.append(str(fault.exc_value)))
    with interrupts_are_kept():
        Faulty()
    assert told == ["told"]
