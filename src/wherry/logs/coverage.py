"""Odometry at the times of scans: whether both are stamped by the same clock, and which scans odometry covers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from wherry.space.pose import Floats, relative
from wherry.space.trajectory import Trajectory

CLOCK_SPREADS = 3.0  # median absolute deviations of the difference of two clocks that varying delays explain
MIN_DRIFT_READINGS = 10  # scans from which the drift of a clock is estimated
MIN_HOLE = 1.0  # s, longest step between readings of odometry that is always interpolated
HOLE_PERIODS = 10.0  # median steps between readings of odometry above which a longer step is a hole
END_PERIODS = 2.0  # median steps between readings by which odometry is extrapolated
MIN_END, MAX_END = 0.1, 0.5  # s, limits of that time
SAME_DISTANCE, SAME_ANGLE = 0.1, 0.05  # m and rad, median differences of two records of the same odometry
STANDSTILL_DISTANCE, STANDSTILL_ANGLE = 0.01, 0.01  # m and rad, motion over a hole below which the robot stood still


def clock_difference(
    scans: Sequence[tuple[float, float]], odometry: Sequence[tuple[float, float]]
) -> tuple[float, float]:
    """By how much the clock of odometry is ahead of that of the scans, and what varying delays explain of it, s.

    Of a clock that drifts, it is the larger of the differences at the begin and at the end of the recording.

    Args:
        scans: Stamps of the scans, with the times at which the recorder received them, s.
        odometry: Those of odometry.
    """
    if not scans or not odometry:
        return 0.0, 0.0
    stamps, received = np.array(scans).T
    odometry_stamps, odometry_received = np.array(odometry).T
    order = np.argsort(odometry_received, kind="stable")
    delays = (odometry_stamps - odometry_received)[order]
    differences = np.interp(received, odometry_received[order], delays) - (stamps - received)
    during = (received >= odometry_received.min()) & (received <= odometry_received.max())
    if during.any():
        differences = differences[during]
    begin, end = _differences_at_ends(differences)
    drifts = np.linspace(begin, end, len(differences))
    spread = float(np.median(np.abs(differences - drifts)))
    largest = end if abs(end) > abs(begin) else begin
    return largest, CLOCK_SPREADS * spread


def _differences_at_ends(differences: Floats) -> tuple[float, float]:
    """Differences of two clocks at the begin and the end of a recording, s, if one clock drifts evenly.

    The median of each half lies in the middle of the half, a quarter of the recording from its end.
    """
    if len(differences) < MIN_DRIFT_READINGS:
        return float(np.median(differences)), float(np.median(differences))
    half = len(differences) // 2
    early, late = float(np.median(differences[:half])), float(np.median(differences[-half:]))
    return early - (late - early) / 2.0, late + (late - early) / 2.0


def agree(own: Floats, other: Floats) -> bool:
    """Whether poses, [N, 3] m, m, rad, differ by no more than two records of the same odometry do."""
    differences = relative(other, own)
    distance = float(np.median(np.hypot(differences[:, 0], differences[:, 1])))
    return distance <= SAME_DISTANCE and float(np.median(np.abs(differences[:, 2]))) <= SAME_ANGLE


def odometry_period(times: Floats) -> float:
    """Median step between readings of odometry, [N] s increasing."""
    return float(np.median(np.diff(times))) if len(times) > 1 else 0.0


def end_tolerance(times: Floats) -> float:
    """Time by which odometry, [N] s, is extrapolated before its first and after its last reading, s."""
    return float(np.clip(END_PERIODS * odometry_period(times), MIN_END, MAX_END))


def covered(odometry: Trajectory, times: Floats) -> NDArray[np.bool_]:
    """Whether odometry covers times, [M]: not in a hole, in which the robot moved, nor before or after all readings."""
    if len(odometry.times) < 2:
        return np.zeros(len(times), np.bool_)
    tolerance = end_tolerance(odometry.times)
    inside = (times >= odometry.times[0] - tolerance) & (times <= odometry.times[-1] + tolerance)
    after = np.clip(np.searchsorted(odometry.times, times), 1, len(odometry.times) - 1)
    start, end = odometry.times[after - 1], odometry.times[after]
    is_near = (times - start <= tolerance) | (end - times <= tolerance)
    covers: NDArray[np.bool_] = inside & (is_near | ~_holes(odometry)[after - 1])
    return covers


def hole_lengths(odometry: Trajectory) -> Floats:
    """Lengths of the holes of odometry, s."""
    lengths: Floats = np.diff(odometry.times)[_holes(odometry)]
    return lengths


def _holes(odometry: Trajectory) -> NDArray[np.bool_]:
    """Whether there is a hole after each reading of odometry but the last, [N - 1]."""
    steps = np.diff(odometry.times)
    motions = relative(odometry.poses[1:], odometry.poses[:-1])
    moved = (np.hypot(motions[:, 0], motions[:, 1]) > STANDSTILL_DISTANCE) | (np.abs(motions[:, 2]) > STANDSTILL_ANGLE)
    limit = max(MIN_HOLE, HOLE_PERIODS * odometry_period(odometry.times))
    holes: NDArray[np.bool_] = (steps > limit) & moved
    return holes
