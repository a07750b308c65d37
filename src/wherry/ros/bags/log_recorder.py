"""Recording a lidar log as a bag, together with the pose estimates and maps computed from it."""

from __future__ import annotations

import numpy as np

from wherry.logs.lidar_log import LidarLog
from wherry.robot import Odometry, Velocity
from wherry.ros.bags.run_recorder import RunRecorder
from wherry.ros.bags.writer import BagWriter
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose


class LogRecorder:
    """Records a lidar log and the pose estimated from each of its scans.

    Args:
        bag: Bag to write to; the caller closes it.
        log: The log.
    """

    def __init__(self, bag: BagWriter, log: LidarLog) -> None:
        self._recorder = RunRecorder(bag)
        self._log = log
        self._odometry_count = 0  # odometry messages written so far

    def write_scan(self, index: int, pose: Pose, particles: Floats) -> None:
        """Record a scan, the odometry up to its time, and the robot's estimated pose.

        Args:
            index: Index of the scan; each must be recorded once, in order.
            pose: base_link in the map frame at the time of the scan.
            particles: [N, 3] x m, y m, θ rad, map frame; may be empty.
        """
        scan = self._log.scans[index]
        self._write_odometry(scan.time)
        self._recorder.write_pose_estimate(pose, particles, scan.time)
        self._recorder.write_measurement(scan, self._log.lidar)
        if index == len(self._log.scans) - 1:
            self._write_odometry(np.inf)

    def write_map(self, grid: OccupancyGrid, seconds: float) -> None:
        """Record a map at a time, s."""
        self._recorder.write_map(grid, seconds)

    def _write_odometry(self, until: float) -> None:
        """Record the odometry up to a time, s, that has not been recorded yet."""
        odometry = self._log.odometry
        while self._odometry_count < len(odometry.times) and odometry.times[self._odometry_count] <= until:
            pose = Pose.from_array(odometry.poses[self._odometry_count])
            measured = Odometry(float(odometry.times[self._odometry_count]), pose, Velocity())
            self._recorder.write_measurement(measured, self._log.lidar)
            self._odometry_count += 1
