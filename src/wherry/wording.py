"""Numbers of things in sentences for people."""

from __future__ import annotations


def counted(number: int, noun: str) -> str:
    """A number with its noun, such as ``1 scan`` or ``2,251 scans``.

    Args:
        number: The number.
        noun: The noun in the singular, whose plural ends in s.
    """
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def verb_for(number: int, singular: str, plural: str) -> str:
    """The verb of a sentence whose subject is a number of things."""
    return singular if number == 1 else plural
