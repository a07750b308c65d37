"""A Ctrl-C that Python drops is sent again."""

from __future__ import annotations

import signal
import sys
import time

import pytest

from wherry.interrupts import resend_dropped_interrupts


class InterruptedOnDeletion:
    """An object during whose deletion Ctrl-C is pressed."""

    def __del__(self) -> None:
        signal.raise_signal(signal.SIGINT)


def test_ctrl_c_during_the_deletion_of_an_object_stops_the_run() -> None:
    def run() -> None:
        InterruptedOnDeletion()
        time.sleep(10.0)

    with pytest.raises(KeyboardInterrupt), resend_dropped_interrupts():
        run()


def test_other_exceptions_in_a_destructor_reach_the_original_hook(monkeypatch: pytest.MonkeyPatch) -> None:
    class Faulty:
        def __del__(self) -> None:
            raise ValueError("faulty")

    messages = []
    monkeypatch.setattr(sys, "unraisablehook", lambda fault: messages.append(str(fault.exc_value)))
    with resend_dropped_interrupts():
        Faulty()
    assert messages == ["faulty"]
