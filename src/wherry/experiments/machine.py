"""What the machine is busy with, said beside every time that is measured on it."""

from __future__ import annotations

import os


def load_in_words() -> str:
    """The load of the last minute and the number of cores: ``load 1.3 on 2 cores``."""
    cores = os.cpu_count() or 1
    return f"load {os.getloadavg()[0]:.1f} on {cores} core{'s' if cores > 1 else ''}"
