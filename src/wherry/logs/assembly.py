"""Assembly of a log from recorded scans and odometry, by the same rules for text logs and bags."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from wherry.errors import InputError
from wherry.logs.beam_times import with_usable_beam_times
from wherry.logs.coverage import agree, clock_difference, covered, hole_lengths
from wherry.logs.lidar_log import MAX_JUMP, LidarLog
from wherry.logs.max_range_readings import mark_beams_without_return
from wherry.logs.options import ReadingOptions
from wherry.logs.outliers import Outliers, beam_count_outliers, jumps, stamp_outliers
from wherry.logs.rejections import Rejections, are_too_many, joined
from wherry.logs.timestamps import ASSUMED_SCAN_PERIOD, has_constant_stamps
from wherry.robot import Odometry, Scan, Velocity
from wherry.space.pose import Floats, Pose
from wherry.space.trajectory import Trajectory

MAX_FRAME_CHANGES = 10  # lasting jumps of odometry above which it is refused
MIN_DISTINCT_SHARE = 0.5  # share of distinct stamps of odometry below which its poses are not compared with others
MIN_CLOCK_READINGS = 3  # scans, and readings of odometry, from which two clocks are compared


@dataclass(frozen=True, slots=True)
class RecordedScan:
    """A scan as it stands in a recording.

    Attributes:
        name: Where it stands, for messages, such as ``line 12`` or ``/scan, message 3``.
        scan: The scan.
        pose: base_link in the odom frame at the scan, if it was recorded with the scan; otherwise None.
        received: Time at which the recorder received it, s, recorder's clock; None if it was not recorded.
    """

    name: str
    scan: Scan
    pose: Pose | None = None
    received: float | None = None

    def at(self, time: float) -> RecordedScan:
        """The same with another stamp, s."""
        return replace(self, scan=replace(self.scan, time=time))


@dataclass(frozen=True, slots=True)
class RecordedOdometry:
    """A reading of odometry as it stands in a recording.

    Attributes:
        name: Where it stands, for messages.
        time: Time of the reading, s, robot's clock.
        pose: base_link in the odom frame.
        received: Time at which the recorder received it, s, recorder's clock; None if it was not recorded.
    """

    name: str
    time: float
    pose: Pose
    received: float | None = None

    def at(self, time: float) -> RecordedOdometry:
        """The same with another stamp, s."""
        return replace(self, time=time)


Recorded = TypeVar("Recorded", RecordedScan, RecordedOdometry)


def assemble_log(
    source: str,
    scans: Sequence[RecordedScan],
    odometry: Sequence[RecordedOdometry],
    lidar: Pose,
    options: ReadingOptions,
    *,
    skipped: Sequence[str] = (),
    notes: Sequence[str] = (),
    skipped_scans: int = 0,
) -> LidarLog:
    """Assemble a log: judge scans and odometry by the majority, relate them in time, and find beams without a return.

    Args:
        source: Name of the file.
        scans: The scans in the order of the recording.
        odometry: The odometry in the order of the recording, without that of the scans.
        lidar: Pose of the lidar in the base_link frame.
        options: How to read.
        skipped: Lines or messages that were left out already.
        notes: Notes on what was decided already.
        skipped_scans: Number of scans among ``skipped``.

    Raises:
        InputError: There are no scans; a scan or a reading of odometry is an outlier (unless lenient), or too many are.
    """
    rejections = Rejections(source, options.lenient, list(skipped))
    if not scans:
        left_out = f" ({len(skipped):,} left out, the first: {skipped[0]})" if skipped else ""
        raise InputError(source, "", "has no scans in it" + left_out)
    total = len(scans) + len(odometry) + len(skipped)
    timed, odometry, clock_note = _with_usable_stamps(_without_repetitions(scans), odometry)
    kept, scan_jumps_note = _kept_scans(timed, rejections)
    rejections.check_share(len(timed) - len(kept) + skipped_scans, len(timed) + skipped_scans, "scans")
    readings, odometry_jumps_note = _kept_odometry(kept, odometry, rejections)
    rejections.check_share(len(rejections.entries), total, "lines or messages")
    readings, difference_note = _same_clock(kept, readings)
    at_scans, trajectory, coverage_note = _odometry_at_scans(kept, readings)
    marked, marking_note = mark_beams_without_return([recorded.scan for recorded in kept], at_scans)
    final, beam_times_note = with_usable_beam_times(marked)
    all_notes = joined(
        (
            *notes,
            rejections.note(total),
            clock_note,
            scan_jumps_note or odometry_jumps_note,
            difference_note or coverage_note,
            marking_note,
            beam_times_note,
        )
    )
    return LidarLog(final, at_scans, trajectory, lidar, tuple(rejections.entries), all_notes)


def _without_repetitions(scans: Sequence[RecordedScan]) -> list[RecordedScan]:
    """The scans without those that repeat the stamp and the ranges of the one before."""
    kept = list(scans[:1])
    for recorded in scans[1:]:
        last = kept[-1].scan
        if recorded.scan.time != last.time or not np.array_equal(recorded.scan.ranges, last.ranges, equal_nan=True):
            kept.append(recorded)
    return kept


def _with_usable_stamps(
    scans: list[RecordedScan], odometry: Sequence[RecordedOdometry]
) -> tuple[list[RecordedScan], Sequence[RecordedOdometry], str]:
    """Scans and odometry with other stamps if those of the scans do not tell the time, and a note that says so."""
    stamps = np.array([recorded.scan.time for recorded in scans])
    if not has_constant_stamps(stamps):
        return scans, odometry, ""
    reason = f"the scans are stamped with a constant time, {float(np.median(stamps)):.6f} s"
    received = np.array([np.nan if recorded.received is None else recorded.received for recorded in scans])
    if np.isfinite(received).all() and not has_constant_stamps(received):
        timed = [recorded.at(float(time)) for recorded, time in zip(scans, received, strict=True)]
        readings = [reading.at(reading.received) for reading in odometry if reading.received is not None]
        return timed, readings, f"{reason}: the times at which the recorder received them are used"
    times = np.median(stamps) + ASSUMED_SCAN_PERIOD * np.arange(len(scans))
    timed = [recorded.at(float(time)) for recorded, time in zip(scans, times, strict=True)]
    alone = ", and odometry between them is not used" if odometry else ""
    return timed, (), f"{reason}: one scan every {ASSUMED_SCAN_PERIOD:.0f} s is assumed{alone}"


def _kept_scans(scans: list[RecordedScan], rejections: Rejections) -> tuple[list[RecordedScan], str]:
    """The scans without outliers, in the order of time, and a note on lasting jumps of their poses.

    Raises:
        InputError: No scan has a valid range, or odometry jumps too often.
    """
    scans = _kept(scans, stamp_outliers(np.array([recorded.scan.time for recorded in scans])), rejections)
    scans = _kept(scans, beam_count_outliers([len(recorded.scan.ranges) for recorded in scans]), rejections)
    if not any(recorded.scan.valid.any() for recorded in scans):
        limits = f"{scans[0].scan.range_min:g} to {scans[0].scan.range_max:g} m"
        raise InputError(rejections.source, "", f"has no range within the limits of its lidar, {limits}, in any scan")
    poses = [recorded.pose for recorded in scans if recorded.pose is not None]
    if len(poses) < len(scans):
        return scans, ""
    outliers, changes = jumps(poses)
    note = _jumps_note(rejections.source, [scans[index].name for index in changes])
    moved = [replace(recorded, pose=pose) for recorded, pose in zip(scans, _continued(poses, changes), strict=True)]
    return _kept(moved, outliers, rejections), note


def _kept_odometry(
    scans: Sequence[RecordedScan], odometry: Sequence[RecordedOdometry], rejections: Rejections
) -> tuple[list[RecordedOdometry], str]:
    """The readings of odometry without outliers, in the order of time, and a note on what was decided.

    Raises:
        InputError: Odometry jumps too often.
    """
    outliers = stamp_outliers(np.array([reading.time for reading in odometry]))
    have_poses = all(recorded.pose is not None for recorded in scans)
    if have_poses and are_too_many(len(outliers), len(odometry)):
        reason = f"the stamps of {len(outliers):,} of {len(odometry):,} readings of odometry contradict their order"
        return [], f"{reason}: the poses recorded with the scans are used alone"
    readings = _kept(odometry, outliers, rejections)
    poses = [reading.pose for reading in readings]
    outliers, changes = jumps(poses)
    note = _jumps_note(rejections.source, [readings[index].name for index in changes])
    moved = [replace(reading, pose=pose) for reading, pose in zip(readings, _continued(poses, changes), strict=True)]
    return _kept(moved, outliers, rejections), note


def _kept(recorded: Sequence[Recorded], outliers: Outliers, rejections: Rejections) -> list[Recorded]:
    """What was recorded without outliers, which are rejected."""
    for index, reason in outliers.items():
        rejections.reject(recorded[index].name, reason)
    return [entry for index, entry in enumerate(recorded) if index not in outliers]


def _continued(poses: Sequence[Pose], changes: Sequence[int]) -> list[Pose]:
    """Poses without their lasting jumps: the robot is taken to stand still where odometry changes its frame."""
    continued: list[Pose] = []
    correction: Pose | None = None
    starts = set(changes)
    for index, pose in enumerate(poses):
        if index in starts:
            correction = continued[-1] @ pose.inverse
        continued.append(pose if correction is None else correction @ pose)
    return continued


def _jumps_note(source: str, names: Sequence[str]) -> str:
    """A note on lasting jumps of odometry at the named readings; empty if there are none.

    Raises:
        InputError: There are too many for odometry of any use.
    """
    if not names:
        return ""
    if len(names) > MAX_FRAME_CHANGES:
        raise InputError(
            source, names[0], f"odometry jumps by over {MAX_JUMP:.0f} m here and {len(names) - 1} times more"
        )
    more = f" and {len(names) - 1} more" if len(names) > 1 else ""
    return f"odometry jumps to another frame at {names[0]}{more}: it is continued from the pose before the jump"


def _same_clock(scans: Sequence[RecordedScan], odometry: list[RecordedOdometry]) -> tuple[list[RecordedOdometry], str]:
    """The odometry if it is stamped by the scans' clock, otherwise none and a note that says so."""
    if not odometry:
        return odometry, ""
    difference = clock_difference(
        [(recorded.scan.time, recorded.received) for recorded in scans if recorded.received is not None],
        [(reading.time, reading.received) for reading in odometry if reading.received is not None],
    )
    first, last = scans[0].scan.time, scans[-1].scan.time
    poses = "the poses recorded with the scans are used alone" if scans[0].pose else "the scans have no odometry"
    if min(len(scans), len(odometry)) >= MIN_CLOCK_READINGS and difference is not None:
        side = "ahead of" if difference > 0.0 else "behind"
        clock = f"odometry is stamped by another clock, {abs(difference):,.3f} s {side} that of the scans"
        return [], f"{clock}: {poses}"
    if odometry[-1].time < first or odometry[0].time > last:
        times = f"{odometry[0].time:.3f} to {odometry[-1].time:.3f} s, scans from {first:.3f} to {last:.3f} s"
        return [], f"odometry is of another clock or of another drive than the scans, from {times}: {poses}"
    if _contradicts(scans, odometry):
        return [], f"odometry contradicts the poses recorded with the scans, which may be corrected: {poses}"
    return odometry, ""


