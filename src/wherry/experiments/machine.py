"""The load of the machine, which is reported with every time measured on it."""

from __future__ import annotations

import os


def machine_load() -> str:
    """Load average of the last minute and number of cores, as text: ``load 1.3 on 2 cores``."""
    cores = os.cpu_count() or 1
    return f"load {os.getloadavg()[0]:.1f} on {cores} core{'s' if cores > 1 else ''}"
