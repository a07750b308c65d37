"""A recorded lidar log: scans, odometry and the lidar's pose on the robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wherry.robot import Odometry, Scan
from wherry.space.pose import Pose, relative
from wherry.space.trajectory import Trajectory

MAX_BEAMS = 20_000  # beams per scan
MAX_RANGES = 40_000_000  # total of all scans of a log, 0.3 GB: an hour of 1,081 beams at 10 Hz
MAX_RANGE = 1000.0  # m, longest range of any lidar
MAX_JUMP = 100.0  # m of odometry between consecutive scans; more is not the motion of a robot


@dataclass(frozen=True)
class LidarLog:
    """Scans and odometry of a recording.

    Attributes:
        scans: All scans in the order of their times, N, as the lidar sent them.
        scan_odometry: Odometry at the time of each scan, [N]; None where odometry does not cover the scan.
        odometry: All odometry of the log in the order of its times, including that of the scans.
        lidar: Pose of the lidar in the base_link frame.
        skipped: Lines or messages that were left out, as ``line 12: reason``.
        notes: What was decided, assumed or left out while reading, as sentences for the user.
    """

    scans: tuple[Scan, ...]
    scan_odometry: tuple[Odometry | None, ...]
    odometry: Trajectory
    lidar: Pose
    skipped: tuple[str, ...]
    notes: tuple[str, ...] = ()

    def deskewed(self, index: int) -> Scan:
        """A scan corrected for the robot's motion during it by odometry; unchanged without odometry or beam times."""
        scan = self.scans[index]
        if scan.time_increment == 0.0 or self.scan_odometry[index] is None or len(self.odometry.times) < 2:
            return scan
        poses = self.odometry.along_arcs(scan.time + scan.beam_times)
        first = self.odometry.along_arcs(np.array([scan.time]))
        return scan.moved_back(self.lidar, relative(poses, first))
