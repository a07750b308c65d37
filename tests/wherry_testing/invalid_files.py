"""Checks of files that a loader rejects."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from wherry.errors import InputError


def assert_file_is_rejected(load: Callable[[Path], object], path: Path, text: str, field: str) -> None:
    """Write a text to a file; check that loading it fails in one line that names the field."""
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        load(path)
    assert caught.value.field == field
    assert "\n" not in str(caught.value)
