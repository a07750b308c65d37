"""Graph SLAM: scans are matched to the submap around the robot, and loop closures correct the whole map.

The front end, in this module, matches each scan to the present submap, which optimization does not change; the back
end, `wherry.mapping.loop_closer`, moves the submaps relative to each other (Hess et al. 2016). The frame of a submap is
the base_link frame of its first keyframe, so all nodes of the pose graph are keyframes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wherry.mapping.constraints import Constraint
from wherry.mapping.covariances import regularized_inverse, rotate_covariance
from wherry.mapping.graph_snapshot import GraphSnapshot, ScanPose
from wherry.mapping.keyframe_graph import KeyframeGraph
from wherry.mapping.keyframes import Keyframe, MapRenderer
from wherry.mapping.loop_closer import LoopCloser
from wherry.mapping.loop_closure import LoopClosure
from wherry.mapping.motion_noise import CONSTANT_VELOCITY_NOISE, ODOMETRY_NOISE, MotionNoise, is_within
from wherry.mapping.point_cloud import PointCloud
from wherry.mapping.pose_graph import PoseGraph
from wherry.mapping.refinement import Refinement
from wherry.mapping.scan_matching import find_scan, match_covariance, track_scan
from wherry.mapping.settings import GraphSlamSettings
from wherry.mapping.submap_graph import SubmapGraph
from wherry.mapping.submaps import NO_COVARIANCE, MatchingGridCache
from wherry.mapping.tracking import TrackingState
from wherry.robot import Odometry, Scan
from wherry.space.occupancy import NO_DISCS, OccupancyGrid
from wherry.space.pose import IDENTITY, Floats, Pose
from wherry.space.trajectory import Trajectory

STILL_DISTANCE, STILL_ANGLE = 0.005, math.radians(0.2)  # m and rad, odometry below which a scan is not matched
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
        motion, noise = tracking.predict_motion(scan.time, odometry)
        pose = tracking.pose @ motion
        if odometry is None or not is_within(motion, STILL_DISTANCE, STILL_ANGLE):
            tracking = self._track(tracking, scan, odometry, motion, noise)
            self._tracking, pose = tracking, tracking.pose
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
        """Begin a submap with a scan at a pose in the map frame, and track the robot on it; return the keyframe."""
        keyframe = self._graph.add(Keyframe(scan, self._cloud(scan)), pose)
        self._submaps.begin(keyframe)
        submap = len(self._submaps) - 1
        self._tracking = replace(TrackingState.begin(scan.time, odometry), submap=submap, keyframe=keyframe)
        self._scan_poses.append(ScanPose(scan.time, keyframe, IDENTITY))
        return keyframe

    def _track(
        self, tracking: TrackingState, scan: Scan, odometry: Odometry | None, motion: Pose, noise: MotionNoise
    ) -> TrackingState:
        """Match a scan to the tracked submap; where the robot has moved far enough, make it a keyframe."""
        settings, cloud = self._settings, self._cloud(scan)
        grid = self._grids.grid_of(tracking.submap, self._submaps[tracking.submap])
        expected = tracking.pose @ motion
        since_keyframe = expected.relative_to(tracking.keyframe_pose)
        if is_within(since_keyframe, settings.keyframe_distance, settings.keyframe_angle):
            match = track_scan(grid, cloud, expected, motion, noise)
            return tracking.with_scan(scan.time, expected if match is None else match.pose, odometry)
        match = find_scan(grid, cloud, expected, motion, noise)
        placed = expected if match is None else match.pose
        self._graph.add(Keyframe(scan, cloud), self._submap_pose(tracking.submap) @ placed)
        tracking = self._constrain(tracking, scan.time, odometry, placed, match)
        tracking = self._submaps.extend(tracking, settings.submap_scans)
        self._loop_closer.close_loops(tracking)
        return tracking

    def _constrain(
        self, tracking: TrackingState, time: float, odometry: Odometry | None, placed: Pose, match: Refinement | None
    ) -> TrackingState:
        """Constrain the new keyframe, at ``placed`` on the tracked submap, by its match and by the motion to it."""
        keyframe, origin = len(self._graph) - 1, self._submaps[tracking.submap].origin
        information = NO_COVARIANCE
        if match is not None:
            information = rotate_covariance(match.information, -placed.theta)
            covariance = regularized_inverse(information) + match_covariance(placed)
            self._graph.add_constraint(Constraint(origin, keyframe, placed, covariance))
        noise = CONSTANT_VELOCITY_NOISE
        motion = None if match is not None else placed.relative_to(tracking.keyframe_pose)
        if tracking.keyframe_odometry is not None and odometry is not None:
            noise, motion = ODOMETRY_NOISE, odometry.pose.relative_to(tracking.keyframe_odometry.pose)
        if motion is not None:
            self._graph.add_constraint(Constraint(tracking.keyframe, keyframe, motion, noise.covariance(motion)))
        return tracking.with_scan(time, placed, odometry).with_keyframe(keyframe, noise, information)

    def _cloud(self, scan: Scan) -> PointCloud:
        """Points of a scan in the base_link frame."""
        return PointCloud.from_scan(scan, self._lidar, self._settings.range_limit)

    def _submap_pose(self, submap: int) -> Pose:
        """Pose of the submap with this index in the map frame."""
        return self._graph.pose(self._submaps[submap].origin)
