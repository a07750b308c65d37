"""Files are read up to a size limit and written without partial results; output folders are checked."""

from __future__ import annotations

from pathlib import Path

import pytest

from wherry.errors import InputError
from wherry.files import create_unused_folder, ensure_writable_folder, partial_file, read_bytes


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


def test_a_file_above_the_size_limit_is_rejected(tmp_path: Path) -> None:
    path = tmp_path / "data"
    path.write_bytes(b"12345")
    assert read_bytes(path, max_bytes=5) == b"12345"
    with pytest.raises(InputError, match="data: is larger than 4 bytes"):
        read_bytes(path, max_bytes=4)


def test_a_partial_file_gets_its_name_when_the_block_ends_even_by_an_exception(tmp_path: Path) -> None:
    path = tmp_path / "film.mp4"

    def interrupted_writing() -> None:
        with partial_file(path) as partial:
            assert partial == tmp_path / "film.part.mp4"
            partial.write_bytes(b"content")
            assert not path.exists()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted_writing()
    assert path.read_bytes() == b"content"
    assert list(tmp_path.iterdir()) == [path]


def test_an_unused_folder_has_the_first_free_number(tmp_path: Path) -> None:
    names = [create_unused_folder(tmp_path / "runs" / "a").name for _ in range(3)]
    assert names == ["a", "a-2", "a-3"]
    (tmp_path / "runs" / "a-2").rmdir()
    assert create_unused_folder(tmp_path / "runs" / "a").name == "a-2"


def test_a_folder_that_cannot_be_created_is_named(tmp_path: Path) -> None:
    (tmp_path / "runs").write_text("a file")
    with pytest.raises(InputError, match="cannot be created"):
        create_unused_folder(tmp_path / "runs" / "a")
