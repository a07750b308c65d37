"""Decorators that compile inner loops with numba.

A kernel takes and returns arrays, draws no random numbers, and is next to the function that documents it. Importing
this module imports numba (0.4 s), so ``wherry --help`` must not import it.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

Kernel = TypeVar("Kernel", bound=Callable[..., Any])


def kernel(function: Kernel) -> Kernel:
    """Compile a function with numba on its first call, and cache the machine code on disk for later processes.

    Division by zero gives an infinity, as in numpy, which saves a check at every division.
    """
    return cast("Kernel", numba.njit(cache=True, error_model="numpy")(function))


def fastmath_kernel(function: Kernel) -> Kernel:
    """Compile as `kernel` does, but allow sums to be reordered and vectorized; NaN and infinities keep their meaning.

    The order depends on the processor only, so results repeat bit for bit on the same machine.
    """
    flags = {"reassoc", "nsz", "contract"}  # LLVM's fast-math flags, without those that assume finite values
    return cast("Kernel", numba.njit(cache=True, error_model="numpy", fastmath=flags)(function))


def generator_kernel(function: Kernel) -> Kernel:
    """Compile a generator that kernels loop over.

    It is inlined into the cached kernels and not cached itself, since numba 0.68 loses a generator's body in its cache.
    """
    return cast("Kernel", numba.njit(error_model="numpy")(function))


def are_kernels_cached() -> bool:
    """Whether an earlier process has cached compiled kernels next to their sources."""
    return next(Path(__file__).parent.rglob("__pycache__/*.nbi"), None) is not None
