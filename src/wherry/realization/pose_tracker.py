"""Pose tracking: corrected by scans and propagated by odometry in between (REP 105)."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from wherry.robot import Odometry, Scan
from wherry.space.pose import Pose


class PoseEstimator(Protocol):
    """Estimates the pose in the map from odometry and scans, for example by SLAM or AMCL."""

    def update(self, odometry: Odometry, scan: Scan) -> Pose:
        """Return base_link in the map frame at the scan's time."""
        ...

    @property
    def particles(self) -> NDArray[np.float64]:
        """[N, 3] pose hypotheses x, y, θ, m, m, rad, map frame; empty for an estimator without particles."""
        ...

    @property
    def is_lost(self) -> bool:
        """Whether the pose is unreliable."""
        ...


class SinglePoseEstimator:
    """Base of pose estimators with a single hypothesis that is always considered reliable."""

    @property
    def particles(self) -> NDArray[np.float64]:
        """[0, 3] empty array."""
        return np.empty((0, 3))

    @property
    def is_lost(self) -> bool:
        """Always False."""
        return False


class PoseTracker:
    """Tracks the odom frame in the map frame, as localization nodes in ROS do.

    Args:
        estimator: Estimates the pose at each scan.
        start: base_link in the map frame before the first scan.

    Attributes:
        estimator: Estimates the pose at each scan.
    """

    def __init__(self, estimator: PoseEstimator, start: Pose) -> None:
        self.estimator = estimator
        self._map_from_odom: Pose | None = None
        self._start = start
        self._odometry: Odometry | None = None

    @property
    def pose(self) -> Pose:
        """base_link in the map frame at the last odometry's time."""
        if self._odometry is None or self._map_from_odom is None:
            return self._start
        return self._map_from_odom @ self._odometry.pose

    @property
    def is_lost(self) -> bool:
        """Whether the pose is unreliable."""
        return self.estimator.is_lost

    @property
    def map_from_odom(self) -> Pose:
        """The odom frame in the map frame."""
        return self._start if self._map_from_odom is None else self._map_from_odom

    def add_odometry(self, odometry: Odometry) -> None:
        """Propagate the pose by the odometry's motion."""
        if self._map_from_odom is None:
            self._map_from_odom = self._start @ odometry.pose.inverse
        self._odometry = odometry

    def add_scan(self, scan: Scan) -> None:
        """Correct the pose with a scan taken at the last odometry's time; ignored before the first odometry."""
        if self._odometry is None:
            return
        pose = self.estimator.update(self._odometry, scan)
        self._map_from_odom = pose @ self._odometry.pose.inverse
