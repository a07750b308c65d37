"""Assembly of a log from recorded scans and odometry, by the same rules for text logs and bags."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wherry.errors import InputError
from wherry.logs.lidar_log import LidarLog
from wherry.logs.options import ReadingOptions
from wherry.robot import Odometry, Scan, Velocity
from wherry.space.pose import Pose
from wherry.space.trajectory import Trajectory


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


def assemble_log(
    source: str,
    scans: Sequence[RecordedScan],
    odometry: Sequence[RecordedOdometry],
    lidar: Pose,
    options: ReadingOptions,
    *,
    skipped: Sequence[str] = (),
    notes: Sequence[str] = (),
) -> LidarLog:
    """Assemble a log.

    Args:
        source: Name of the file.
        scans: The scans in the order of the recording.
        odometry: The odometry in the order of the recording, without that of the scans.
        lidar: Pose of the lidar in the base_link frame.
        options: How to read.
        skipped: Lines or messages that were left out already.
        notes: Notes on what was decided already.

    Raises:
        InputError: There are no scans.
    """
    if not scans:
        raise InputError(source, "", "has no scans in it")
    poses = {reading.time: reading.pose for reading in odometry}
    poses |= {recorded.scan.time: recorded.pose for recorded in scans if recorded.pose is not None}
    times = sorted(poses)
    rows = np.array([poses[time].as_array() for time in times]).reshape(-1, 3)
    trajectory = Trajectory(np.array(times), rows)
    at_scans = tuple(_odometry_at(recorded, trajectory) for recorded in scans)
    return LidarLog(
        tuple(recorded.scan for recorded in scans), at_scans, trajectory, lidar, tuple(skipped), tuple(notes)
    )


def _odometry_at(recorded: RecordedScan, trajectory: Trajectory) -> Odometry | None:
    """Odometry at a scan; None outside of the time of all odometry."""
    time = recorded.scan.time
    if recorded.pose is not None:
        return Odometry(time, recorded.pose, Velocity())
    if len(trajectory.times) < 2 or not trajectory.times[0] <= time <= trajectory.times[-1]:
        return None
    return Odometry(time, Pose.from_array(trajectory.at(np.array([time]))[0]), Velocity())
