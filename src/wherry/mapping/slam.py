"""The protocol of SLAM methods."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from wherry.mapping.graph_snapshot import GraphSnapshot
from wherry.mapping.loop_closure import LoopClosure
from wherry.mapping.odometry_check import OdometryContradiction
from wherry.robot import Odometry, Scan
from wherry.space.occupancy import NO_DISCS, OccupancyGrid
from wherry.space.pose import Floats, Pose
from wherry.space.trajectory import Trajectory


class Slam(Protocol):
    """Maps scans and odometry and tracks the robot on the map, whose origin is the robot's first pose."""

    def add(self, scan: Scan, odometry: Odometry | None = None) -> Pose:
        """Add a scan.

        Args:
            scan: A scan later than the one before.
            odometry: Odometry at the scan's time; None without odometry, in which case constant velocity is assumed.
                Where scan matching contradicts odometry, it is ignored.

        Returns:
            base_link in the map frame.
        """
        ...

    def finish(self) -> None:
        """Complete the optimization that is pending; scans may be added afterwards."""
        ...

    def grid(self, exclude: Floats = NO_DISCS) -> OccupancyGrid:
        """The map so far.

        Args:
            exclude: Discs whose hits are left out: x, y and radius in the map frame, [K, 3] m.
        """
        ...

    @property
    def trajectory(self) -> Trajectory:
        """base_link at each scan in the map frame, by the present estimate."""
        ...

    @property
    def keyframe_poses(self) -> Floats:
        """base_link at each keyframe in the map frame, by the present estimate, [K, 3] m, m, rad."""
        ...

    @property
    def loop_closures(self) -> Sequence[LoopClosure]:
        """All loop closures that were attempted, accepted or not; empty for a method without loop closing."""
        ...

    @property
    def odometry_contradictions(self) -> Sequence[OdometryContradiction]:
        """Motions that odometry and scan matching measured differently; the map follows the scans there."""
        ...

    def snapshot(self) -> GraphSnapshot | None:
        """The pose graph with everything needed to continue; None for a method without a pose graph."""
        ...
