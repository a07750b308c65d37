"""Graph SLAM: scans are matched to the submap around the robot, and loop closures correct the whole map.

The front end places each scan on the present submap, which no optimization disturbs; the back end moves the submaps
(Hess et al. 2016). A submap has the frame of its first keyframe, so all nodes of the pose graph are keyframes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wherry.mapping.constraints import Constraint, ConstraintList
from wherry.mapping.covariances import invert, rotate_covariance, transform_covariance
from wherry.mapping.graph_snapshot import GraphSnapshot, ScanPose
from wherry.mapping.keyframes import Keyframe, MapRenderer
from wherry.mapping.loop_closure import LoopClosure, attempt_loop_closure, search_window
from wherry.mapping.matching_grid import MatchingGrid
from wherry.mapping.motion_prior import CONSTANT_VELOCITY, ODOMETRY, MotionNoise, is_within
from wherry.mapping.point_cloud import PointCloud, merge_clouds
from wherry.mapping.pose_graph import PoseGraph, optimized
from wherry.mapping.refinement import Refinement
from wherry.mapping.scan_matching import find_scan, match_covariance, track_scan
from wherry.mapping.settings import GraphSlamSettings
from wherry.mapping.slam import NO_DISCS
from wherry.mapping.submap_graph import SubmapGraph
from wherry.mapping.submaps import NO_COVARIANCE, MatchingGridCache
from wherry.mapping.tracking import TrackingState
from wherry.robot import Odometry, Scan
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import IDENTITY, Floats, Pose
from wherry.space.trajectory import Trajectory

STILL_DISTANCE, STILL_ANGLE = 0.005, math.radians(0.2)  # m and rad, odometry below which a scan is not matched
CLOSURE_COVARIANCE = np.diag([0.02**2, 0.02**2, math.radians(0.3) ** 2])  # m, m, rad, added to that of the points
RESUME_COVARIANCE = np.diag([0.05**2, 0.05**2, math.radians(1.0) ** 2])  # m, m, rad, of a pose to resume at
CLOSURE_CELL_SIZE = 0.1  # m, side of a cell that keeps one point of the clouds that are matched together
# A closure that moves the map by more than this (m and rad) is optimized at once; this many smaller ones may wait.
MAX_DEFERRED_DISTANCE, MAX_DEFERRED_ANGLE = 0.05, math.radians(0.5)
MAX_DEFERRED_CLOSURES = 10


class GraphSlam:
    """Graph SLAM, as in `wherry.mapping.slam.Slam`.

    Args:
        lidar: Pose of the lidar in the base_link frame.
        settings: Settings of the method.
    """

    def __init__(self, lidar: Pose = IDENTITY, settings: GraphSlamSettings | None = None) -> None:
        self._settings = settings or GraphSlamSettings()
        self._lidar = lidar
        self._keyframes: list[Keyframe] = []
        self._keyframe_poses = np.zeros((0, 3))
        self._constraints = ConstraintList()
        self._submaps = SubmapGraph()
        self._tracking: TrackingState | None = None
        self._scan_poses: list[ScanPose] = []
        self._loop_closures: list[LoopClosure] = []
        self._pending_closures = 0
        self._grids = MatchingGridCache(self._keyframes)
        self._renderer = MapRenderer(
            lidar, self._settings.resolution, self._settings.range_limit, self._settings.empty_range
        )

    @classmethod
    def from_snapshot(cls, snapshot: GraphSnapshot) -> GraphSlam:
        """Graph SLAM that continues from a snapshot, as if it had never stopped."""
        slam = cls(snapshot.lidar, snapshot.settings)
        slam._keyframes.extend(snapshot.keyframes)
        slam._keyframe_poses = snapshot.keyframe_poses.copy()
        slam._constraints = snapshot.constraints.copy()
        submaps = [submap.copy() for submap in snapshot.submaps]
        slam._submaps = SubmapGraph(submaps, snapshot.submap_constraints.copy())
        slam._tracking = snapshot.tracking
        slam._scan_poses = list(snapshot.scan_poses)
        slam._loop_closures = list(snapshot.loop_closures)
        slam._pending_closures = snapshot.pending_closures
        return slam

    def snapshot(self) -> GraphSnapshot:
        """The whole state; later scans do not change it."""
        return GraphSnapshot(
            self._lidar,
            self._settings,
            tuple(self._keyframes),
            self._keyframe_poses.copy(),
            self._constraints.copy(),
            tuple(submap.copy() for submap in self._submaps.submaps),
            self._submaps.constraints.copy(),
            self._tracking,
            tuple(self._scan_poses),
            tuple(self._loop_closures),
            self._pending_closures,
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
        return self._keyframes

    @property
    def keyframe_poses(self) -> Floats:
        """base_link at each keyframe in the map frame, by the present estimate, [K, 3] m, m, rad."""
        return self._keyframe_poses

    @property
    def loop_closures(self) -> Sequence[LoopClosure]:
        """All loop closures that were attempted, accepted or not."""
        return self._loop_closures

    @property
    def pose_graph(self) -> PoseGraph:
        """The pose graph of keyframes and the constraints between them."""
        constraints = self._constraints
        information = invert(constraints.covariances)
        return PoseGraph(self._keyframe_poses, constraints.ends, constraints.measured, information, constraints.robust)

    @property
    def pose(self) -> Pose:
        """base_link at the last scan in the map frame."""
        if not self._scan_poses:
            return IDENTITY
        last = self._scan_poses[-1]
        return self._keyframe_pose(last.keyframe) @ last.offset

    @property
    def trajectory(self) -> Trajectory:
        """base_link at each scan in the map frame, by the present estimate."""
        times = np.array([scan_pose.time for scan_pose in self._scan_poses])
        poses = [(self._keyframe_pose(keyframe) @ offset).as_array() for _, keyframe, offset in self._scan_poses]
        return Trajectory(times, np.array(poses).reshape(-1, 3))

    def grid(self, exclude: Floats = NO_DISCS) -> OccupancyGrid:
        """The map so far; see `wherry.mapping.slam.Slam.grid`."""
        return self._renderer.grid(self._keyframes, self._keyframe_poses, exclude)

    def add(self, scan: Scan, odometry: Odometry | None = None) -> Pose:
        """Add a scan; see `wherry.mapping.slam.Slam.add`."""
        tracking = self._tracking
        if tracking is None:
            return self._begin(scan, odometry)
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
            The same pose.

        Raises:
            ValueError: There is no map yet.
        """
        if self._tracking is None:
            raise ValueError("there is no map to resume on before the first scan")
        last, keyframe = len(self._submaps) - 1, len(self._keyframes)
        if self._tracking.submap < last:  # no scan will complete the submap any more
            self._submaps.connect_to_next(self._tracking.submap)
        nearest = int(np.hypot(*(self._keyframe_poses[:, :2] - pose.as_array()[:2]).T).argmin())
        around = self._submaps.containing(nearest)
        offset = pose.relative_to(self._keyframe_pose(nearest))
        self._constraints.append(Constraint(nearest, keyframe, offset, RESUME_COVARIANCE))
        offset = pose.relative_to(self._keyframe_pose(self._submaps[around].origin))
        self._submaps.add_constraint(Constraint(around, last + 1, offset, RESUME_COVARIANCE))
        self._add_keyframe(scan, PointCloud.from_scan(scan, self._lidar, self._settings.range_limit), pose)
        self._submaps.begin(keyframe)
        self._tracking = replace(TrackingState.begin(scan.time, odometry), submap=last + 1, keyframe=keyframe)
        self._scan_poses.append(ScanPose(scan.time, keyframe, IDENTITY))
        return self.pose

    def finish(self) -> None:
        """Optimize with the loop closures that are pending; scans may be added afterwards."""
        if self._pending_closures:
            self._optimize()

    def _begin(self, scan: Scan, odometry: Odometry | None) -> Pose:
        """Add the first scan, whose pose is the map's origin."""
        self._add_keyframe(scan, PointCloud.from_scan(scan, self._lidar, self._settings.range_limit), IDENTITY)
        self._submaps.begin(0)
        self._tracking = TrackingState.begin(scan.time, odometry)
        self._scan_poses.append(ScanPose(scan.time, 0, IDENTITY))
        return IDENTITY

    def _track(
        self, tracking: TrackingState, scan: Scan, odometry: Odometry | None, motion: Pose, noise: MotionNoise
    ) -> TrackingState:
        """Match a scan to the tracked submap; where the robot has moved far enough, make it a keyframe."""
        settings = self._settings
        cloud = PointCloud.from_scan(scan, self._lidar, settings.range_limit)
        grid, expected = self._grid_of(tracking.submap), tracking.pose @ motion
        since_keyframe = expected.relative_to(tracking.keyframe_pose)
        if is_within(since_keyframe, settings.keyframe_distance, settings.keyframe_angle):
            match = track_scan(grid, cloud, expected, motion, noise)
            return tracking.with_scan(scan.time, expected if match is None else match.pose, odometry)
        match = find_scan(grid, cloud, expected, motion, noise)
        placed = expected if match is None else match.pose
        self._add_keyframe(scan, cloud, self._submap_pose(tracking.submap) @ placed)
        tracking = self._constrain(tracking, scan.time, odometry, placed, match)
        tracking = self._extend_submaps(tracking)
        if settings.close_loops and tracking.keyframe % settings.closure_every == 0 and self._has_moved_on():
            self._search_loop_closures(tracking)
        return tracking

    def _add_keyframe(self, scan: Scan, cloud: PointCloud, pose: Pose) -> None:
        """Add a node to the pose graph, at a pose in the map frame."""
        self._keyframes.append(Keyframe(scan, cloud))
        self._keyframe_poses = np.vstack([self._keyframe_poses, pose.as_array()])

    def _constrain(
        self, tracking: TrackingState, time: float, odometry: Odometry | None, placed: Pose, match: Refinement | None
    ) -> TrackingState:
        """Add the constraints of the new keyframe, placed on the tracked submap: of its match, and of its motion."""
        keyframe, origin = len(self._keyframes) - 1, self._submaps[tracking.submap].origin
        information = NO_COVARIANCE
        if match is not None:
            information = rotate_covariance(match.information, -placed.theta)
            covariance = _regularized_inverse(information) + match_covariance(placed)
            self._constraints.append(Constraint(origin, keyframe, placed, covariance))
        noise = CONSTANT_VELOCITY
        motion = None if match is not None else placed.relative_to(tracking.keyframe_pose)
        if tracking.keyframe_odometry is not None and odometry is not None:
            noise, motion = ODOMETRY, odometry.pose.relative_to(tracking.keyframe_odometry.pose)
        if motion is not None:
            self._constraints.append(Constraint(tracking.keyframe, keyframe, motion, noise.covariance(motion)))
        return tracking.with_scan(time, placed, odometry).with_keyframe(keyframe, noise, information)

    def _extend_submaps(self, tracking: TrackingState) -> TrackingState:
        """Add the last keyframe to the tracked submap and to the next one, and track that once this one is full."""
        submap, keyframe, pose = self._submaps[tracking.submap], tracking.keyframe, tracking.keyframe_pose
        submap.members.append((keyframe, pose))
        is_full = len(submap.members) >= self._settings.submap_scans
        if tracking.submap < len(self._submaps) - 1:
            following = self._submaps[tracking.submap + 1]
            following.members.append((keyframe, pose.relative_to(following.start)))
            if is_full:
                self._submaps.connect_to_next(tracking.submap)
                return tracking.on_next_submap(following.start)
        elif len(submap.members) >= self._settings.submap_scans // 2:
            self._submaps.begin(keyframe, pose, tracking.covariance)
            return replace(tracking, next_covariance=NO_COVARIANCE)
        return tracking

    def _has_moved_on(self) -> bool:
        """Whether the robot has moved half a window since a search failed; before, a search would fail again."""
        if not self._loop_closures or self._loop_closures[-1].is_accepted:
            return True
        last = self._loop_closures[-1]
        steps = np.diff(self._keyframe_poses[last.keyframe :, :2], axis=0)
        return float(np.hypot(steps[:, 0], steps[:, 1]).sum()) >= last.window / 2.0

    def _search_loop_closures(self, tracking: TrackingState) -> None:
        """Try to close loops from the last keyframe to the submaps that it may be in."""
        candidates = self._submaps.candidates(tracking, self._keyframe_poses)
        if not candidates:
            return
        surroundings = self._surroundings(tracking.keyframe)
        for index, covariance in candidates[: self._settings.closure_candidates]:
            target = self._submaps[index].origin
            expected = self._keyframe_pose(tracking.keyframe).relative_to(self._keyframe_pose(target))
            window = search_window(expected, covariance)
            closure = attempt_loop_closure(
                tracking.time, tracking.keyframe, target, self._grid_of(index), surroundings, window
            )
            self._loop_closures.append(closure)
            if closure.is_accepted:
                self._add_loop_closure(tracking, index, closure)
                moved = closure.measured.relative_to(expected)
                is_small = is_within(moved, MAX_DEFERRED_DISTANCE, MAX_DEFERRED_ANGLE)
                if self._pending_closures >= MAX_DEFERRED_CLOSURES or not is_small:
                    self._optimize()

    def _surroundings(self, keyframe: int) -> PointCloud:
        """The clouds of a keyframe and the ones before it, in its base_link frame."""
        here = self._keyframe_pose(keyframe)
        recent = range(max(keyframe + 1 - self._settings.closure_scans, 0), keyframe + 1)
        clouds = [self._keyframes[k].cloud.transformed(self._keyframe_pose(k).relative_to(here)) for k in recent]
        return merge_clouds(clouds, CLOSURE_CELL_SIZE)

    def _add_loop_closure(self, tracking: TrackingState, submap: int, closure: LoopClosure) -> None:
        """Add the constraints of an accepted closure between the last keyframe and a submap."""
        information = rotate_covariance(closure.information, -closure.measured.theta)
        covariance = _regularized_inverse(information) + CLOSURE_COVARIANCE
        self._constraints.append(
            Constraint(closure.target, closure.keyframe, closure.measured, covariance, is_robust=True)
        )
        measured = closure.measured @ tracking.keyframe_pose.inverse
        covariance = transform_covariance(covariance, tracking.keyframe_pose)
        self._submaps.add_constraint(Constraint(submap, tracking.submap, measured, covariance))
        self._pending_closures += 1

    def _optimize(self) -> None:
        """Move the keyframes to the poses that agree best with all constraints."""
        self._pending_closures = 0
        self._keyframe_poses = optimized(self.pose_graph).poses

    def _grid_of(self, submap: int) -> MatchingGrid:
        """The matching grid of the submap with this index."""
        return self._grids.grid_of(submap, self._submaps[submap])

    def _submap_pose(self, submap: int) -> Pose:
        """Pose of the submap with this index in the map frame."""
        return self._keyframe_pose(self._submaps[submap].origin)

    def _keyframe_pose(self, keyframe: int) -> Pose:
        """base_link at the keyframe with this index, in the map frame."""
        return Pose.from_array(self._keyframe_poses[keyframe])


def _regularized_inverse(information: Floats) -> Floats:
    """Covariance of an information matrix [3, 3] that may be singular."""
    return invert(information + np.eye(3))
