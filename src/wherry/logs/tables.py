"""Text tables of numbers, plain or gzipped, such as trajectories and relations."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from wherry.errors import InputError
from wherry.logs.log_lines import MalformedLineError, numbered_lines, parse_numbers
from wherry.space.pose import Floats
from wherry.space.trajectory import Trajectory

TUM_WIDTH = 8  # numbers in a line of the TUM format


def read_odometry(path: str | Path) -> Trajectory:
    """Read a trajectory, one pose per line: ``t x y θ``, or TUM's ``t x y z qx qy qz qw``.

    Raises:
        InputError: The file cannot be read, a line is malformed, or times decrease.
    """
    rows = read_rows(path, widths=(4, TUM_WIDTH))
    if rows.shape[1] == TUM_WIDTH:
        rows = np.column_stack([rows[:, :3], 2.0 * np.arctan2(rows[:, 6], rows[:, 7])])
    backwards = np.flatnonzero(np.diff(rows[:, 0]) < 0.0)
    if len(backwards):
        raise InputError(path, f"pose {backwards[0] + 2}", "time runs backwards")
    return Trajectory(rows[:, 0], rows[:, 1:])


def read_rows(path: str | Path, *, widths: tuple[int, ...]) -> Floats:
    """Read a table of finite numbers, one row per line; ``#`` begins a comment.

    Args:
        path: The file; gzipped if its name ends in .gz.
        widths: Allowed counts of numbers in a line; all lines must have the same count.

    Returns:
        The numbers, [rows, width].

    Raises:
        InputError: The file cannot be read, is empty, or a line is malformed.
    """
    rows: list[list[float]] = []
    for number, line in numbered_lines(Path(path)):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        allowed = (len(rows[0]),) if rows else widths
        if len(words) not in allowed:
            wanted = " or ".join(str(width) for width in allowed)
            raise InputError(path, f"line {number}", f"has {len(words)} numbers, not {wanted}")
        try:
            rows.append(parse_numbers(words))
        except MalformedLineError as error:
            raise InputError(path, f"line {number}", str(error)) from error
    if not rows:
        raise InputError(path, "", "has no numbers in it")
    return np.array(rows)
