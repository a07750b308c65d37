"""The front end of graph SLAM: matches scans to the present submap, and checks odometry by the matches."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from wherry.mapping.constraints import Constraint
from wherry.mapping.covariances import regularized_inverse, rotate_covariance
from wherry.mapping.keyframe_graph import KeyframeGraph
from wherry.mapping.keyframes import Keyframe
from wherry.mapping.motion_noise import ODOMETRY_NOISE, constant_velocity_noise, is_within
from wherry.mapping.odometry_check import (
    MAX_BIAS,
    OdometryContradiction,
    is_contradicted,
    is_determined,
    is_plausible,
    normalized_error,
)
from wherry.mapping.placement import PlacedScan, Placement, Prediction, ScanPlacer
from wherry.mapping.point_cloud import PointCloud
from wherry.mapping.scan_matching import MIN_POINTS, match_covariance
from wherry.mapping.settings import GraphSlamSettings
from wherry.mapping.submap_graph import SubmapGraph
from wherry.mapping.submaps import NO_COVARIANCE, MatchingGridCache
from wherry.mapping.tracking import TrackingState
from wherry.mapping.visibility import ScanView
from wherry.robot import Odometry, Scan
from wherry.space.pose import Pose

STILL_DISTANCE, STILL_ANGLE = 0.005, math.radians(0.2)  # m and rad, odometry below which the robot stands still
# Matches (m and rad) this near to the last pose do not contradict odometry that measures no motion.
STILL_MATCH_DISTANCE, STILL_MATCH_ANGLE = 0.02, math.radians(0.5)


class FrontEnd:
    """Tracks the robot on submaps, and adds keyframes to them and to the pose graph.

    Args:
        lidar: Pose of the lidar in the base_link frame.
        settings: Settings of graph SLAM.
        graph: The pose graph of keyframes.
        submaps: The graph of submaps.
        grids: Matching grids of the submaps.
        contradictions: Contradictions between odometry and scan matching so far.
    """

    def __init__(
        self,
        lidar: Pose,
        settings: GraphSlamSettings,
        graph: KeyframeGraph,
        submaps: SubmapGraph,
        grids: MatchingGridCache,
        contradictions: Iterable[OdometryContradiction] = (),
    ) -> None:
        self._lidar = lidar
        self._settings = settings
        self._graph = graph
        self._submaps = submaps
        self._grids = grids
        self._contradictions = list(contradictions)
        self._views: dict[int, ScanView] = {}  # the view of the last keyframe, by its index

    @property
    def contradictions(self) -> Sequence[OdometryContradiction]:
        """All contradictions between odometry and scan matching."""
        return self._contradictions

    def begin(self, scan: Scan, odometry: Odometry | None, pose: Pose) -> TrackingState:
        """Begin a submap with a scan at a pose in the map frame, and track the robot on it."""
        keyframe = self._graph.add(Keyframe(scan, self._cloud(scan)), pose)
        self._submaps.begin(keyframe)
        return replace(TrackingState.begin(scan.time, odometry), submap=len(self._submaps) - 1, keyframe=keyframe)

    def track(self, tracking: TrackingState, scan: Scan, odometry: Odometry | None) -> tuple[TrackingState, Pose]:
        """Place a scan on the tracked submap; where the robot has moved far enough, make it a keyframe.

        Returns:
            The next state, and base_link at the scan in the frame of the submap that it tracks.
        """
        cloud = self._cloud(scan)
        predictions = tracking.predictions(scan.time, odometry)
        expected = tracking.pose @ predictions[0].motion
        is_by_odometry = predictions[0].is_by_odometry
        is_near = self._is_near_keyframe(tracking, expected)
        reference = self._reference(tracking)
        grid = self._grids.grid_of(tracking.submap, self._submaps[tracking.submap])
        view = ScanView.from_scan(scan, cloud, self._lidar)
        placer = ScanPlacer(grid, cloud, view, reference, tracking.pose)
        placement = placer.place(predictions, is_tracked=is_near and predictions[0].is_precise)
        if is_by_odometry and _stands_still(tracking, placement, predictions[0]):
            return tracking.standing_still(scan.time), expected
        if len(cloud.points) < MIN_POINTS and not is_by_odometry:
            return tracking.without_match(scan.time), expected
        if placement.prediction is not predictions[0]:
            is_near = self._is_near_keyframe(tracking, placement.pose)
        tracking = self._checked(tracking, scan.time, odometry, placement)
        is_first_view = not reference.has_points and len(cloud.points) >= MIN_POINTS
        if is_near and not is_first_view:
            tracking = tracking.with_scan(scan.time, placement.pose, odometry)
        else:
            keyframe = self._graph.add(Keyframe(scan, cloud), self._submap_pose(tracking.submap) @ placement.pose)
            self._views = {keyframe: view}
            tracking = self._constrain(tracking, scan.time, odometry, placement)
            tracking = self._submaps.extend(tracking, self._settings.submap_scans)
        return tracking, tracking.pose

    def _is_near_keyframe(self, tracking: TrackingState, pose: Pose) -> bool:
        """Whether a pose on the tracked submap is too near to the last keyframe for another one."""
        since_keyframe = pose.relative_to(tracking.keyframe_pose)
        return is_within(since_keyframe, self._settings.keyframe_distance, self._settings.keyframe_angle)

    def _reference(self, tracking: TrackingState) -> PlacedScan:
        """The last keyframe with points on the tracked submap, which scans must be consistent with."""
        members = self._submaps[tracking.submap].members
        with_points = (
            member for member in reversed(members) if len(self._graph.keyframes[member[0]].cloud.points) >= MIN_POINTS
        )
        index, pose = next(with_points, members[-1])
        if index not in self._views:
            keyframe = self._graph.keyframes[index]
            self._views = {index: ScanView.from_scan(keyframe.scan, keyframe.cloud, self._lidar)}
        return PlacedScan(self._views[index], pose)

    def _checked(
        self, tracking: TrackingState, time: float, odometry: Odometry | None, placement: Placement
    ) -> TrackingState:
        """The state after odometry since the last scan was compared with the placement of a scan."""
        if tracking.odometry_motion(odometry) is None:
            return tracking.without_keyframe_odometry()
        contradiction = find_contradiction(tracking, time, odometry, placement)
        if contradiction is None:
            return tracking
        self._contradictions.append(contradiction)
        return tracking.contradicted()

    def _constrain(
        self, tracking: TrackingState, time: float, odometry: Odometry | None, placement: Placement
    ) -> TrackingState:
        """Constrain the new keyframe, placed on the tracked submap, by its match and by the motion to it."""
        keyframe, origin = len(self._graph) - 1, self._submaps[tracking.submap].origin
        placed, match = placement.pose, placement.match
        information = NO_COVARIANCE
        if match is not None:
            information = rotate_covariance(match.information, -placed.theta)
            covariance = regularized_inverse(information) + match_covariance(placed)
            self._graph.add_constraint(Constraint(origin, keyframe, placed, covariance))
        tracking, measured = self._keyframe_odometry(tracking, time, odometry, placement)
        noise = constant_velocity_noise(time - tracking.time) if measured is None else ODOMETRY_NOISE
        motion = placed.relative_to(tracking.keyframe_pose) if measured is None else measured
        if measured is not None or match is None:
            self._graph.add_constraint(Constraint(tracking.keyframe, keyframe, motion, noise.covariance(motion)))
        return tracking.with_scan(time, placed, odometry).with_keyframe(keyframe, noise, information)

    def _keyframe_odometry(
        self, tracking: TrackingState, time: float, odometry: Odometry | None, placement: Placement
    ) -> tuple[TrackingState, Pose | None]:
        """The state after odometry since the last keyframe was checked, and its motion.

        The motion is None if odometry is missing, contradicted or not trusted.
        """
        if tracking.keyframe_odometry is None or odometry is None:
            return tracking, None
        measured = odometry.pose.relative_to(tracking.keyframe_odometry.pose)
        motion = placement.pose.relative_to(tracking.keyframe_pose)
        is_informative = placement.match is not None and is_determined(placement.match)
        is_outlier = _contradicts(placement, measured, motion)
        if is_informative and not is_outlier:  # the mean error would outlast an outlier
            tracking = tracking.with_odometry_error(normalized_error(measured, motion), motion)
        if is_outlier or np.linalg.norm(tracking.odometry_bias) > MAX_BIAS:
            since = self._graph.keyframes[tracking.keyframe].scan.time
            self._contradictions.append(OdometryContradiction(time, since, measured, motion))
            return tracking.contradicted(), None
        if is_informative:
            tracking = tracking.agreed()
        return tracking, measured if tracking.is_odometry_trusted else None

    def _cloud(self, scan: Scan) -> PointCloud:
        """Points of a scan in the base_link frame."""
        return PointCloud.from_scan(scan, self._lidar, self._settings.range_limit)

    def _submap_pose(self, submap: int) -> Pose:
        """Pose of the submap with this index in the map frame."""
        return self._graph.pose(self._submaps[submap].origin)


def _stands_still(tracking: TrackingState, placement: Placement, prediction: Prediction) -> bool:
    """Whether odometry measures no motion, and the placement of the scan does not contradict it."""
    if not is_within(prediction.motion, STILL_DISTANCE, STILL_ANGLE) or placement.prediction is not prediction:
        return False
    return is_within(placement.pose.relative_to(tracking.pose), STILL_MATCH_DISTANCE, STILL_MATCH_ANGLE)


def find_contradiction(
    tracking: TrackingState, time: float, odometry: Odometry | None, placement: Placement
) -> OdometryContradiction | None:
    """The contradiction between odometry since the last scan and the placement of a scan; None if there is none.

    Args:
        tracking: The state after the last scan.
        time: Time of the scan, s.
        odometry: Odometry at the scan; None without odometry.
        placement: The scan on the grid that is tracked.
    """
    measured = tracking.odometry_motion(odometry)
    if measured is None:
        return None
    motion = placement.pose.relative_to(tracking.pose)
    is_implausible = placement.match is None and not is_plausible(measured, time - tracking.scan_time)
    if is_implausible or _contradicts(placement, measured, motion):
        return OdometryContradiction(time, tracking.scan_time, measured, motion)
    return None


def _contradicts(placement: Placement, measured: Pose, motion: Pose) -> bool:
    """Whether the placement at the end of a motion contradicts the motion that odometry measured."""
    if placement.match is None or not placement.is_verified:
        return False
    return is_contradicted(measured, motion, placement.match)
