"""The error that invalid input raises; it names the source, the field and the reason."""

from __future__ import annotations

from pathlib import Path

__all__ = ["InputError", "on_one_line"]

MAX_FIELD_CHARACTERS = 60  # of a field, which may quote a damaged file
MAX_LINE_CHARACTERS = 290  # of an error with source and field
MIN_REASON_CHARACTERS = 160  # of a reason that are kept even where the path of its file is long


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
        place = f"{self.source}: {self.field}: " if field else f"{self.source}: "
        self.reason = _shortened(on_one_line(reason), max(MIN_REASON_CHARACTERS, MAX_LINE_CHARACTERS - len(place)))
        super().__init__(place + self.reason)


def _shortened(text: str, length: int) -> str:
    """The text, or its beginning with an ellipsis."""
    return text if len(text) <= length else f"{text[: length - 1]}…"


def on_one_line(text: str) -> str:
    """The text with its control characters and line breaks, which a damaged file may contain, as escapes."""
    return "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in text)
