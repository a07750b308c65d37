"""Localization on a map that graph SLAM has made: scans are matched as in mapping, but nothing is added."""

from __future__ import annotations

import math

import numpy as np

from wherry.mapping.cloud import Cloud
from wherry.mapping.correlative import Window, correlate
from wherry.mapping.graph_slam import GraphSlam
from wherry.mapping.pieces import Front
from wherry.mapping.refinement import refine
from wherry.mapping.scan_matching import LEAST_POINTS, POINTS, find_scan
from wherry.mapping.slam import NO_DISCS
from wherry.mapping.submap import Submap
from wherry.robot import Odometry, Scan
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose
from wherry.space.trajectory import Trajectory

LEAST_RESPONSE = 0.5  # of the first scan on a map
MOST_RIVALRY = 0.9  # share of it that another place may have
AROUND, AROUND_ANGLE = 3.0, math.radians(45.0)  # m and rad to either side, where the first scan is sought


def whole_map(slam: GraphSlam) -> Submap:
    """Everything that graph SLAM has mapped as one submap, map frame."""
    whole = Submap()
    for keyscan, node in zip(slam.keyscans, slam.nodes, strict=True):
        whole.add(keyscan.cloud.seen_from(Pose.from_array(node)))
    return whole


def place_on_map(slam: GraphSlam, scan: Scan, start: Pose) -> Pose | None:
    """Where a scan was taken.

    Args:
        slam: What made the map; it is not changed.
        scan: The scan.
        start: base_link in the map frame, to within 3 m and 45°.

    Returns:
        base_link in the map frame; None if the scan fits nowhere around there, or in several places.
    """
    whole, cloud = whole_map(slam), Cloud.of(scan, slam.lidar, slam.settings.range_limit)
    if len(cloud.points) < LEAST_POINTS:
        return None
    window = Window(start, AROUND, AROUND_ANGLE)
    found = correlate(whole, cloud.thinned(POINTS).points, window, rivalry=MOST_RIVALRY)
    if found.response < LEAST_RESPONSE or found.rival > MOST_RIVALRY * found.response:
        return None
    return refine(whole, cloud, found.pose).pose


class MapLocalizer:
    """Follows the robot on a finished map: a `wherry.mapping.slam.Slam` whose map stays as it is.

    Args:
        slam: What made the map; it is read, never changed.
        start: base_link in the map frame; None for where mapping ended.
    """

    def __init__(self, slam: GraphSlam, start: Pose | None = None) -> None:
        self.pose = slam.pose if start is None else start
        self._slam = slam
        self._map = whole_map(slam)
        self._front: Front | None = None
        self._passed: list[tuple[float, Pose]] = []

    @property
    def trajectory(self) -> Trajectory:
        """Where the robot was at each scan since localization began."""
        poses = np.array([pose.as_array() for _, pose in self._passed]).reshape(-1, 3)
        return Trajectory(np.array([time for time, _ in self._passed]), poses)

    def grid(self, exclude: Floats = NO_DISCS) -> OccupancyGrid:
        """The map, as `GraphSlam.grid`."""
        return self._slam.grid(exclude)

    def add(self, scan: Scan, odometry: Odometry | None = None) -> Pose:
        """Take in a scan.

        Args:
            scan: Later than the one before.
            odometry: Of the scan's instant, if there is any.

        Returns:
            base_link in the map frame.
        """
        if self._front is None:
            self._front = Front.begin(scan.time, odometry).moved(scan.time, self.pose, odometry)
        movement, noise = self._front.expected_movement(scan.time, odometry)
        expected = self._front.pose @ movement
        cloud = Cloud.of(scan, self._slam.lidar, self._slam.settings.range_limit)
        match = find_scan(self._map, cloud, expected, movement, noise)
        self.pose = expected if match is None else match.pose
        self._front = self._front.moved(scan.time, self.pose, odometry)
        self._passed.append((scan.time, self.pose))
        return self.pose
