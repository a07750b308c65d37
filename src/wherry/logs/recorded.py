"""Scans and odometry as they stand in a recording of any format."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from wherry.robot import Scan
from wherry.space.pose import Floats, Pose
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


def received_times(recorded: Sequence[RecordedScan] | Sequence[RecordedOdometry]) -> Floats | None:
    """Times at which the recorder received all of a series, [N] s; None if some are unknown."""
    times = [entry.received for entry in recorded if entry.received is not None]
    return np.array(times) if len(times) == len(recorded) else None


def trajectory_of(poses: Sequence[tuple[float, Pose]]) -> Trajectory:
    """Poses in the order of time; of several at the same time, the last one counts."""
    by_time = dict(poses)
    times = sorted(by_time)
    return Trajectory(np.array(times), np.array([by_time[time].as_array() for time in times]).reshape(-1, 3))
