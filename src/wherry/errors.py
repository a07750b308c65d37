"""The one error that a user's input can cause, always naming where, what and why."""

from __future__ import annotations

from pathlib import Path


class InputError(Exception):
    """Input that cannot be used; the command line prints it as one line and exits with status 2.

    Args:
        source: The file, or the command-line option, that the input came from.
        field: The field, key or line in it that is wrong.
        reason: What is wrong with it, in words that say how to put it right.
    """

    def __init__(self, source: str | Path, field: str, reason: str) -> None:
        self.source = str(source)
        self.field = field
        self.reason = reason
        super().__init__(f"{self.source}: {field}: {reason}" if field else f"{self.source}: {reason}")
