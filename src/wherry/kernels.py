"""The one decorator for compiled inner loops.

A kernel takes and returns arrays, draws no random numbers, and lives beside the function that explains it. Importing
this module imports numba (0.4 s), so nothing that must answer at once may import it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

Kernel = TypeVar("Kernel", bound=Callable[..., Any])


def kernel(function: Kernel) -> Kernel:
    """Compile a function with numba on its first call, and keep the machine code on disk for later processes.

    ``error_model="numpy"``: dividing by zero gives an infinity, as in numpy, which spares a check at every division.
    """
    return cast("Kernel", numba.njit(cache=True, error_model="numpy")(function))
