"""What a map and its trajectory say about their own quality, without a reference."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wherry.localization.agreement import ScanComparison
from wherry.localization.fit import MapFit
from wherry.logs.lidar_log import LidarLog
from wherry.pipelines.logs.motion_check import compare_motions
from wherry.space.distance_field import DistanceField
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose

MAX_SCANS = 300  # scans that are compared with the map, evenly spread over the log
MAX_DISTANCE = 1.0  # m, bound of the distances to obstacles


@dataclass(frozen=True, slots=True)
class MapQuality:
    """The quality of a map by its own scans and odometry.

    Attributes:
        fit: How well the scans fit the map that was made of them, 0 to 1; see `localization.fit.MapFit`.
        doubt: Why the map or the headings of its trajectory are probably wrong; empty if they are not.
        notes: What else is probably wrong, for people.
    """

    fit: float
    doubt: str
    notes: tuple[str, ...]

    @property
    def is_doubtful(self) -> bool:
        """Whether the map is probably wrong."""
        return bool(self.doubt)

    @classmethod
    def of(cls, grid: OccupancyGrid, log: LidarLog, poses: Floats) -> MapQuality:
        """The quality of a map.

        Args:
            grid: The map.
            log: The scans and their odometry.
            poses: [N, 3] m, m, rad, base_link at the scans, map frame.
        """
        fit, motion = own_fit(grid, log, poses), compare_motions(poses, log.scan_odometry)
        lidar_doubt = motion.doubt(log.lidar)
        if motion.is_wrong:
            return cls(fit.value, lidar_doubt, ())
        doubt = "" if fit.is_fitting else f"its own scans do not fit it (fit {fit.value:.2f})"
        return cls(fit.value, doubt, (lidar_doubt,) if lidar_doubt else ())


def own_fit(grid: OccupancyGrid, log: LidarLog, poses: Floats) -> MapFit:
    """How well scans fit the map that was made of them, with the arguments of `MapQuality.of`.

    A map whose poses are wrong contradicts its own scans: walls are drawn beside each other, or erased by later beams.
    """
    comparison = ScanComparison(DistanceField.of(grid, MAX_DISTANCE), ~grid.unknown, log.lidar)
    fit = MapFit()
    for index in np.unique(np.linspace(0, len(poses) - 1, MAX_SCANS).astype(int)).tolist():
        ends = log.lidar.transform(log.deskewed(index).points())
        fit = fit.with_scan(comparison.agreement(ends, Pose.from_array(poses[index])))
    return fit
