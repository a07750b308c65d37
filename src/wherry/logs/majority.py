"""Removal of the outliers among recorded scans and odometry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wherry.errors import InputError
from wherry.logs.lidar_log import MAX_JUMP
from wherry.logs.outliers import Outliers, beam_count_outliers, jumps, stamp_outliers
from wherry.logs.recorded import Recorded, RecordedOdometry, RecordedScan, received_times
from wherry.logs.rejections import Rejections, are_too_many
from wherry.space.pose import Pose

MAX_FRAME_CHANGES = 10  # lasting jumps of odometry above which it is refused


def without_repetitions(scans: Sequence[RecordedScan]) -> list[RecordedScan]:
    """The scans without those that repeat the stamp and the ranges of the one before."""
    kept = list(scans[:1])
    for recorded in scans[1:]:
        last = kept[-1].scan
        if recorded.scan.time != last.time or not np.array_equal(recorded.scan.ranges, last.ranges, equal_nan=True):
            kept.append(recorded)
    return kept


def kept_scans(scans: list[RecordedScan], rejections: Rejections) -> tuple[list[RecordedScan], str]:
    """The scans without outliers, in the order of time, and a note on lasting jumps of their poses.

    Raises:
        InputError: No scan has a valid range, or odometry jumps too often.
    """
    stamps = np.array([recorded.scan.time for recorded in scans])
    scans = _kept(scans, stamp_outliers(stamps, received_times(scans)), rejections)
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


def kept_odometry(
    scans: Sequence[RecordedScan], odometry: Sequence[RecordedOdometry], rejections: Rejections
) -> tuple[list[RecordedOdometry], str]:
    """The readings of odometry without outliers, in the order of time, and a note on what was decided.

    Raises:
        InputError: Odometry jumps too often.
    """
    outliers = stamp_outliers(np.array([reading.time for reading in odometry]), received_times(odometry))
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
