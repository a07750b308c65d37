"""Simultaneous localization and mapping: what every method offers, and by which name it is chosen."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from wherry.robot import Odometry, Scan
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose
from wherry.space.trajectory import Trajectory

NO_DISCS = np.zeros((0, 3))


class Slam(Protocol):
    """Makes a map of scans and odometry, and says where the robot is on it. The map's origin is the first pose."""

    def add(self, scan: Scan, odometry: Odometry | None = None) -> Pose:
        """Take in a scan.

        Args:
            scan: Later than the one before.
            odometry: Of the scan's instant; None if there is none, and then steady motion is expected.

        Returns:
            base_link in the map frame.
        """
        ...

    def grid(self, exclude: Floats = NO_DISCS) -> OccupancyGrid:
        """The map so far.

        Args:
            exclude: [K, 3] m, map frame: x, y and radius of discs; beams that ended there leave no hit.
        """
        ...

    @property
    def trajectory(self) -> Trajectory:
        """Where the robot was at each scan, as it is known now."""
        ...
