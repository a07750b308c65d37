"""Units of time stamps, and repair of those that are coarse or constant."""

from __future__ import annotations

import math

import numpy as np

from wherry.space.pose import Floats

MAX_TIME = 1e12  # s, largest absolute value of a stamp
UNITS = ((1e-9, "nanoseconds", 5e6), (1e-6, "microseconds", 1e4), (1e-3, "milliseconds", math.inf))
"""Units below a second: s, name, and median step of whole numbers above which stamps count them from any start."""
MIN_UNIX_TIME, MAX_UNIX_TIME = 3e8, 4.2e9  # s, of the years 1979 to 2103
MAX_UNIX_STEP = 600.0  # s, longest median step of stamps that are Unix times in a unit

MIN_SCAN_PERIOD = 0.005  # s, mean scan period below which a log has no usable clock; no lidar is that fast
MIN_STAMPS = 3  # stamps from which a clock is judged
CONSTANT_SHARE = 0.99  # share of equal stamps from which a clock is constant
ASSUMED_SCAN_PERIOD = 1.0  # s, scan period of a log without a usable clock


def unit_of(times: Floats) -> tuple[float, str]:
    """The unit of stamps, [N], by their size and, of whole numbers, by their steps: s, and its name."""
    if not len(times):
        return 1.0, "seconds"
    size = _lower_median(np.abs(times))
    step = _lower_median(np.abs(np.diff(times))) if len(times) > 1 else 0.0
    for unit, name, _ in UNITS:
        if MIN_UNIX_TIME <= size * unit <= MAX_UNIX_TIME and step * unit <= MAX_UNIX_STEP:
            return unit, name
    if (times == np.round(times)).all():
        for unit, name, smallest in UNITS:
            if step >= smallest:
                return unit, name
    return 1.0, "seconds"


def _lower_median(values: Floats) -> float:
    """The lower one of the two middle values, which one outlier among few cannot move."""
    return float(np.sort(values)[(len(values) - 1) // 2])


def has_constant_stamps(times: Floats) -> bool:
    """Whether stamps, [N] s in the order of the recording, do not tell the time, since nearly all are equal."""
    if len(times) < MIN_STAMPS:
        return False
    _, counts = np.unique(times, return_counts=True)
    return bool(counts.max() >= CONSTANT_SHARE * len(times))


def increasing_times(times: Floats) -> Floats:
    """Times that increase from scan to scan, which a motion model needs to distinguish driving from a jump.

    Scans with equal stamps are spread evenly up to the next stamp; a log without a usable clock gets a constant period.

    Args:
        times: Times as logged, [N] s. They are returned unchanged if all increase, or if some decrease.

    Returns:
        Increasing times, [N] s.
    """
    steps = np.diff(times)
    if (steps > 0.0).all() or (steps < 0.0).any():
        return times
    count = len(times)
    if times[-1] - times[0] < MIN_SCAN_PERIOD * count:
        counted: Floats = times[0] + ASSUMED_SCAN_PERIOD * np.arange(count)
        return counted
    first = np.concatenate([[0], 1 + np.flatnonzero(steps > 0.0)])  # first scan of each stamp
    period = (times[-1] - times[0]) / first[-1]
    ends = np.append(times[first], times[-1] + period * (count - first[-1]))
    increasing: Floats = np.interp(np.arange(count), np.append(first, count), ends)
    return increasing
