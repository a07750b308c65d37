"""Localization on a map that graph SLAM has made: scans are matched as in mapping, but nothing is added."""

from __future__ import annotations

from wherry.mapping.cloud import Cloud
from wherry.mapping.graph_slam import GraphSlam
from wherry.mapping.pieces import Front
from wherry.mapping.scan_matching import find_scan
from wherry.mapping.submap import Submap
from wherry.robot import Odometry, Scan
from wherry.space.pose import Pose


class MapLocalizer:
    """Follows the robot on a finished map.

    Args:
        slam: What made the map; it is read, never changed.
        start: base_link in the map frame; None for where mapping ended.
    """

    def __init__(self, slam: GraphSlam, start: Pose | None = None) -> None:
        self.pose = slam.pose if start is None else start
        self._lidar = slam.lidar
        self._range_limit = slam.settings.range_limit
        self._map = Submap()
        for keyscan, node in zip(slam.keyscans, slam.nodes, strict=True):
            self._map.add(keyscan.cloud.seen_from(Pose.from_array(node)))
        self._front: Front | None = None

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
        match = find_scan(self._map, Cloud.of(scan, self._lidar, self._range_limit), expected, movement, noise)
        self.pose = expected if match is None else match.pose
        self._front = self._front.moved(scan.time, self.pose, odometry)
        return self.pose
