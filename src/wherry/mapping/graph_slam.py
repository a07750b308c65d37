"""Graph SLAM: scans are matched to the submap around the robot, and loop closures correct the whole map.

The front end, `wherry.mapping.front_end`, matches each scan to the present submap, which optimization does not change;
the back end, `wherry.mapping.loop_closer`, moves the submaps relative to each other (Hess et al. 2016). The frame of a
submap is the base_link frame of its first keyframe, so all nodes of the pose graph are keyframes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from wherry.mapping.constraints import Constraint
from wherry.mapping.front_end import FrontEnd
from wherry.mapping.graph_snapshot import GraphSnapshot, ScanPose
from wherry.mapping.keyframe_graph import KeyframeGraph
from wherry.mapping.keyframes import Keyframe, MapRenderer
from wherry.mapping.loop_closer import LoopCloser
from wherry.mapping.loop_closure import LoopClosure
from wherry.mapping.odometry_check import OdometryContradiction
from wherry.mapping.pose_graph import PoseGraph
from wherry.mapping.settings import GraphSlamSettings
from wherry.mapping.submap_graph import SubmapGraph
from wherry.mapping.submaps import MatchingGridCache
from wherry.robot import Odometry, Scan
from wherry.space.occupancy import NO_DISCS, OccupancyGrid
from wherry.space.pose import IDENTITY, Floats, Pose
from wherry.space.trajectory import Trajectory

RESUME_COVARIANCE = np.diag([0.05**2, 0.05**2, math.radians(1.0) ** 2])  # m, m, rad, of the pose where mapping resumes


class GraphSlam:
    """Graph SLAM; implements `wherry.mapping.slam.Slam`.

    Args:
        lidar: Pose of the lidar in the base_link frame.
        settings: Settings of the method.
    """

    def __init__(self, lidar: Pose = IDENTITY, settings: GraphSlamSettings | None = None) -> None:
        self._restore(GraphSnapshot.empty(lidar, settings or GraphSlamSettings()))

    @classmethod
    def from_snapshot(cls, snapshot: GraphSnapshot) -> GraphSlam:
        """Graph SLAM that continues from a snapshot, as if it had never stopped."""
        slam = cls.__new__(cls)
        slam._restore(snapshot)
        return slam

    def _restore(self, snapshot: GraphSnapshot) -> None:
        """Take the state of a snapshot, which later scans do not change."""
        settings = snapshot.settings
        self._lidar = snapshot.lidar
        self._settings = settings
        self._graph = KeyframeGraph(snapshot.keyframes, snapshot.keyframe_poses, snapshot.constraints)
        self._submaps = SubmapGraph(snapshot.submaps, snapshot.submap_constraints)
        self._grids = MatchingGridCache(self._graph.keyframes)
        self._loop_closer = LoopCloser(
            self._graph, self._submaps, self._grids, settings, snapshot.loop_closures, snapshot.pending_closures
        )
        self._front_end = FrontEnd(
            self._lidar, settings, self._graph, self._submaps, self._grids, snapshot.odometry_contradictions
        )
        self._tracking = snapshot.tracking
        self._scan_poses = list(snapshot.scan_poses)
        self._renderer = MapRenderer(self._lidar, settings.resolution, settings.range_limit, settings.empty_range)

    def snapshot(self) -> GraphSnapshot:
        """The whole state; later scans do not change it."""
        return GraphSnapshot(
            lidar=self._lidar,
            settings=self._settings,
            keyframes=tuple(self._graph.keyframes),
            keyframe_poses=self._graph.poses.copy(),
            constraints=self._graph.constraints.copy(),
            submaps=tuple(submap.copy() for submap in self._submaps.submaps),
            submap_constraints=self._submaps.constraints.copy(),
            tracking=self._tracking,
            scan_poses=tuple(self._scan_poses),
            loop_closures=tuple(self._loop_closer.attempted),
            pending_closures=self._loop_closer.pending,
            odometry_contradictions=tuple(self._front_end.contradictions),
        )

    @property
    def settings(self) -> GraphSlamSettings:
        """Settings of the method."""
        return self._settings

    @property
    def lidar(self) -> Pose:
        """Pose of the lidar in the base_link frame."""
        return self._lidar

    @property
    def keyframes(self) -> Sequence[Keyframe]:
        """The scans that the map is made of."""
        return self._graph.keyframes

    @property
    def keyframe_poses(self) -> Floats:
        """base_link at each keyframe in the map frame, by the present estimate, [K, 3] m, m, rad."""
        return self._graph.poses

    @property
    def loop_closures(self) -> Sequence[LoopClosure]:
        """All loop closures that were attempted, accepted or not."""
        return self._loop_closer.attempted

    @property
    def odometry_contradictions(self) -> Sequence[OdometryContradiction]:
        """Motions that odometry and scan matching measured differently; the map follows the scans there."""
        return self._front_end.contradictions

    @property
    def pose_graph(self) -> PoseGraph:
        """The pose graph of keyframes and the constraints between them."""
        return self._graph.pose_graph()

    @property
    def pose(self) -> Pose:
        """base_link at the last scan in the map frame."""
        if not self._scan_poses:
            return IDENTITY
        last = self._scan_poses[-1]
        return self._graph.pose(last.keyframe) @ last.offset

    @property
    def trajectory(self) -> Trajectory:
        """base_link at each scan in the map frame, by the present estimate."""
        times = np.array([scan_pose.time for scan_pose in self._scan_poses])
        poses = [(self._graph.pose(keyframe) @ offset).as_array() for _, keyframe, offset in self._scan_poses]
        return Trajectory(times, np.array(poses).reshape(-1, 3))

    def grid(self, exclude: Floats = NO_DISCS) -> OccupancyGrid:
        """The map so far; see `wherry.mapping.slam.Slam.grid`."""
        return self._renderer.grid(self._graph.keyframes, self._graph.poses, exclude)

    def add(self, scan: Scan, odometry: Odometry | None = None) -> Pose:
        """Add a scan; see `wherry.mapping.slam.Slam.add`."""
        tracking = self._tracking
        if tracking is None:
            self._begin_tracking(scan, odometry, IDENTITY)
            return IDENTITY
        keyframes = len(self._graph)
        self._tracking, pose = self._front_end.track(tracking, scan, odometry)
        tracking = self._tracking
        if len(self._graph) > keyframes:
            self._loop_closer.close_loops(tracking)
        offset = pose.relative_to(tracking.keyframe_pose)
        self._scan_poses.append(ScanPose(scan.time, tracking.keyframe, offset))
        return self.pose

    def resume(self, scan: Scan, odometry: Odometry | None, pose: Pose) -> Pose:
        """Continue at a given pose, as at the beginning of another log; odometry may have been reset.

        Args:
            scan: The first scan there, later than all before.
            odometry: Odometry at the scan's time; None without odometry.
            pose: base_link in the map frame, see `wherry.mapping.scan_matching_localizer.locate_on_map`.

        Returns:
            base_link in the map frame, which is ``pose``.

        Raises:
            ValueError: There is no map yet.
        """
        if self._tracking is None:
            raise ValueError("there is no map to resume on before the first scan")
        nearest = self._graph.nearest(pose)
        submap = self._submaps.containing(nearest)
        from_nearest = pose.relative_to(self._graph.pose(nearest))
        from_submap = pose.relative_to(self._submap_pose(submap))
        self._submaps.connect_to_next(self._tracking.submap)
        keyframe = self._begin_tracking(scan, odometry, pose)
        self._graph.add_constraint(Constraint(nearest, keyframe, from_nearest, RESUME_COVARIANCE))
        self._submaps.add_constraint(Constraint(submap, len(self._submaps) - 1, from_submap, RESUME_COVARIANCE))
        return self.pose

    def finish(self) -> None:
        """Optimize with the loop closures that are pending; scans may be added afterwards."""
        self._loop_closer.optimize_pending()

    def _begin_tracking(self, scan: Scan, odometry: Odometry | None, pose: Pose) -> int:
        """Track the robot from a scan at a pose in the map frame on; return the keyframe there."""
        self._tracking = self._front_end.begin(scan, odometry, pose)
        keyframe = self._tracking.keyframe
        self._scan_poses.append(ScanPose(scan.time, keyframe, IDENTITY))
        return keyframe

    def _submap_pose(self, submap: int) -> Pose:
        """Pose of the submap with this index in the map frame."""
        return self._graph.pose(self._submaps[submap].origin)
