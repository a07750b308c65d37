"""Localization on the map of graph SLAM: scans are matched as in mapping, but the map does not change."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from wherry.mapping.correlative import SearchWindow, correlate
from wherry.mapping.front_end import find_contradiction
from wherry.mapping.graph_slam import GraphSlam
from wherry.mapping.graph_snapshot import GraphSnapshot
from wherry.mapping.loop_closure import LoopClosure
from wherry.mapping.matching_grid import MatchingGrid
from wherry.mapping.motion_noise import ODOMETRY_NOISE
from wherry.mapping.odometry_check import OdometryContradiction, is_determined
from wherry.mapping.placement import PlacedScan, Placement, ScanPlacer
from wherry.mapping.point_cloud import PointCloud
from wherry.mapping.refinement import refine
from wherry.mapping.scan_matching import MIN_POINTS, SEARCH_POINTS, find_scan
from wherry.mapping.tracking import TrackingState
from wherry.mapping.visibility import ScanView
from wherry.robot import Odometry, Scan
from wherry.space.occupancy import NO_DISCS, OccupancyGrid
from wherry.space.pose import IDENTITY, Floats, Pose
from wherry.space.trajectory import Trajectory

MIN_SCORE = 0.5  # mean likelihood of the first scan's points below which it is not located
MAX_SECOND_BEST = 0.9  # share of the best score that another peak may reach
START_DISTANCE, START_ANGLE = 3.0, math.radians(45.0)  # m and rad, extent of the first scan's search to either side


def _matching_grid(slam: GraphSlam) -> MatchingGrid:
    """One matching grid of all keyframes, in the map frame."""
    grid = MatchingGrid()
    for keyframe, pose in zip(slam.keyframes, slam.keyframe_poses, strict=True):
        grid.add(keyframe.cloud.transformed(Pose.from_array(pose)))
    return grid


def locate_on_map(slam: GraphSlam, scan: Scan, start: Pose) -> Pose | None:
    """Find the pose at which a scan was taken.

    Args:
        slam: The map, which is not changed.
        scan: The scan.
        start: Approximate base_link in the map frame, to within 3 m and 45°.

    Returns:
        base_link in the map frame; None if the scan fits at no pose near ``start``, or at several.
    """
    grid, cloud = _matching_grid(slam), PointCloud.from_scan(scan, slam.lidar, slam.settings.range_limit)
    if len(cloud.points) < MIN_POINTS:
        return None
    window = SearchWindow(start, START_DISTANCE, START_ANGLE)
    found = correlate(grid, cloud.subsampled(SEARCH_POINTS).points, window, second_best_share=MAX_SECOND_BEST)
    if found.score < MIN_SCORE or found.second_best_score > MAX_SECOND_BEST * found.score:
        return None
    return refine(grid, cloud, found.pose).pose


class ScanMatchingLocalizer:
    """Tracks the robot on a finished map, as a `wherry.mapping.slam.Slam` that never changes its map.

    Args:
        slam: The map, which is not changed.
        start: base_link in the map frame; None for the last pose of the map.
    """

    def __init__(self, slam: GraphSlam, start: Pose | None = None) -> None:
        self._slam = slam
        self._pose = slam.pose if start is None else start
        self._map = _matching_grid(slam)
        self._tracking: TrackingState | None = None
        self._last: PlacedScan | None = None  # the last scan with points
        self._contradictions: list[OdometryContradiction] = []
        self._poses: list[tuple[float, Pose]] = []

    @property
    def pose(self) -> Pose:
        """base_link at the last scan in the map frame."""
        return self._pose

    @property
    def trajectory(self) -> Trajectory:
        """base_link at each scan since localization began, in the map frame."""
        poses = np.array([pose.as_array() for _, pose in self._poses]).reshape(-1, 3)
        return Trajectory(np.array([time for time, _ in self._poses]), poses)

    @property
    def keyframe_poses(self) -> Floats:
        """base_link at each keyframe of the map, [K, 3] m, m, rad."""
        return self._slam.keyframe_poses

    @property
    def loop_closures(self) -> Sequence[LoopClosure]:
        """Empty, since the map does not change."""
        return ()

    @property
    def odometry_contradictions(self) -> Sequence[OdometryContradiction]:
        """Motions that odometry and scan matching measured differently; the poses follow the scans there."""
        return self._contradictions

    def snapshot(self) -> GraphSnapshot | None:
        """None, since there is nothing new to save."""
        return None

    def finish(self) -> None:
        """See `wherry.mapping.slam.Slam.finish`; nothing is ever pending."""

    def grid(self, exclude: Floats = NO_DISCS) -> OccupancyGrid:
        """The map; see `GraphSlam.grid`."""
        return self._slam.grid(exclude)

    def add(self, scan: Scan, odometry: Odometry | None = None) -> Pose:
        """Localize one scan.

        Args:
            scan: A scan later than the one before.
            odometry: Odometry at the scan's time; None without odometry.

        Returns:
            base_link in the map frame.
        """
        cloud = PointCloud.from_scan(scan, self._slam.lidar, self._slam.settings.range_limit)
        view = ScanView.from_scan(scan, cloud, self._slam.lidar)
        tracking = self._tracking
        if tracking is None or self._last is None:
            tracking = TrackingState.begin(scan.time, odometry).with_scan(scan.time, self._pose, odometry)
            match = find_scan(self._map, cloud, self._pose, IDENTITY, ODOMETRY_NOISE)
            self._pose = self._pose if match is None else match.pose
        else:
            placer = ScanPlacer(self._map, cloud, view, self._last, tracking.pose)
            placement = placer.place(tracking.predictions(scan.time, odometry), is_tracked=False)
            tracking = self._checked(tracking, scan.time, odometry, placement)
            self._pose = placement.pose
        if len(cloud.points) >= MIN_POINTS:
            self._last = PlacedScan(view, self._pose)
        self._tracking = tracking.with_scan(scan.time, self._pose, odometry)
        self._poses.append((scan.time, self._pose))
        return self._pose

    def _checked(
        self, tracking: TrackingState, time: float, odometry: Odometry | None, placement: Placement
    ) -> TrackingState:
        """The state after odometry since the last scan was compared with the placement of a scan."""
        contradiction = find_contradiction(tracking, time, odometry, placement)
        if contradiction is not None:
            self._contradictions.append(contradiction)
            return tracking.contradicted()
        return tracking if placement.match is None or not is_determined(placement.match) else tracking.agreed()
