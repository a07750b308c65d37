"""The error that invalid input raises; it names the source, the field and the reason."""

from __future__ import annotations

from pathlib import Path


class InputError(Exception):
    """Invalid input from a user; the command line prints it as one line and exits with status 2.

    Args:
        source: File or command-line option that the input came from.
        field: Field, key or line of the source that is invalid; empty if the whole source is.
        reason: Why it is invalid, as a predicate that follows the field, such as "is missing".
    """

    def __init__(self, source: str | Path, field: str, reason: str) -> None:
        self.source = str(source)
        self.field = field
        self.reason = reason
        text = f"{self.source}: {field}: {reason}" if field else f"{self.source}: {reason}"
        super().__init__("".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in text))  # one line, also of a damaged file
