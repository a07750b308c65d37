"""Outliers of a recording, judged by the majority of all its scans or readings of odometry."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Mapping, Sequence

import numpy as np

from wherry.logs.lidar_log import MAX_JUMP
from wherry.space.pose import Floats, Pose

BEAM_COUNT_TOLERANCE = 0.2  # share of a number of beams by which similar scans have more or fewer
MIN_SIMILAR_SCANS, MIN_SIMILAR_SHARE = 2, 0.1  # scans, and share of all, that make another number of beams usual
MIN_SEPARATION = 600.0  # s of silence beside which a few stamps at the beginning or at the end are no part of the drive
SEPARATION_STEPS = 100.0  # median steps between stamps that such a silence lasts at least
MAX_SEPARATED_SHARE = 0.01  # share of the stamps, at least one, that may be separated in this way
CLOCK_SETTING = 86400.0  # s of silence from which the clock was set meanwhile, as by NTP after a start
MAX_UNSET_SHARE = 0.25  # share of the stamps that may be of a clock that was not set
MAX_UNRECEIVED_SILENCE = 10.0  # s between stamps that did not pass for the recorder: a clock was set meanwhile
MAX_OUTLIER_RUN = 3  # consecutive poses that count as outliers if odometry returns afterwards

Outliers = Mapping[int, str]
"""Indices of the outliers, in increasing order, with the reasons as predicates."""


def stamp_outliers(times: Floats, received: Floats | None = None) -> Outliers:
    """The stamps that contradict the order of the recording, or that are far away from all others.

    As many stamps as possible are kept: a longest non-decreasing subsequence.

    Args:
        times: Stamps in the order of the recording, [N] s.
        received: Times at which the recorder received the messages, [N] s, recorder's clock; None if unknown.
    """
    kept = _longest_non_decreasing(times)
    kept = kept[_not_separated(times[kept], None if received is None else received[kept])]
    outliers = np.setdiff1d(np.arange(len(times)), kept)
    return {int(index): _stamp_reason(times, kept, int(index)) for index in outliers}


def _longest_non_decreasing(times: Floats) -> list[int]:
    """Indices of a longest non-decreasing subsequence; of several, one that prefers earlier elements."""
    tails: list[float] = []  # of the subsequences of each length, from the end: negated times never decrease
    ends: list[int] = []
    before = np.full(len(times), -1)
    for index in range(len(times) - 1, -1, -1):
        position = bisect_right(tails, -times[index])
        before[index] = ends[position - 1] if position else -1
        if position == len(tails):
            tails.append(-times[index])
            ends.append(index)
        else:
            tails[position], ends[position] = -times[index], index
    kept: list[int] = []
    index = ends[-1] if ends else -1
    while index >= 0:
        kept.append(index)
        index = int(before[index])
    return kept


def _not_separated(times: Floats, received: Floats | None) -> slice:
    """The part of non-decreasing stamps, [N] s, without a few at either end that a long silence separates.

    A silence that did not pass for the recorder is none: a clock was set, and the fewer stamps are of the other time.
    """
    count = len(times)
    steps = np.diff(times)
    if len(steps) < 2:
        return slice(0, count)
    long = max(MIN_SEPARATION, SEPARATION_STEPS * float(np.sort(steps)[(len(steps) - 1) // 2]))
    passed = steps if received is None else np.diff(received)
    is_no_silence = (passed >= 0.0) & (steps - passed > MAX_UNRECEIVED_SILENCE)
    first, last = 0, count
    for index in np.flatnonzero((steps > long) | is_no_silence).tolist():
        was_set = is_no_silence[index] or steps[index] > CLOCK_SETTING
        share = MAX_UNSET_SHARE if was_set else MAX_SEPARATED_SHARE
        few = max(1, int(share * count))
        before, after = index + 1, count - index - 1
        rest_before, rest_after = times[index] - times[first], times[count - 1 - few] - times[index + 1]
        if before <= few and before < after and (is_no_silence[index] or steps[index] > rest_after):
            first = before
        elif after <= few and after < before and (is_no_silence[index] or steps[index] > rest_before):
            last = min(last, before)
    return slice(first, last)


def _stamp_reason(times: Floats, kept: Sequence[int], index: int) -> str:
    """Why a stamp is an outlier among the kept ones."""
    position = int(np.searchsorted(kept, index))
    before = times[kept[position - 1]] if position else -math.inf
    after = times[kept[position]] if position < len(kept) else math.inf
    if times[index] < before:
        return f"time runs backwards, from {before:.6f} to {times[index]:.6f}"
    if times[index] > after:
        return f"is stamped {times[index]:.6f}, {times[index] - after:,.3f} s after the next one"
    if math.isfinite(after):
        return f"is stamped {times[index]:.6f}, {after - times[index]:,.0f} s before all others"
    return f"is stamped {times[index]:.6f}, {times[index] - before:,.0f} s after all others"


def beam_count_outliers(counts: Sequence[int]) -> Outliers:
    """Scans whose number of beams is neither near the median nor near that of other scans.

    A few beams more or less occur with many lidars, and a lidar may change its resolution.
    """
    ordered = np.sort(counts)
    median = int(ordered[(len(ordered) - 1) // 2]) if len(ordered) else 0
    lower, upper = (1.0 - BEAM_COUNT_TOLERANCE) * median, (1.0 + BEAM_COUNT_TOLERANCE) * median
    needed = max(MIN_SIMILAR_SCANS, MIN_SIMILAR_SHARE * len(ordered))
    return {
        index: f"has {count} beams where the log's scans have {median}"
        for index, count in enumerate(counts)
        if not lower < count < upper and _similar(ordered, count) < needed
    }


def _similar(ordered: Floats, count: int) -> int:
    """How many of the numbers of beams, in increasing order, are near one."""
    first = np.searchsorted(ordered, (1.0 - BEAM_COUNT_TOLERANCE) * count, side="right")
    last = np.searchsorted(ordered, (1.0 + BEAM_COUNT_TOLERANCE) * count, side="left")
    return int(last - first)


def jumps(poses: Sequence[Pose]) -> tuple[Outliers, tuple[int, ...]]:
    """Jumps of odometry that are farther than a robot moves between two readings.

    Args:
        poses: Poses in the order of time.

    Returns:
        Poses away from which odometry returns, and the indices at which odometry jumps and stays, as after a reset.
    """
    outliers: dict[int, str] = {}
    changes: list[int] = []
    last, index = 0, 1
    while index < len(poses):
        distance = poses[last].distance_to(poses[index])
        if distance <= MAX_JUMP:
            last, index = index, index + 1
            continue
        back = _return_index(poses, last, index)
        if back is not None:
            outliers |= {outlier: _jump_reason(poses[last], poses[outlier]) for outlier in range(index, back)}
            last, index = back, back + 1
        elif index + 1 < len(poses) and poses[index].distance_to(poses[index + 1]) <= MAX_JUMP:
            if last == 0:
                outliers[0] = f"odometry jumps by {distance:,.0f} m from it to the next one"
            else:
                changes.append(index)
            last, index = index, index + 1
        else:
            outliers[index] = _jump_reason(poses[last], poses[index])
            index += 1
    return dict(sorted(outliers.items())), tuple(changes)


def _return_index(poses: Sequence[Pose], last: int, index: int) -> int | None:
    """Index of the pose at which odometry is back after a jump at ``index``; None if it does not return soon."""
    for later in range(index + 1, min(index + 1 + MAX_OUTLIER_RUN, len(poses))):
        if poses[last].distance_to(poses[later]) <= MAX_JUMP:
            return later
    return None


def _jump_reason(before: Pose, pose: Pose) -> str:
    """Why a pose is an outlier."""
    return f"odometry jumps by {before.distance_to(pose):,.0f} m since the one before"
