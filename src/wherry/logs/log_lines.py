"""Lines of text logs, and the checked values in their words."""

from __future__ import annotations

import gzip
import math
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from wherry.errors import InputError
from wherry.logs.lidar_log import MAX_BEAMS
from wherry.robot import mark_no_return
from wherry.space.pose import Floats, Pose

MAX_FILE_SIZE = 1_000_000_000  # bytes, unpacked
MAX_COMPRESSION_RATIO = 100  # unpacked size over the size of the gzipped file
MIN_CHECKED_SIZE = 10_000_000  # bytes, unpacked size below which the compression ratio is not checked
MAX_LINE_LENGTH = 200_000  # bytes
MAX_NUMBER = 1e20  # largest absolute value of a number in a log
MAX_COORDINATE = 1e9  # m
RANGE_MIN = 0.02  # m, shortest valid range of a lidar whose log does not give one


class MalformedLineError(Exception):
    """A line that cannot be used; the message is the reason."""


def numbered_lines(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the lines of a text file, plain or gzipped, numbered from 1; only one line is in memory at a time.

    Raises:
        InputError: The file cannot be read, or it or a line is too long.
    """
    size = 0
    try:
        packed = path.stat().st_size if path.suffix == ".gz" else MAX_FILE_SIZE
        with gzip.open(path, "rb") if path.suffix == ".gz" else path.open("rb") as file:
            number = 0
            while line := file.readline(MAX_LINE_LENGTH + 1):
                number, size = number + 1, size + len(line)
                if len(line) > MAX_LINE_LENGTH:
                    raise InputError(path, f"line {number}", f"is longer than {MAX_LINE_LENGTH:,} bytes")
                if size > MAX_FILE_SIZE:
                    raise InputError(path, "", f"is larger than {MAX_FILE_SIZE:,} bytes, unpacked")
                if size > max(MIN_CHECKED_SIZE, MAX_COMPRESSION_RATIO * packed):
                    reason = f"unpacks to over {MAX_COMPRESSION_RATIO} times the file's size"
                    raise InputError(path, f"line {number}", reason)
                yield number, line.decode("utf-8", errors="replace")
    except (OSError, EOFError, zlib.error) as error:
        reason = getattr(error, "strerror", None) or f"is not a whole gzip file: {error}"
        raise InputError(path, "", reason) from error


def parse_numbers(words: list[str]) -> list[float]:
    """The words as finite numbers.

    Raises:
        MalformedLineError: A word is no finite number, or too large.
    """
    try:
        values = [float(word) for word in words]
    except ValueError as error:
        raise MalformedLineError(f"has a word that is not a number: {str(error).rpartition(': ')[2]}") from error
    if not all(math.isfinite(value) for value in values):
        raise MalformedLineError("has a number that is not finite")
    if any(abs(value) > MAX_NUMBER for value in values):
        raise MalformedLineError(f"has a number beyond {MAX_NUMBER:g}")
    return values


def parse_count(words: list[str], index: int, minimum: int = 1) -> int:
    """The number of beams at a word.

    Raises:
        MalformedLineError: The word is missing, no whole number, or impossible.
    """
    try:
        count = int(words[index])
    except (ValueError, IndexError) as error:
        raise MalformedLineError("does not say how many beams it has") from error
    if not minimum <= count <= MAX_BEAMS:
        raise MalformedLineError(f"has {count} beams; {minimum} to {MAX_BEAMS:,} are possible")
    return count


def parse_ranges(words: list[str], range_max: float, unit: float = 1.0) -> Floats:
    """Ranges, [R] m; infinite where the beam had no return, see `mark_no_return`.

    Args:
        words: Ranges as text.
        range_max: Longest valid range, m.
        unit: Unit of the words, m.

    Raises:
        MalformedLineError: A word is no finite number, or negative.
    """
    ranges = np.array(parse_numbers(words)) * unit
    if (ranges < 0.0).any():
        raise MalformedLineError("has a negative range")
    return mark_no_return(ranges, range_max)


def parse_pose(values: list[float]) -> Pose:
    """A pose of x m, y m, θ rad.

    Raises:
        MalformedLineError: A coordinate is too large.
    """
    if max(abs(value) for value in values) > MAX_COORDINATE:
        raise MalformedLineError(f"has a pose beyond {MAX_COORDINATE:g} m")
    return Pose.from_array(np.array(values))
