"""Delivery of Ctrl-C where Python would ignore it."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

RESEND_DELAY = 0.05  # s from a dropped interrupt until it is sent again


@contextmanager
def resend_dropped_interrupts() -> Iterator[None]:
    """Send SIGINT again whenever Python drops a `KeyboardInterrupt`.

    Python cannot propagate an exception that is raised in ``__del__`` or in a callback from C: it prints "Exception
    ignored" and continues, so that Ctrl-C would have no effect.
    """
    original_hook = sys.unraisablehook

    def hook(dropped: sys.UnraisableHookArgs) -> None:
        if issubclass(dropped.exc_type, KeyboardInterrupt):
            threading.Timer(RESEND_DELAY, signal.pthread_kill, (threading.get_ident(), signal.SIGINT)).start()
        else:
            original_hook(dropped)

    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = original_hook