def _contradicts(scans: Sequence[RecordedScan], odometry: Sequence[RecordedOdometry]) -> bool:
    """Whether poses recorded with the scans are others than those of odometry at the same times."""
    trajectory = _trajectory([(reading.time, reading.pose) for reading in odometry])
    own = [(recorded.scan.time, recorded.pose.as_array()) for recorded in scans if recorded.pose is not None]
    times = np.array([time for time, _ in own])
    covers = covered(trajectory, times)
    is_coarse = len(trajectory.times) < MIN_DISTINCT_SHARE * len(odometry)
    if is_coarse or covers.sum() < MIN_CLOCK_READINGS:
        return False
    poses = np.array([pose for _, pose in own])
    return not agree(poses[covers], trajectory.along_arcs(times[covers]))


def _odometry_at_scans(
    scans: Sequence[RecordedScan], readings: Sequence[RecordedOdometry]
) -> tuple[tuple[Odometry | None, ...], Trajectory, str]:
    """Odometry at each scan or None, all odometry, and a note on scans that odometry does not cover."""
    trajectory = _trajectory([(reading.time, reading.pose) for reading in readings])
    times = np.array([recorded.scan.time for recorded in scans])
    covers = covered(trajectory, times)
    poses: list[Pose | None] = [recorded.pose for recorded in scans]
    if covers.any():
        interpolated = [Pose.from_array(pose) for pose in trajectory.along_arcs(times)]
        poses = [
            pose or (between if covers[index] else None)
            for index, (pose, between) in enumerate(zip(poses, interpolated, strict=True))
        ]
    at_scans = tuple(
        None if pose is None else Odometry(recorded.scan.time, pose, Velocity())
        for recorded, pose in zip(scans, poses, strict=True)
    )
    own = [(recorded.scan.time, recorded.pose) for recorded in scans if recorded.pose is not None]
    whole = _trajectory([(reading.time, reading.pose) for reading in readings] + own)
    return at_scans, whole, _coverage_note(times, np.array([pose is None for pose in poses]), trajectory)


