"""A recorded lidar log: scans, odometry and the lidar's pose on the robot."""

from __future__ import annotations

from dataclasses import dataclass

from wherry.robot import Odometry, Scan
from wherry.space.pose import Pose
from wherry.space.trajectory import Trajectory

MAX_BEAMS = 20_000  # beams per scan
MAX_JUMP = 100.0  # m of odometry between consecutive scans; more is not the motion of a robot


@dataclass(frozen=True)
class LidarLog:
    """Scans and odometry of a recording.

    Attributes:
        scans: All scans in the order of their times, N.
        scan_odometry: Odometry at the time of each scan, [N]; None where the log has none.
        odometry: All odometry of the log in the order of its times, including that of the scans.
        lidar: Pose of the lidar in the base_link frame.
        skipped: Lines or messages that were left out, as ``line 12: reason``.
    """

    scans: tuple[Scan, ...]
    scan_odometry: tuple[Odometry | None, ...]
    odometry: Trajectory
    lidar: Pose
    skipped: tuple[str, ...]
