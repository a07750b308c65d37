"""Checked values in the words of text files."""

from __future__ import annotations

import math
import re

import numpy as np

from wherry.logs.lidar_log import MAX_BEAMS, MAX_RANGE
from wherry.robot import mark_no_return
from wherry.space.pose import MAX_COORDINATE, Floats, Pose

MAX_NUMBER = 1e18  # largest absolute value of a number in a log
MAX_STAMP = 1e20  # largest absolute value of a stamp; Unix times in nanoseconds are above 1e18
MAX_WORD_LENGTH = 40  # characters of a word shown in a message
DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+")
RANGE_MIN = 0.02  # m, shortest valid range of a lidar whose log does not give one


class MalformedLineError(Exception):
    """A line that cannot be used; the message is the reason."""


def parse_stamp(word: str) -> float:
    """A stamp, in any unit.

    Raises:
        MalformedLineError: It is no finite number, or too large.
    """
    return parse_numbers([word], MAX_STAMP)[0]


def parse_numbers(words: list[str], largest: float = MAX_NUMBER) -> list[float]:
    """The words as finite numbers.

    Args:
        words: Numbers as text.
        largest: Largest possible absolute value.

    Raises:
        MalformedLineError: A word is no finite number, or too large.
    """
    values = _floats(words)
    if not all(math.isfinite(value) for value in values):
        raise MalformedLineError("has a number that is not finite")
    if any(abs(value) > largest for value in values):
        raise MalformedLineError(f"has a number beyond {largest:g}")
    return values


def _floats(words: list[str]) -> list[float]:
    """The words as numbers, which may be infinite or NaN.

    Raises:
        MalformedLineError: A word is no number.
    """
    try:
        values = [float(word) for word in words]
    except ValueError as error:
        word = next(word for word in words if not _is_number(word))
        if DECIMAL_COMMA.fullmatch(word):
            reason = f"has a decimal comma in {word}: numbers need decimal points, and separators other than commas"
            raise MalformedLineError(reason) from error
        raise MalformedLineError(f"has a word that is not a number: {word[:MAX_WORD_LENGTH]!r}") from error
    if "_" in "".join(words):
        raise MalformedLineError("has an underscore in a number")
    return values


def _is_number(word: str) -> bool:
    """Whether a word is a number."""
    try:
        float(word)
    except ValueError:
        return False
    return True


def parse_count(words: list[str], index: int, minimum: int = 1) -> int:
    """The number of beams at a word.

    Raises:
        MalformedLineError: The word is missing, no whole number, or impossible.
    """
    try:
        count = int(words[index].replace("_", "?"))
    except (ValueError, IndexError) as error:
        raise MalformedLineError("does not say how many beams it has") from error
    if not minimum <= count <= MAX_BEAMS:
        raise MalformedLineError(f"has {count} beams; {minimum} to {MAX_BEAMS:,} are possible")
    return count


def check_range_max(range_max: float) -> None:
    """Check the longest range that a log states for its lidar, m.

    Raises:
        MalformedLineError: No lidar has it.
    """
    if not RANGE_MIN < range_max <= MAX_RANGE:
        raise MalformedLineError(
            f"the longest range is {range_max:g}, not above {RANGE_MIN:g} and up to {MAX_RANGE:g} m"
        )


def parse_ranges(words: list[str], range_max: float, unit: float = 1.0) -> Floats:
    """Ranges, [R] m; infinite where the beam had no return, see `mark_no_return`, and NaN where it had no reading.

    As in ROS (REP 117), ``inf`` is no return and ``-inf`` an obstacle that is nearer than the shortest valid range.

    Args:
        words: Ranges as text.
        range_max: Longest valid range, m.
        unit: Unit of the words, m.

    Raises:
        MalformedLineError: A word is no number.
    """
    ranges = np.array(_floats(words)) * unit
    ranges[np.isneginf(ranges)] = RANGE_MIN
    ranges[ranges < 0.0] = np.nan
    return mark_no_return(ranges, range_max)


def parse_pose(values: list[float]) -> Pose:
    """A pose of x m, y m, θ rad.

    Raises:
        MalformedLineError: A coordinate is too large.
    """
    if max(abs(value) for value in values) > MAX_COORDINATE:
        raise MalformedLineError(f"has a pose beyond {MAX_COORDINATE:g} m")
    return Pose.from_array(np.array(values))
