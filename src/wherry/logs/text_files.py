"""Lines of text files, plain or gzipped, with limits; files of other kinds are refused by name."""

from __future__ import annotations

import gzip
import io
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from wherry.errors import InputError

MAX_FILE_SIZE = 1_000_000_000  # bytes, unpacked
MAX_COMPRESSION_RATIO = 100  # unpacked size over the size of the gzipped file
MIN_CHECKED_SIZE = 10_000_000  # bytes, unpacked size below which the compression ratio is not checked
MAX_LINE_LENGTH = 200_000  # bytes
MANY_LINES = 500_000  # lines from which their mean length is checked
MIN_MEAN_LENGTH = 8  # bytes, of the lines of a long file; millions of empty lines fit a small gzipped file
HEAD_SIZE = 4096  # bytes at the beginning by which the kind of a file is recognized
MAX_CONTROL_SHARE = 0.05  # share of control characters among these above which a file is binary
CONTROL_CHARACTERS = bytes(byte for byte in range(32) if byte not in b"\t\n\v\f\r")
COMMENT_MARKS = ("#", "//", "%")
BYTE_ORDER_MARK = b"\xef\xbb\xbf"
GZIP = b"\x1f\x8b"
OTHER_KINDS = (
    (b"#ROSBAG", "is a ROS 1 bag: give it a name that ends in .bag"),
    (b"\x89MCAP", "is a ROS 2 bag: give it a name that ends in .mcap"),
    (b"SQLite format 3", "is a ROS 2 bag: give it a name that ends in .db3"),
    (b"\xff\xfe", "is text in UTF-16: convert it to UTF-8, as by iconv -f UTF-16 -t UTF-8"),
    (b"\xfe\xff", "is text in UTF-16: convert it to UTF-8, as by iconv -f UTF-16 -t UTF-8"),
    (b"\xfd7zXZ", "is compressed by xz: unpack it, or compress it by gzip"),
    (b"BZh", "is compressed by bzip2: unpack it, or compress it by gzip"),
    (b"PK\x03\x04", "is a zip archive: unpack it"),
    (b"\x28\xb5\x2f\xfd", "is compressed by zstd: unpack it, or compress it by gzip"),
    (GZIP, "is gzipped twice: unpack it"),
)
"""First bytes of files of other kinds, with what to do about them."""


def numbered_lines(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the lines of a text file, plain or gzipped, numbered from 1; only one line is in memory at a time.

    Whether it is gzipped is recognized by its first bytes, not by its name.

    Raises:
        InputError: The file cannot be read, is no text, or it or a line is too long.
    """
    try:
        with path.open("rb") as file:
            if file.peek(len(GZIP)).startswith(GZIP):
                with gzip.GzipFile(fileobj=file) as unpacked, io.BufferedReader(unpacked) as buffered:
                    yield from _checked_lines(path, buffered, path.stat().st_size)
            else:
                yield from _checked_lines(path, file, MAX_FILE_SIZE)
    except (OSError, EOFError, zlib.error) as error:
        reason = getattr(error, "strerror", None) or f"is not a whole gzip file: {error}"
        raise InputError(path, "", reason) from error


def is_comment(line: str) -> bool:
    """Whether a line is empty or a comment."""
    text = line.strip()
    return not text or text.startswith(COMMENT_MARKS)


def _checked_lines(path: Path, file: io.BufferedReader[Any], packed: int) -> Iterator[tuple[int, str]]:
    """The lines of an open file of a packed size, bytes, within the limits."""
    _check_kind(path, file.peek(HEAD_SIZE)[:HEAD_SIZE])
    number = size = 0
    while line := file.readline(MAX_LINE_LENGTH + 1):
        number, size = number + 1, size + len(line)
        if len(line) > MAX_LINE_LENGTH:
            raise InputError(path, f"line {number}", f"is longer than {MAX_LINE_LENGTH:,} bytes")
        if size > MAX_FILE_SIZE:
            raise InputError(path, "", f"is larger than {MAX_FILE_SIZE:,} bytes, unpacked")
        if size > max(MIN_CHECKED_SIZE, MAX_COMPRESSION_RATIO * packed):
            reason = f"unpacks to over {MAX_COMPRESSION_RATIO} times the file's size"
            raise InputError(path, f"line {number}", reason)
        if number > MANY_LINES and size < MIN_MEAN_LENGTH * number:
            raise InputError(path, f"line {number}", "comes after so many lines that are almost empty: this is no log")
        if number == 1:
            line = line.removeprefix(BYTE_ORDER_MARK)
        yield number, line.decode("utf-8", errors="replace")


def _check_kind(path: Path, head: bytes) -> None:
    """Refuse a file that is no text by its first bytes."""
    for first_bytes, reason in OTHER_KINDS:
        if head.startswith(first_bytes):
            raise InputError(path, "", reason)
    if b"\r" in head.rstrip(b"\r") and b"\n" not in head:
        raise InputError(path, "", "has lines that end in a carriage return only: convert it, as by tr '\\r' '\\n'")
    if len(head) - len(head.translate(None, CONTROL_CHARACTERS)) > MAX_CONTROL_SHARE * len(head):
        raise InputError(path, "", "is a binary file, not text")
