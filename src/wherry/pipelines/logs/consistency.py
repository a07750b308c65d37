"""Consistency of a map with the scans that it was made of: the only check that needs no reference."""

from __future__ import annotations

import numpy as np

from wherry.localization.agreement import ScanAgreement, mean_agreement, scan_agreement
from wherry.logs.lidar_log import LidarLog
from wherry.space.distance_field import DistanceField
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose

MIN_CONSISTENCY = 0.65  # below it a map is doubtful; 0.87 to 0.97 on right maps, at most 0.35 with a wrong mount
MAX_SCANS = 300  # scans that are compared, evenly spread over the log
MAX_DISTANCE = 1.0  # m, bound of the distances to obstacles


def map_consistency(grid: OccupancyGrid, log: LidarLog, poses: Floats) -> float | None:
    """Fraction of the beams that end on the map's obstacles, of those that end where the map is known.

    A map whose poses are wrong contradicts its own scans: walls are drawn beside each other, or erased by later beams.

    Args:
        grid: The map.
        log: The scans.
        poses: [N, 3] m, m, rad, base_link at the scans, map frame.

    Returns:
        The mean over the scans, 0 to 1; None without beams that end where the map is known.
    """
    field, known = DistanceField.of(grid, MAX_DISTANCE), ~grid.unknown
    agreements: list[ScanAgreement] = []
    for index in np.unique(np.linspace(0, len(poses) - 1, MAX_SCANS).astype(int)).tolist():
        ends = log.lidar.transform(log.deskewed(index).points())
        if len(ends):
            agreements.append(scan_agreement(field, known, ends, log.lidar, Pose.from_array(poses[index])))
    if not agreements:
        return None
    mean = mean_agreement(agreements)
    seen = mean.inlier_fraction + mean.blocked_fraction + mean.passed_fraction
    return mean.inlier_fraction / seen if seen > 0.0 else None
