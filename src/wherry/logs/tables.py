"""Text tables of numbers, plain or gzipped, such as trajectories and relations."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from wherry.errors import InputError
from wherry.logs.log_lines import MalformedLineError, parse_numbers, parse_stamp
from wherry.logs.text_files import is_comment, numbered_lines
from wherry.logs.timestamps import MAX_TIME, unit_of
from wherry.space.pose import MAX_COORDINATE, Floats
from wherry.space.trajectory import Trajectory

POSE_WIDTH, TUM_WIDTH, KITTI_WIDTH = 4, 8, 12  # numbers in a line
FORMATS = "t x y θ or TUM's t x y z qx qy qz qw"
MAX_ROWS = 2_000_000  # eleven hours at 50 Hz
NORM_TOLERANCE = 0.1  # deviation of a quaternion's norm from 1 that is corrected
MAX_TILT = 0.35  # rad, between the z axes of base_link and of the map
HEADER_WORD = re.compile(r"[^\W\d_]\w*")
UNIT = re.compile(r"\s*(\[[^\]]*\]|\([^)]*\))")
COLUMN_NAMES = (
    ("t", "t time timestamp stamp sec secs seconds"),
    ("x", "x px tx p_x pos_x position_x"),
    ("y", "y py ty p_y pos_y position_y"),
    ("z", "z pz tz p_z pos_z position_z"),
    ("theta", "theta yaw heading th phi"),
    *((name, f"{name} q_{name[1]}") for name in ("qx", "qy", "qz", "qw")),
)
COLUMNS: Mapping[str, str] = MappingProxyType(
    {name: column for column, names in COLUMN_NAMES for name in names.split()}
)
"""Columns of trajectories by their names in headers."""
ORDERS = {POSE_WIDTH: ("t", "x", "y", "theta"), TUM_WIDTH: ("t", "x", "y", "z", "qx", "qy", "qz", "qw")}


@dataclass(frozen=True)
class _Table:
    """A table of numbers.

    Attributes:
        rows: The numbers, [rows, width].
        lines: Numbers of the lines of the rows.
        header: Names of the columns in lower case; empty if the table has none.
    """

    rows: Floats
    lines: list[int]
    header: tuple[str, ...]


def read_odometry(path: str | Path) -> Trajectory:
    """Read a trajectory, as `read_trajectory`, without the notes."""
    trajectory, _ = read_trajectory(path)
    return trajectory


def read_trajectory(path: str | Path) -> tuple[Trajectory, tuple[str, ...]]:
    """Read a trajectory, one pose per line: ``t x y θ``, or TUM's ``t x y z qx qy qz qw``.

    Numbers are separated by white space, commas or semicolons; a header that names the columns may give another order.

    Returns:
        The trajectory, and notes on what was decided in reading it.

    Raises:
        InputError: The file cannot be read, a line is malformed, times decrease, there are fewer than two poses, or a
            pose is not in the plane.
    """
    table = _ordered(path, _read_table(path, (POSE_WIDTH, TUM_WIDTH)))
    rows = table.rows
    if len(rows) < 2:
        raise InputError(path, "", "has one pose only; a trajectory needs two at least")
    headings = rows[:, 3] if rows.shape[1] == POSE_WIDTH else _headings(path, table)
    times, notes = in_seconds(rows[:, 0], path)
    distant = np.flatnonzero(np.abs(times) > MAX_TIME)
    if len(distant):
        raise InputError(path, f"line {table.lines[int(distant[0])]}", f"has a time beyond {MAX_TIME:g} s")
    backwards = np.flatnonzero(np.diff(times) < 0.0)
    if len(backwards):
        line = table.lines[int(backwards[0]) + 1]
        raise InputError(path, f"line {line}", "time runs backwards")
    poses = np.column_stack([rows[:, 1:3], headings])
    distant = np.flatnonzero(np.abs(poses).max(axis=1) > MAX_COORDINATE)
    if len(distant):
        raise InputError(path, f"line {table.lines[int(distant[0])]}", f"has a pose beyond {MAX_COORDINATE:g} m")
    return Trajectory(times, poses), notes


def in_seconds(times: Floats, path: str | Path) -> tuple[Floats, tuple[str, ...]]:
    """Times of a file, of any shape, in seconds, and a note if they were in another unit."""
    unit, name = unit_of(np.unique(times))
    if unit == 1.0:
        return times, ()
    return times * unit, (f"the times of {path} are in {name}: they are converted to seconds",)


def _ordered(path: str | Path, table: _Table) -> _Table:
    """A table of a trajectory with its columns in the usual order."""
    if not table.header:
        return table
    columns = [COLUMNS.get(name, "") for name in table.header]
    order = ORDERS[len(columns)]
    if sorted(columns) != sorted(order):
        names = " ".join(table.header)
        raise InputError(path, f"line {table.lines[0]}", f"has the columns {names}; {FORMATS} are needed")
    return _Table(table.rows[:, [columns.index(column) for column in order]], table.lines[1:], table.header)


def _headings(path: str | Path, table: _Table) -> Floats:
    """Headings of TUM's quaternions, rad.

    Raises:
        InputError: A quaternion is no rotation, or one out of the plane.
    """
    x, y, z, w = table.rows[:, 4:].T
    norms = np.sqrt(x * x + y * y + z * z + w * w)
    wrong = np.flatnonzero(np.abs(norms - 1.0) > NORM_TOLERANCE)
    if len(wrong):
        reason = f"has a quaternion of norm {norms[wrong[0]]:.3g}, not 1; the format is {FORMATS}"
        raise InputError(path, f"line {table.lines[int(wrong[0])]}", reason)
    x, y, z, w = x / norms, y / norms, z / norms, w / norms
    tilts = np.arccos(np.clip(1.0 - 2.0 * (x * x + y * y), -1.0, 1.0))
    tilted = np.flatnonzero(tilts > MAX_TILT)
    if len(tilted):
        tilt = np.degrees(tilts[tilted[0]])
        reason = f"has a pose tilted by {tilt:.0f}°, not in the plane; the order of quaternions is qx qy qz qw"
        raise InputError(path, f"line {table.lines[int(tilted[0])]}", reason)
    in_plane = (x == 0.0) & (y == 0.0)
    general = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    headings: Floats = np.where(in_plane, 2.0 * np.arctan2(z, w), general)
    return headings


def read_rows(path: str | Path, *, widths: tuple[int, ...], stamps: int = 1) -> Floats:
    """Read a table of finite numbers, one row per line, separated by white space, commas or semicolons.

    Args:
        path: The file, plain or gzipped.
        widths: Allowed counts of numbers in a line; all lines must have the same count.
        stamps: Number of stamps at the beginning of a line, which may be larger than other numbers.

    Returns:
        The numbers, [rows, width].

    Raises:
        InputError: The file cannot be read, is empty, or a line is malformed.
    """
    return _read_table(path, widths, stamps).rows


def _read_table(path: str | Path, widths: tuple[int, ...], stamps: int = 1) -> _Table:
    """Read a table, as `read_rows`, with the numbers of its lines and the header."""
    rows: list[list[float]] = []
    lines: list[int] = []
    header: tuple[str, ...] = ()
    for number, line in numbered_lines(Path(path)):
        if is_comment(line):
            continue
        if not lines and (header := _header(line, widths)):
            lines.append(number)
            continue
        words = _words(line)
        try:
            numbers = [*map(parse_stamp, words[:stamps]), *parse_numbers(words[stamps:])]
        except MalformedLineError as error:
            raise InputError(path, f"line {number}", str(error)) from error
        _check_width(path, number, len(numbers), (len(rows[0]),) if rows else widths)
        rows.append(numbers)
        lines.append(number)
        if len(rows) > MAX_ROWS:
            raise InputError(path, f"line {number}", f"is beyond the {MAX_ROWS:,} rows that fit into memory")
    if not rows:
        raise InputError(path, "", "has no numbers in it")
    return _Table(np.array(rows), lines, header)


def _header(line: str, widths: tuple[int, ...]) -> tuple[str, ...]:
    """The names of the columns in a line, without units, in lower case; empty if it is not a header."""
    words = _words(UNIT.sub("", line))
    is_header = len(words) in widths and all(HEADER_WORD.fullmatch(word) for word in words)
    return tuple(word.lower() for word in words) if is_header else ()


def _words(line: str) -> list[str]:
    """The words of a line, separated by semicolons, by commas, or by white space."""
    if ";" in line:
        return [word.strip() for word in line.strip().rstrip(";").split(";")]
    separated = line.split()
    if "," in line and (len(separated) == 1 or all(word.endswith(",") for word in separated[:-1])):
        return [word.strip() for word in line.strip().rstrip(",").split(",")]
    return separated


def _check_width(path: str | Path, number: int, width: int, allowed: tuple[int, ...]) -> None:
    """Refuse a line with another count of numbers than allowed."""
    if width in allowed:
        return
    wanted = " or ".join(str(count) for count in allowed)
    kitti = f", as in the KITTI format, which has no times; {FORMATS} are needed" if width == KITTI_WIDTH else ""
    raise InputError(path, f"line {number}", f"has {width} numbers, not {wanted}{kitti}")
