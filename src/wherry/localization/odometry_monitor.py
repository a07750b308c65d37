"""Odometry between scans: validity of measurements, jumps of the odom frame, and when a filter update is due."""

from __future__ import annotations

import math

import numpy as np

from wherry.robot import Odometry, Scan
from wherry.space.pose import Pose

JUMP_TOLERANCE = 0.5  # m, change of the odometry's pose up to which it is no jump, however short the time


class OdometryMonitor:
    """Motion since the last scan and since the last filter update.

    Args:
        max_speed: Speed above which a change of the odometry's pose is a jump of the odom frame, m/s.

    Attributes:
        scan_time: Time of the last usable scan, s; −inf before the first one.
    """

    def __init__(self, max_speed: float) -> None:
        self._max_speed = max_speed
        self._last: Odometry | None = None
        self._last_update: Pose | None = None
        self.scan_time = -math.inf

    def rejection(self, odometry: Odometry, scan: Scan) -> str:
        """Why a measurement is unusable; empty if it is usable."""
        if not (np.isfinite(odometry.pose.as_array()).all() and math.isfinite(odometry.time)):
            return "the odometry is not finite"
        if not all(map(math.isfinite, (scan.time, scan.angle_min, scan.angle_increment))):
            return "the scan's time or angles are not finite"
        if scan.time < self.scan_time or (self._last and odometry.time < self._last.time):
            return "time runs backwards"
        return ""

    def absorb_jump(self, odometry: Odometry) -> str:
        """Treat a jump of the odometry as a change of the odom frame instead of a motion.

        Returns:
            A message about the jump; empty if there is none.
        """
        if self._last is None or self._last_update is None:
            self._last_update = self._last_update or odometry.pose
            return ""
        jump = odometry.pose.distance_to(self._last.pose)
        if jump <= JUMP_TOLERANCE + self._max_speed * (odometry.time - self._last.time):
            return ""
        pending = self._last.pose.relative_to(self._last_update)
        self._last_update = odometry.pose @ pending.inverse
        self._last = odometry
        return f"the odometry jumped by {jump:.2f} m"

    def since_last_scan(self, odometry: Odometry) -> Pose:
        """Pose of base_link relative to its pose at the last usable scan."""
        return odometry.pose.relative_to(self._last.pose) if self._last else Pose()

    def since_last_update(self, odometry: Odometry) -> Pose:
        """Pose of base_link relative to its pose at the last filter update."""
        return odometry.pose.relative_to(self._last_update) if self._last_update else Pose()

    def mark_update(self, odometry: Odometry) -> None:
        """Note that the filter was updated with this odometry."""
        self._last_update = odometry.pose

    def mark_scan(self, odometry: Odometry, scan: Scan) -> None:
        """Note that this scan and odometry were usable."""
        self._last, self.scan_time = odometry, scan.time


class UpdatePolicy:
    """A filter update is due after enough motion, or on request (nav2's update_min_d, update_min_a).

    Args:
        min_translation: Translation from which an update is due, m.
        min_rotation: Absolute rotation from which an update is due, rad.
    """

    def __init__(self, min_translation: float, min_rotation: float) -> None:
        self._min_translation = min_translation
        self._min_rotation = min_rotation
        self._is_requested = True

    def request(self) -> None:
        """Make an update due at the next scan, even without any motion."""
        self._is_requested = True

    def is_due(self, motion: Pose) -> bool:
        """Whether an update is due after a motion since the last one."""
        return (
            self._is_requested
            or math.hypot(motion.x, motion.y) >= self._min_translation
            or abs(motion.theta) >= self._min_rotation
        )

    def mark_update(self) -> None:
        """Note that the filter was updated, which fulfils a request."""
        self._is_requested = False
