"""Loaders with one fault each, which the fuzzer must find."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from fuzz.invariants import check_grid
from fuzz.loader import Loader
from wherry.errors import InputError
from wherry.space.occupancy import OccupancyGrid


def _write(folder: Path) -> Path:
    """A file that none of the loaders reads."""
    (folder / "file.txt").write_text("1 2 3\n")
    return folder / "file.txt"


def _raise(path: Path) -> None:
    raise KeyError(path.name)


def _refuse(path: Path) -> None:
    raise InputError(path, "line 1", "is damaged")


def _hang(path: Path) -> None:
    time.sleep(600.0)


def _compute(path: Path) -> None:
    while time.process_time() < 600.0:
        pass


def _die(path: Path) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def _hoard(path: Path) -> None:
    np.ones(10_000_000_000)


def _accept_nonsense(path: Path) -> OccupancyGrid:
    return OccupancyGrid(np.full((2, 2), np.nan, np.float32), 0.05)


FAULTS: dict[str, Callable[[Path], Any]] = {
    "raises": _raise,
    "refuses": _refuse,
    "hangs": _hang,
    "computes": _compute,
    "dies": _die,
    "hoards": _hoard,
    "accepts": _accept_nonsense,
}
FAULTY_LOADERS = tuple(Loader(name, load, check_grid, _write) for name, load in FAULTS.items())
