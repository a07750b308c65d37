"""Collection of a text log's messages, with checks of their order."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from wherry.errors import InputError
from wherry.logs.lidar_log import MAX_JUMP, LidarLog
from wherry.logs.log_lines import MalformedLineError
from wherry.logs.max_range_readings import mark_beams_without_return
from wherry.robot import Odometry, Scan, Velocity
from wherry.space.pose import IDENTITY, Pose
from wherry.space.trajectory import Trajectory

SICK_RANGE_MAX = 80.0  # m, longest valid range if a log gives none; without a return, SICK lidars read 81.83 or 81.91
MOUNT_TOLERANCE = 1e-3  # m and rad by which the lidar's pose on the robot may vary between scans


@dataclass
class LogCollector:
    """Scans and odometry of the messages that were read so far.

    Attributes:
        source: Name of the file.
        is_lenient: Whether malformed lines are left out; otherwise the first one raises an `InputError`.
        scan_message: Type of the first scan message, the only type that scans are taken from; empty before it.
        lidar_offset: Distance of the lidar ahead of base_link, m; None if the log does not give it.
        range_max: Longest valid range, m.
        scans: Scans with the poses of base_link and of the lidar in the odom frame.
        odometry: Times and poses of odometry messages.
        skipped: Lines that were left out, with reasons.
    """

    source: str
    is_lenient: bool
    scan_message: str = ""
    lidar_offset: float | None = None
    range_max: float = SICK_RANGE_MAX
    scans: list[tuple[Scan, Pose, Pose]] = field(default_factory=list)
    odometry: list[tuple[float, Pose]] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)

    def skip_line(self, number: int, reason: str) -> None:
        """Leave a malformed line out.

        Raises:
            InputError: The collector is not lenient; the error names the line and the reason.
        """
        if not self.is_lenient:
            raise InputError(self.source, f"line {number}", reason)
        self.skipped.append(f"line {number}: {reason}")

    def add_scan(self, scan: Scan, robot: Pose, lidar: Pose) -> None:
        """Add a scan.

        Args:
            scan: A scan not earlier than the one before; repetitions of the last one are ignored.
            robot: base_link in the odom frame.
            lidar: The lidar in the odom frame.

        Raises:
            MalformedLineError: The scan is earlier than the one before, has other beams, or is too far away.
        """
        if self.scans:
            last, last_robot, _ = self.scans[-1]
            if scan.time < last.time:
                raise MalformedLineError(f"time runs backwards, from {last.time:.6f} to {scan.time:.6f}")
            if len(scan.ranges) != len(last.ranges):
                raise MalformedLineError(f"has {len(scan.ranges)} beams where the scans before have {len(last.ranges)}")
            if scan.time == last.time and np.array_equal(scan.ranges, last.ranges):
                return
            jump = math.hypot(robot.x - last_robot.x, robot.y - last_robot.y)
            if jump > MAX_JUMP:
                raise MalformedLineError(f"odometry jumps by {jump:,.0f} m since the scan before")
        self.scans.append((scan, robot, lidar))

    def add_odometry(self, time: float, pose: Pose) -> None:
        """Add odometry.

        Args:
            time: Time, s, not earlier than the one before; gmapping repeats the poses of scans with time 0.
            pose: base_link in the odom frame.

        Raises:
            MalformedLineError: The time is earlier than the one before.
        """
        if time == 0.0 and self.odometry:
            return
        if self.odometry and time < self.odometry[-1][0]:
            raise MalformedLineError(f"time runs backwards, from {self.odometry[-1][0]:.6f} to {time:.6f}")
        self.odometry.append((time, pose))

    def log(self) -> LidarLog:
        """The log of all messages.

        Raises:
            InputError: There are no scans.
        """
        if not self.scans:
            skipped = (
                f" ({len(self.skipped)} lines were left out, the first: {self.skipped[0]})" if self.skipped else ""
            )
            raise InputError(self.source, "", "has no scans in it" + skipped)
        scans = mark_beams_without_return([scan for scan, _, _ in self.scans])
        scan_odometry = tuple(Odometry(scan.time, robot, Velocity()) for scan, robot, _ in self.scans)
        poses = dict(self.odometry) | {odometry.time: odometry.pose for odometry in scan_odometry}
        times = sorted(poses)
        trajectory = Trajectory(np.array(times), np.array([poses[time].as_array() for time in times]))
        return LidarLog(scans, scan_odometry, trajectory, self._lidar_pose(), tuple(self.skipped))

    def _lidar_pose(self) -> Pose:
        """The lidar in the base_link frame: from the poses of the scans if they agree, otherwise from the parameter.

        They disagree in logs where only the lidar's poses were corrected afterwards.
        """
        mounts = np.array([lidar.relative_to(robot).as_array() for _, robot, lidar in self.scans])
        if np.abs(mounts - mounts[0]).max() <= MOUNT_TOLERANCE and np.abs(mounts[0]).max() > MOUNT_TOLERANCE:
            return Pose.from_array(mounts[0])
        return IDENTITY if self.lidar_offset is None else Pose(self.lidar_offset, 0.0, 0.0)
