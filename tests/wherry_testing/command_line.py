"""Commands of the command line, run in the process of a test."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple


class CommandResult(NamedTuple):
    """How a command ended.

    Attributes:
        status: Exit status.
        out: Text on standard output.
        err: Text on standard error.
    """

    status: int
    out: str
    err: str


RunCommand = Callable[..., CommandResult]
"""A function that runs ``wherry`` with the given arguments."""
