"""The whole state of graph SLAM as one value, which can be saved and continued from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wherry.mapping.constraints import ConstraintList
from wherry.mapping.keyframes import Keyframe
from wherry.mapping.loop_closure import LoopClosure
from wherry.mapping.odometry_check import OdometryContradiction
from wherry.mapping.settings import GraphSlamSettings
from wherry.mapping.submaps import Submap
from wherry.mapping.tracking import TrackingState
from wherry.space.pose import Floats, Pose


class ScanPose(NamedTuple):
    """The pose of one scan, relative to a keyframe.

    Attributes:
        time: Time of the scan, s.
        keyframe: Index of the last keyframe at that time.
        offset: base_link at the scan in the frame of base_link at the keyframe.
    """

    time: float
    keyframe: int
    offset: Pose


@dataclass(frozen=True)
class GraphSnapshot:
    """The state of graph SLAM after a scan.

    Attributes:
        lidar: Pose of the lidar in the base_link frame.
        settings: Settings of the method.
        keyframes: All keyframes, K.
        keyframe_poses: base_link at each keyframe in the map frame, [K, 3] m, m, rad.
        constraints: Constraints between keyframes.
        submaps: Submaps in the order in which they were begun.
        submap_constraints: Constraints between submaps, whose nodes are indices into ``submaps``.
        tracking: State of the front end; None before the first scan.
        scan_poses: Poses of all scans.
        loop_closures: Loop closures that were attempted, accepted or not.
        pending_closures: Accepted loop closures since the last optimization.
        odometry_contradictions: Motions that odometry and scan matching measured differently.
    """

    lidar: Pose
    settings: GraphSlamSettings
    keyframes: tuple[Keyframe, ...]
    keyframe_poses: Floats
    constraints: ConstraintList
    submaps: tuple[Submap, ...]
    submap_constraints: ConstraintList
    tracking: TrackingState | None
    scan_poses: tuple[ScanPose, ...]
    loop_closures: tuple[LoopClosure, ...]
    pending_closures: int
    odometry_contradictions: tuple[OdometryContradiction, ...] = ()

    @classmethod
    def empty(cls, lidar: Pose, settings: GraphSlamSettings) -> GraphSnapshot:
        """The state before the first scan."""
        no_constraints = ConstraintList()
        return cls(lidar, settings, (), np.zeros((0, 3)), no_constraints, (), no_constraints, None, (), (), 0)

    @property
    def keyframe_scans(self) -> NDArray[np.int64]:
        """Index of the scan at each keyframe, [K]."""
        keyframes = [scan_pose.keyframe for scan_pose in self.scan_poses]
        return np.searchsorted(keyframes, np.arange(len(self.keyframes)))
