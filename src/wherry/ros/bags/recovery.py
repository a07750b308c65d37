"""Copies of bag files that rosbags can read: decompressed, complete although their recorder was killed, or renamed."""

from __future__ import annotations

import sqlite3
from contextlib import ExitStack, closing
from pathlib import Path
from shutil import copyfile
from struct import Struct
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO

from wherry.ros.bags.files import COMPRESSED, MCAP_MAGIC, URI_CHARACTERS, is_cut_off, write_ahead_log

MAX_FILE_SIZE = 20_000_000_000  # bytes of a file that is copied
BLOCK_SIZE = 1_000_000  # bytes copied at once
RECORD_HEADER = Struct("<BQ")  # of an MCAP record: its type, and the length of its content
MCAP_END = RECORD_HEADER.pack(0x0F, 4) + bytes(4) + RECORD_HEADER.pack(0x02, 20) + bytes(20) + MCAP_MAGIC
"""The records DataEnd and Footer without checksums and summary, and the magic."""


def readable_copy(file: Path, stack: ExitStack) -> Path:
    """A file that rosbags can read: the file itself, or a copy that lasts as long as the stack.

    Raises:
        ValueError: The file is too large for a copy.
        OSError, sqlite3.Error: It cannot be copied.
    """
    if file.suffix == COMPRESSED:
        copy = _copy_path(file, stack, file.stem)
        with zstd().open(file, "rb") as compressed:
            _copy(compressed, copy)
    elif write_ahead_log(file) is not None:
        copy = _copy_path(file, stack, file.name)
        _copy_database(file, copy)
    elif file.suffix == ".db3" and URI_CHARACTERS & set(str(file)):
        copy = _copy_path(file, stack, "bag.db3")
        copy.symlink_to(file.resolve())
    elif is_cut_off(file):
        copy = _copy_path(file, stack, file.name)
        _copy_complete_records(file, copy)
    else:
        return file
    return copy


def zstd() -> Any:
    """Python's zstd module, which rosbags installs for older versions of Python."""
    try:
        from compression import zstd as module  # type: ignore[import-not-found, unused-ignore]  # noqa: PLC0415
    except ImportError:
        from backports import zstd as module  # noqa: PLC0415
    return module


def _copy_path(file: Path, stack: ExitStack, name: str) -> Path:
    """Path for a copy in a temporary folder."""
    if file.stat().st_size > MAX_FILE_SIZE:
        raise ValueError(f"holds more than {MAX_FILE_SIZE:,} bytes")
    return Path(stack.enter_context(TemporaryDirectory(prefix="wherry-"))) / name


def _copy(source: BinaryIO, copy: Path) -> None:
    """Copy what is left of a stream."""
    size = 0
    with copy.open("wb") as output:
        while block := source.read(BLOCK_SIZE):
            size += output.write(block)
            if size > MAX_FILE_SIZE:
                raise ValueError(f"holds more than {MAX_FILE_SIZE:,} bytes")


def _copy_database(file: Path, copy: Path) -> None:
    """Copy an SQLite file with the messages that its recorder had not yet written from the write-ahead log into it."""
    log = write_ahead_log(file)
    copyfile(file, copy)
    if log is not None:
        copyfile(log, copy.with_name(log.name))
    with closing(sqlite3.connect(copy)) as database:
        database.execute("PRAGMA journal_mode = DELETE")


def _copy_complete_records(file: Path, copy: Path) -> None:
    """Copy the complete records of an MCAP file that its recorder did not close, and close the copy."""
    size = file.stat().st_size
    end = len(MCAP_MAGIC)
    with file.open("rb") as source:
        while end + RECORD_HEADER.size <= size:
            source.seek(end)
            kind, length = RECORD_HEADER.unpack(source.read(RECORD_HEADER.size))
            if kind == 0 or end + RECORD_HEADER.size + length > size:
                break
            end += RECORD_HEADER.size + length
    copyfile(file, copy)
    with copy.open("r+b") as output:
        output.truncate(end)
        output.seek(end)
        output.write(MCAP_END)
