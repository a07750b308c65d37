"""Where the robot is in its map at every instant: corrected by scans, carried on by odometry in between (REP 105)."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from wherry.robot import Odometry, Scan
from wherry.space.pose import Pose


class Corrector(Protocol):
    """What turns odometry and a scan into a pose in the map: SLAM while mapping, AMCL afterwards."""

    def correct(self, odometry: Odometry, scan: Scan) -> Pose:
        """Return base_link in the map frame at the scan's time."""
        ...

    @property
    def particles(self) -> NDArray[np.float64]:
        """[N, 3] x m, y m, θ rad, map frame: the belief as samples; empty where there is only one pose."""
        ...

    @property
    def lost(self) -> bool:
        """Whether the pose should not be relied upon."""
        ...


class OnePose:
    """The rest of a `Corrector` that has one pose, not a belief, and relies on it."""

    @property
    def particles(self) -> NDArray[np.float64]:
        """None."""
        return np.empty((0, 3))

    @property
    def lost(self) -> bool:
        """Never."""
        return False


class PoseTracker:
    """Keeps the transform from the map to the odom frame, as ROS's localization nodes do.

    Args:
        corrector: What scans are given to.
        start: base_link in the map frame before the first scan.
    """

    def __init__(self, corrector: Corrector, start: Pose) -> None:
        self.corrector = corrector
        self._map_from_odom: Pose | None = None
        self._start = start
        self._odometry: Odometry | None = None

    @property
    def pose(self) -> Pose:
        """base_link in the map frame now."""
        if self._odometry is None or self._map_from_odom is None:
            return self._start
        return self._map_from_odom @ self._odometry.pose

    @property
    def lost(self) -> bool:
        """Whether the pose should not be relied upon."""
        return self.corrector.lost

    @property
    def map_from_odom(self) -> Pose:
        """The odom frame in the map frame; the identity of drift."""
        return self._start if self._map_from_odom is None else self._map_from_odom

    def hear(self, odometry: Odometry) -> None:
        """Take in how the wheels turned."""
        if self._map_from_odom is None:
            self._map_from_odom = self._start @ odometry.pose.inverse
        self._odometry = odometry

    def see(self, scan: Scan) -> None:
        """Take in a scan of the instant of the last odometry."""
        if self._odometry is None:
            return  # a scan without odometry says nothing of motion yet
        pose = self.corrector.correct(self._odometry, scan)
        self._map_from_odom = pose @ self._odometry.pose.inverse
