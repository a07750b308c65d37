"""Ctrl-C that is not lost."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

AGAIN = 0.05  # s


@contextmanager
def interrupts_are_kept() -> Iterator[None]:
    """Send Ctrl-C again where Python drops it.

    A `KeyboardInterrupt` that comes while an object is being deleted, or a library in C calls back, is only printed as
    "ignored", and the run would go on as if nobody had pressed a key.
    """
    usual = sys.unraisablehook

    def hook(dropped: sys.UnraisableHookArgs) -> None:
        if issubclass(dropped.exc_type, KeyboardInterrupt):
            threading.Timer(AGAIN, signal.pthread_kill, (threading.get_ident(), signal.SIGINT)).start()
        else:
            usual(dropped)

    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = usual
