"""Fit of a map to the scans that it was made of: the only check of a map that needs no reference."""

from __future__ import annotations

import numpy as np

from wherry.localization.agreement import ScanComparison
from wherry.localization.fit import MapFit
from wherry.logs.lidar_log import LidarLog
from wherry.space.distance_field import DistanceField
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose

MAX_SCANS = 300  # scans that are compared, evenly spread over the log
MAX_DISTANCE = 1.0  # m, bound of the distances to obstacles


def own_fit(grid: OccupancyGrid, log: LidarLog, poses: Floats) -> MapFit:
    """How well a log's scans fit the map that was made of them.

    A map whose poses are wrong contradicts its own scans: walls are drawn beside each other, or erased by later beams.

    Args:
        grid: The map.
        log: The scans.
        poses: [N, 3] m, m, rad, base_link at the scans, map frame.
    """
    comparison = ScanComparison(DistanceField.of(grid, MAX_DISTANCE), ~grid.unknown, log.lidar)
    fit = MapFit()
    for index in np.unique(np.linspace(0, len(poses) - 1, MAX_SCANS).astype(int)).tolist():
        ends = log.lidar.transform(log.deskewed(index).points())
        fit = fit.with_scan(comparison.agreement(ends, Pose.from_array(poses[index])))
    return fit
