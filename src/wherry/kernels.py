"""The one decorator for compiled inner loops.

A kernel takes and returns arrays, draws no random numbers, and lives beside the function that explains it. Importing
this module imports numba (0.4 s), so nothing that must answer at once may import it.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

Kernel = TypeVar("Kernel", bound=Callable[..., Any])


def kernel(function: Kernel) -> Kernel:
    """Compile a function with numba on its first call, and keep the machine code on disk for later processes.

    ``error_model="numpy"``: dividing by zero gives an infinity, as in numpy, which spares a check at every division.
    """
    return cast("Kernel", numba.njit(cache=True, error_model="numpy")(function))


def reordering_kernel(function: Kernel) -> Kernel:
    """As `kernel`, and sums may be added up in any order: on vector units, but always in the same one on a machine.

    NaN and infinities keep their meaning.
    """
    fast = {"reassoc", "nsz", "contract"}
    return cast("Kernel", numba.njit(cache=True, error_model="numpy", fastmath=fast)(function))


def stepper(function: Kernel) -> Kernel:
    """Compile a generator that kernels loop over; it is compiled into each of them.

    It is not kept on disk by itself: numba 0.68 forgets a generator's body when it is loaded from there.
    """
    return cast("Kernel", numba.njit(error_model="numpy")(function))


def are_compiled() -> bool:
    """Whether an earlier process has left compiled kernels beside their sources."""
    return next(Path(__file__).parent.rglob("__pycache__/*.nbi"), None) is not None
