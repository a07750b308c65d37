"""Files are read up to a size limit and written without partial results; output folders are checked."""

from __future__ import annotations

import os
import tracemalloc
from pathlib import Path

import pytest

from wherry.errors import InputError
from wherry.files import create_unused_folder, ensure_writable_folder, partial_file, read_bytes, read_text


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


@pytest.mark.parametrize("data", [b"\xc3\xa4: 1", b"\xef\xbb\xbf\xc3\xa4: 1"])
def test_text_is_utf_8_with_or_without_byte_order_mark(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "text").write_bytes(data)
    assert read_text(tmp_path / "text", max_bytes=100) == "ä: 1"


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-be", "latin-1"])
def test_text_in_another_encoding_is_refused(tmp_path: Path, encoding: str) -> None:
    text = "ä: 1" if encoding != "utf-16-be" else "\ufeffä: 1"
    (tmp_path / "text").write_bytes(text.encode(encoding))
    with pytest.raises(InputError, match="UTF-8"):
        read_text(tmp_path / "text", max_bytes=100)


def test_a_pipe_which_might_never_end_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="pipe: is not a file"):
        read_bytes(tmp_path / "pipe", max_bytes=5)


@pytest.mark.parametrize("name", ["missing", "null\0character", "long" * 100])
def test_a_path_that_cannot_be_opened_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError):
        read_bytes(tmp_path / name, max_bytes=5)


def test_reading_a_small_file_reserves_no_memory_for_the_largest(tmp_path: Path) -> None:
    (tmp_path / "small").write_bytes(b"1")
    tracemalloc.start()
    try:
        assert read_bytes(tmp_path / "small", max_bytes=10**9) == b"1"
        assert tracemalloc.get_traced_memory()[1] < 10_000_000
    finally:
        tracemalloc.stop()
