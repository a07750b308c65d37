"""The clocks that stamped scans and odometry."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wherry.logs.coverage import agree, clock_difference, covered
from wherry.logs.recorded import RecordedOdometry, RecordedScan, received_times, trajectory_of
from wherry.logs.timestamps import ASSUMED_SCAN_PERIOD, has_constant_stamps, increasing_times
from wherry.space.pose import Floats

MIN_DISTINCT_SHARE = 0.5  # share of distinct stamps of odometry below which its poses are not compared with others
READINGS_PER_STAMP = 3.0  # mean number of scans or readings with the same stamp from which stamps are coarse
MIN_CLOCK_READINGS = 3  # scans, and readings of odometry, from which two clocks are compared
CLOCK_TOLERANCE = 0.5  # s, difference of two clocks that constant delays of messages may explain
MAX_USUAL_DELAY = 0.15  # s, difference of two clocks that the delays of most drivers explain


def with_usable_stamps(
    scans: list[RecordedScan], odometry: Sequence[RecordedOdometry]
) -> tuple[list[RecordedScan], Sequence[RecordedOdometry], str]:
    """Scans and odometry with other stamps if theirs do not tell the time, and a note that says so."""
    stamps = np.array([recorded.scan.time for recorded in scans])
    if not has_constant_stamps(stamps):
        readings, note = _with_usable_odometry_stamps(scans, odometry)
        return scans, readings, note
    reason = f"the scans are stamped with a constant time, {float(np.median(stamps)):.6f} s"
    received = _distinct_received(scans)
    if received is not None:
        timed = [recorded.at(float(time)) for recorded, time in zip(scans, received, strict=True)]
        readings = [reading.at(reading.received) for reading in odometry if reading.received is not None]
        return timed, readings, f"{reason}: the times at which the recorder received them are used"
    times = np.median(stamps) + ASSUMED_SCAN_PERIOD * np.arange(len(scans))
    timed = [recorded.at(float(time)) for recorded, time in zip(scans, times, strict=True)]
    alone = ", and odometry between them is not used" if odometry else ""
    return timed, (), f"{reason}: one scan every {ASSUMED_SCAN_PERIOD:.0f} s is assumed{alone}"


def _with_usable_odometry_stamps(
    scans: Sequence[RecordedScan], odometry: Sequence[RecordedOdometry]
) -> tuple[Sequence[RecordedOdometry], str]:
    """Odometry with other stamps if its own do not tell the time, and a note that says so."""
    stamps = np.array([reading.time for reading in odometry])
    if not has_constant_stamps(stamps):
        return odometry, ""
    reason = f"odometry is stamped with a constant time, {float(np.median(stamps)):.6f} s"
    received, received_scans = _distinct_received(odometry), _distinct_received(scans)
    if received is None or received_scans is None:
        return (), f"{reason}: {_alternative(scans)}"
    delay = float(np.median(np.array([recorded.scan.time for recorded in scans]) - received_scans))
    timed = [reading.at(float(time)) for reading, time in zip(odometry, received + delay, strict=True)]
    return timed, f"{reason}: the times at which the recorder received it are used"


def with_spread_stamps(
    scans: list[RecordedScan], odometry: list[RecordedOdometry]
) -> tuple[list[RecordedScan], list[RecordedOdometry], str]:
    """Scans and odometry with coarse stamps spread evenly up to the next stamp, and a note that says so.

    Poses recorded with the scans do not depend on stamps, which then stay as they are.

    Args:
        scans: Scans in the order of time.
        odometry: Odometry in the order of time.
    """
    if any(recorded.pose is not None for recorded in scans) or not odometry:
        return scans, odometry, ""
    distinct = [
        reading
        for index, reading in enumerate(odometry)
        if index == 0 or (reading.time, reading.pose) != (odometry[index - 1].time, odometry[index - 1].pose)
    ]
    stamps = np.array([recorded.scan.time for recorded in scans])
    odometry_stamps = np.array([reading.time for reading in distinct])
    coarse = [
        name
        for name, times in (("the scans", stamps), ("odometry", odometry_stamps))
        if len(times) >= READINGS_PER_STAMP * len(np.unique(times))
    ]
    if "the scans" in coarse:
        scans = [entry.at(time) for entry, time in zip(scans, increasing_times(stamps).tolist(), strict=True)]
    if "odometry" in coarse:
        times = increasing_times(odometry_stamps).tolist()
        odometry = [entry.at(time) for entry, time in zip(distinct, times, strict=True)]
    note = f"the stamps of {' and of '.join(coarse)} are coarse: they are spread evenly up to the next stamp"
    return scans, odometry, note if coarse else ""


def _distinct_received(recorded: Sequence[RecordedScan] | Sequence[RecordedOdometry]) -> Floats | None:
    """Times at which the recorder received messages, [N] s; None if they are unknown or constant."""
    times = received_times(recorded)
    return None if times is None or has_constant_stamps(times) else times


def _alternative(scans: Sequence[RecordedScan]) -> str:
    """What is used in place of odometry."""
    return "the poses recorded with the scans are used alone" if scans[0].pose else "the scans have no odometry"


def of_same_clock(
    scans: Sequence[RecordedScan], odometry: list[RecordedOdometry]
) -> tuple[list[RecordedOdometry], str]:
    """The odometry if it is stamped by the scans' clock, otherwise none; and a note if that is not so or in doubt."""
    if not odometry:
        return odometry, ""
    difference, explained = clock_difference(
        [(recorded.scan.time, recorded.received) for recorded in scans if recorded.received is not None],
        [(reading.time, reading.received) for reading in odometry if reading.received is not None],
    )
    first, last = scans[0].scan.time, scans[-1].scan.time
    poses = _alternative(scans)
    are_compared = min(len(scans), len(odometry)) >= MIN_CLOCK_READINGS
    apart = f"{abs(difference):,.3f} s {'ahead of' if difference > 0.0 else 'behind'} that of the scans"
    unexplained = abs(difference) - explained if are_compared else 0.0
    if unexplained > CLOCK_TOLERANCE:
        return [], f"odometry is stamped by another clock, {apart}: {poses}"
    if odometry[-1].time < first or odometry[0].time > last:
        times = f"{odometry[0].time:.3f} to {odometry[-1].time:.3f} s, scans from {first:.3f} to {last:.3f} s"
        return [], f"odometry is of another clock or of another drive than the scans, from {times}: {poses}"
    if _contradicts(scans, odometry):
        return [], f"odometry contradicts the poses recorded with the scans, which may be corrected: {poses}"
    if unexplained > MAX_USUAL_DELAY:
        return odometry, f"odometry may be stamped by another clock, {apart}, or one of them is sent late: it is used"
    return odometry, ""


def _contradicts(scans: Sequence[RecordedScan], odometry: Sequence[RecordedOdometry]) -> bool:
    """Whether poses recorded with the scans are others than those of odometry at the same times."""
    trajectory = trajectory_of([(reading.time, reading.pose) for reading in odometry])
    own = [(recorded.scan.time, recorded.pose.as_array()) for recorded in scans if recorded.pose is not None]
    times = np.array([time for time, _ in own])
    covers = covered(trajectory, times)
    is_coarse = len(trajectory.times) < MIN_DISTINCT_SHARE * len(odometry)
    if is_coarse or covers.sum() < MIN_CLOCK_READINGS:
        return False
    poses = np.array([pose for _, pose in own])
    return not agree(poses[covers], trajectory.along_arcs(times[covers]))
