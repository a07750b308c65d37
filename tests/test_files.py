"""Folders for results: made, tried out, or refused in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from wherry.errors import InputError
from wherry.files import make_folder


def test_a_folder_is_made_with_those_around_it_and_left_empty(tmp_path: Path) -> None:
    for _ in range(2):  # it may be there already
        make_folder(tmp_path / "a" / "b")
        assert list((tmp_path / "a" / "b").iterdir()) == []


def test_a_folder_in_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"file/out: cannot be made: Not a directory$"):
        make_folder(tmp_path / "file" / "out")
    with pytest.raises(InputError, match=r"file: cannot be made: File exists$"):
        make_folder(tmp_path / "file")


def test_a_folder_that_cannot_be_written_to_is_refused() -> None:
    with pytest.raises(InputError, match=r"\.probe: cannot be written: "):
        make_folder("/proc/self")
