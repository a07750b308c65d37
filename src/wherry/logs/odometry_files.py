"""Odometry of a file besides a log, such as denser odometry, checked against that of the log."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from wherry.errors import InputError
from wherry.logs.coverage import agree, covered, end_tolerance
from wherry.logs.lidar_log import LidarLog
from wherry.logs.tables import read_trajectory
from wherry.robot import Odometry, Velocity
from wherry.space.pose import Floats, Pose, compose, relative
from wherry.space.trajectory import Trajectory, merge_odometry


def with_odometry_file(log: LidarLog, path: Path) -> LidarLog:
    """The log with the odometry of a file merged into its own; scans that had none get that of the file.

    Raises:
        InputError: The file cannot be read, is of another time than the scans, or has other poses than the log.
    """
    trajectory, notes = read_trajectory(path)
    odometry = _distinct(trajectory)
    times = np.array([scan.time for scan in log.scans])
    margin = end_tolerance(odometry.times)
    if odometry.times[-1] < times[0] - margin or odometry.times[0] > times[-1] + margin:
        spans = f"{odometry.times[0]:.3f} to {odometry.times[-1]:.3f} s, the scans {times[0]:.3f} to {times[-1]:.3f} s"
        raise InputError(path, "", f"covers {spans}: it is of another clock or of another drive")
    covers = covered(odometry, times)
    poses = odometry.along_arcs(times)
    pairs = [
        (reading.pose.as_array(), pose)
        for reading, pose, is_covered in zip(log.scan_odometry, poses, covers, strict=True)
        if reading is not None and is_covered
    ]
    if pairs:
        _check_agreement(path, np.array([own for own, _ in pairs]), np.array([other for _, other in pairs]))
    at_scans = tuple(
        Odometry(scan.time, Pose.from_array(pose), Velocity()) if reading is None and is_covered else reading
        for scan, reading, pose, is_covered in zip(log.scans, log.scan_odometry, poses, covers, strict=True)
    )
    added = sum(reading is None and bool(covers[index]) for index, reading in enumerate(log.scan_odometry))
    if added:
        notes = (*notes, f"{added:,} of {len(times):,} scans have the odometry of {path}")
    merged = merge_odometry(log.odometry, odometry) if len(log.odometry.times) else odometry
    return replace(log, scan_odometry=at_scans, odometry=merged, notes=(*log.notes, *notes))


def _check_agreement(path: Path, own: Floats, other: Floats) -> None:
    """Refuse odometry, [N, 3] m, m, rad, that differs from the log's own at the same times."""
    if agree(own, other):
        return
    shift = _alignment(own, other)
    if agree(own, compose(np.broadcast_to(shift, other.shape), other)):
        offset = f"{math.hypot(shift[0], shift[1]):.2f} m and {math.degrees(shift[2]):.1f}°"
        raise InputError(path, "", f"is in another frame than the log's odometry, which is {offset} away")
    difference = relative(other, own)
    distance, angle = np.median(np.hypot(difference[:, 0], difference[:, 1])), np.median(np.abs(difference[:, 2]))
    apart = f"{distance:.2f} m and {math.degrees(angle):.1f}° (medians of {len(own):,} scans)"
    reason = f"disagrees with the log's odometry by {apart}"
    raise InputError(path, "", f"{reason}: it is of another drive, another clock, or corrected")


def _alignment(own: Floats, other: Floats) -> Floats:
    """The transform, [3] m, m, rad, from the frame of the other poses to that of the own ones, by the first of both."""
    inverse = relative(np.zeros((1, 3)), other[:1])
    shift: Floats = compose(own[:1], inverse)[0]
    return shift


def _distinct(odometry: Trajectory) -> Trajectory:
    """Odometry with one pose at each time."""
    times, first = np.unique(odometry.times, return_index=True)
    return Trajectory(times, odometry.poses[first])
