"""Lines and messages of a recording that cannot be used."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

from wherry.errors import InputError, on_one_line
from wherry.wording import counted, verb_for

MAX_REJECTED_SHARE = 0.25  # share of the lines or messages above which a recording is refused even if lenient
MAX_REJECTED = 200_000  # lines or messages above which a recording is refused without reading the rest
MIN_REJECTED = 4  # lines or messages below which the share is not checked, as in files of a few lines
REPORTED_REASONS = 2  # reasons named in a note, the most frequent ones
MAX_EXAMPLE_LENGTH = 100  # characters of an example in a note
NUMBER = re.compile(r"[-+]?\d[\d,]*\.?\d*(e[-+]?\d+)?")


@dataclass
class Rejections:
    """Lines or messages that cannot be used: each raises an error or, for a lenient reader, is left out and counted.

    Attributes:
        source: Name of the file.
        lenient: Whether to leave lines or messages out; otherwise the first one raises an error.
        entries: What was left out, as ``line 12: reason``.
    """

    source: str
    lenient: bool
    entries: list[str] = field(default_factory=list)

    def reject(self, name: str, reason: str) -> None:
        """Leave a line or message out.

        Args:
            name: Where it stands, such as ``line 12``.
            reason: Why it cannot be used, as a predicate.

        Raises:
            InputError: The reader is not lenient, or too much was left out; the error names the line and the reason.
        """
        if not self.lenient:
            raise InputError(self.source, name, f"{reason} (--lenient leaves it out)")
        self.entries.append(on_one_line(f"{name}: {reason}"))
        if len(self.entries) > MAX_REJECTED:
            raise InputError(self.source, name, f"is the last of over {MAX_REJECTED:,} that cannot be used: {reason}")

    def check_share(self, rejected: int, total: int, what: str) -> None:
        """Refuse a recording most of which would be left out.

        Args:
            rejected: Number of those that were left out.
            total: Number of all.
            what: What they are, such as ``scans``.

        Raises:
            InputError: The share is above `MAX_REJECTED_SHARE`; the error gives it and the most frequent reason.
        """
        if not are_too_many(rejected, total):
            return
        limit = f"more than the {MAX_REJECTED_SHARE:.0%} that --lenient leaves out"
        frequent = f"; most frequent: {self._groups()[0]}" if self.entries else ""
        raise InputError(self.source, "", f"{rejected:,} of {total:,} {what} cannot be used, {limit}{frequent}")

    def note(self, total: int) -> str:
        """A sentence on what was left out, of ``total`` lines or messages; empty if nothing was."""
        if not self.entries:
            return ""
        unit = "lines" if all(entry.startswith("line ") for entry in self.entries) else "messages"
        groups = self._groups()
        others = len(groups) - REPORTED_REASONS
        more = f", and {counted(others, 'other reason')}" if others > 0 else ""
        reasons = ", ".join(groups[:REPORTED_REASONS])
        number = len(self.entries)
        return f"{number:,} of {total:,} {unit} {verb_for(number, 'is', 'are')} left out: {reasons}{more}"

    def _groups(self) -> list[str]:
        """Numbers of entries of the same kind, the most frequent ones first, each with the first entry of the kind."""
        kinds = [_kind(entry) for entry in self.entries]
        first = dict(zip(reversed(kinds), reversed(self.entries), strict=True))
        return [f'{count:,} like "{_shortened(first[kind])}"' for kind, count in Counter(kinds).most_common()]


def are_too_many(rejected: int, total: int) -> bool:
    """Whether more of all were rejected than may be left out."""
    return rejected >= MIN_REJECTED and rejected > MAX_REJECTED_SHARE * total


def without_numbers(text: str) -> str:
    """A text with a mark in place of each number, by which texts of one kind are equal."""
    return NUMBER.sub("#", text)


def _kind(entry: str) -> str:
    """The reason of an entry without its numbers and quoted words."""
    reason = entry.partition(": ")[2]
    return without_numbers(reason.partition("'")[0])


def _shortened(text: str) -> str:
    """A text of limited length."""
    return text if len(text) <= MAX_EXAMPLE_LENGTH else text[: MAX_EXAMPLE_LENGTH - 1] + "…"


def joined(sentences: Iterable[str]) -> tuple[str, ...]:
    """The sentences that are not empty, each on one line whatever the file contains."""
    return tuple(on_one_line(sentence) for sentence in sentences if sentence)
