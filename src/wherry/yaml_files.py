"""The old checks of YAML files, replaced by `wherry.documents`; gone once nothing imports it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import yaml

from wherry.errors import InputError
from wherry.files import read_text

LARGEST_FILE = 64_000  # bytes


def load_mapping(path: str | Path) -> dict[str, Any]:
    """Read a file; an empty one is an empty mapping.

    Raises:
        InputError: It cannot be read, or is no mapping.
    """
    return parse_mapping(path, read_text(path, limit=LARGEST_FILE))


def parse_mapping(source: str | Path, text: str) -> dict[str, Any]:
    """A text as a mapping.

    Args:
        source: What an error calls it.
        text: YAML.

    Raises:
        InputError: It is no mapping.
    """
    try:
        document = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise InputError(source, "", f"is not YAML: {str(error).splitlines()[0]}") from error
    if document is None:
        return {}
    if not isinstance(document, dict):
        raise InputError(source, "", "is not a mapping")
    return document


def check_number(source: str | Path, field: str, value: Any, *, most: float, positive: bool = True) -> float:
    """A number as it was read.

    Args:
        source: What an error calls the file.
        field: What an error calls the number.
        value: What was read; None if it is not there.
        most: How large it may be.
        positive: Whether it must be above 0; otherwise it may be as far below as above.

    Raises:
        InputError: It is not there, no number, or too small or large.
    """
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(source, field, "is missing" if value is None else f"{value!r} is no number")
    if abs(value) > most or (positive and value <= 0.0):
        raise InputError(source, field, f"{value} is not {'above 0 and ' if positive else ''}at most {most:g}")
    return float(value)