def _trajectory(poses: Sequence[tuple[float, Pose]]) -> Trajectory:
    """Poses in the order of time; of several at the same time, the last one counts."""
    by_time = dict(poses)
    times = sorted(by_time)
    return Trajectory(np.array(times), np.array([by_time[time].as_array() for time in times]).reshape(-1, 3))


def _coverage_note(times: np.ndarray, missing: np.ndarray, odometry: Trajectory) -> str:
    """A note on scans without odometry; empty if there are none, or if there is no odometry at all.

    Args:
        times: Times of the scans, [N] s.
        missing: Whether each scan has no odometry, [N].
        odometry: All odometry.
    """
    if not missing.any() or len(odometry.times) < 2:
        return "the recording has no odometry" if missing.all() else ""
    early = int((missing & (times < odometry.times[0])).sum())
    late = int((missing & (times > odometry.times[-1])).sum())
    holes = hole_lengths(odometry)
    reasons = joined(
        (
            f"it begins {odometry.times[0] - times[0]:,.1f} s after the first ({early:,} scans)" if early else "",
            f"it ends {times[-1] - odometry.times[-1]:,.1f} s before the last ({late:,} scans)" if late else "",
            f"it has {_holes_text(holes)} ({missing.sum() - early - late:,} scans)"
            if missing.sum() > early + late
            else "",
        )
    )
    return f"{missing.sum():,} of {len(times):,} scans have no odometry: {', '.join(reasons)}"


def _holes_text(lengths: Floats) -> str:
    """Holes of odometry by their lengths, s."""
    if len(lengths) == 1:
        return f"a hole of {lengths[0]:,.1f} s"
    return f"{len(lengths)} holes of up to {lengths.max():,.1f} s"
