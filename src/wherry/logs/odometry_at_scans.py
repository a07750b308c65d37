"""Odometry at the times of scans, with a note on scans that have none."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from wherry.logs.coverage import covered, hole_lengths
from wherry.logs.recorded import RecordedOdometry, RecordedScan, trajectory_of
from wherry.logs.rejections import joined
from wherry.robot import Odometry, Velocity
from wherry.space.pose import Floats, Pose
from wherry.space.trajectory import Trajectory
from wherry.wording import counted, verb_for


def odometry_at_scans(
    scans: Sequence[RecordedScan], readings: Sequence[RecordedOdometry]
) -> tuple[tuple[Odometry | None, ...], Trajectory, str]:
    """Odometry at each scan or None, all odometry, and a note on scans that odometry does not cover."""
    trajectory = trajectory_of([(reading.time, reading.pose) for reading in readings])
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
    whole = trajectory_of([(reading.time, reading.pose) for reading in readings] + own)
    return at_scans, whole, _coverage_note(times, np.array([pose is None for pose in poses]), trajectory)


def _coverage_note(times: Floats, missing: NDArray[np.bool_], odometry: Trajectory) -> str:
    """A note on scans without odometry; empty if there are none, or if there is no odometry at all.

    Args:
        times: Times of the scans, [N] s.
        missing: Whether each scan has no odometry, [N].
        odometry: All odometry.
    """
    if not missing.any() or len(odometry.times) < 2:
        return "the recording has no odometry" if missing.all() else ""
    total = int(missing.sum())
    early = int((missing & (times < odometry.times[0])).sum())
    late = int((missing & (times > odometry.times[-1])).sum())
    holes = hole_lengths(odometry)
    reasons = joined(
        (
            f"it begins {odometry.times[0] - times[0]:,.1f} s after the first ({counted(early, 'scan')})"
            if early
            else "",
            f"it ends {times[-1] - odometry.times[-1]:,.1f} s before the last ({counted(late, 'scan')})"
            if late
            else "",
            f"it has {_holes_text(holes)} ({counted(total - early - late, 'scan')})" if total > early + late else "",
        )
    )
    return f"{total:,} of {len(times):,} scans {verb_for(total, 'has', 'have')} no odometry: {', '.join(reasons)}"


def _holes_text(lengths: Floats) -> str:
    """Holes of odometry by their lengths, s."""
    if len(lengths) == 1:
        return f"a hole of {lengths[0]:,.1f} s"
    return f"{len(lengths)} holes of up to {lengths.max():,.1f} s"
