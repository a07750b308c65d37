"""The error that invalid input raises; it names the source, the field and the reason."""

from __future__ import annotations

from pathlib import Path

__all__ = ["InputError", "on_one_line"]

MAX_FIELD_CHARACTERS, MAX_REASON_CHARACTERS = 60, 240  # of a field and a reason, which may quote a damaged file


class InputError(Exception):
    """Invalid input from a user; the command line prints it as one line and exits with status 2.

    Args:
        source: File or command-line option that the input came from.
        field: Field, key or line of the source that is invalid; empty if the whole source is.
        reason: Why it is invalid, as a predicate that follows the field, such as "is missing".
    """

    def __init__(self, source: str | Path, field: str, reason: str) -> None:
        self.source = on_one_line(str(source))
        self.field = _shortened(on_one_line(field), MAX_FIELD_CHARACTERS)
        self.reason = _shortened(on_one_line(reason), MAX_REASON_CHARACTERS)
        super().__init__(f"{self.source}: {self.field}: {self.reason}" if field else f"{self.source}: {self.reason}")


def _shortened(text: str, length: int) -> str:
    """The text, or its beginning with an ellipsis."""
    return text if len(text) <= length else f"{text[: length - 1]}…"


def on_one_line(text: str) -> str:
    """The text with its control characters and line breaks, which a damaged file may contain, as escapes."""
    return "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in text)
