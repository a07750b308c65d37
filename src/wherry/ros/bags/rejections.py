"""Messages of a bag that cannot be used."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from wherry.errors import InputError, on_one_line
from wherry.ros.decoding import MessageError


@dataclass
class Rejections:
    """The messages that cannot be used: each raises an error or, for a lenient reader, is skipped and counted.

    Attributes:
        path: Path of the bag.
        lenient: Whether to skip messages instead of raising an error.
        skipped: Name and reason of each skipped message.
    """

    path: Path
    lenient: bool
    skipped: list[str] = field(default_factory=list)

    def add(self, name: str, error: MessageError) -> None:
        """Reject a message.

        Raises:
            InputError: The reader is not lenient.
        """
        if not self.lenient:
            raise InputError(self.path, name, str(error)) from error
        self.skipped.append(on_one_line(f"{name}: {error}"))
