"""Output folders are created and checked before a run starts."""

from __future__ import annotations

from pathlib import Path

import pytest

from wherry.errors import InputError
from wherry.files import ensure_writable_folder


def test_missing_folders_are_created_and_left_empty(tmp_path: Path) -> None:
    for _ in range(2):  # the second call finds an existing folder
        ensure_writable_folder(tmp_path / "a" / "b")
        assert list((tmp_path / "a" / "b").iterdir()) == []


def test_a_path_through_a_file_is_rejected(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"file/out: cannot be created: Not a directory$"):
        ensure_writable_folder(tmp_path / "file" / "out")
    with pytest.raises(InputError, match=r"file: cannot be created: File exists$"):
        ensure_writable_folder(tmp_path / "file")


def test_a_folder_that_is_not_writable_is_rejected() -> None:
    with pytest.raises(InputError, match=r"\.probe: cannot be written: "):
        ensure_writable_folder("/proc/self")
