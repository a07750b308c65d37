"""Processor time per scan, compared with yag_slam (Karto's matcher for Python) if it is installed."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from wherry.logs.lidar_log import LidarLog
from wherry.logs.reading import read_log
from wherry.mapping.methods import SLAM_METHODS
from wherry.pipelines.logs.mapping import MappingSettings, run


def measure_own(log: Path) -> Mapping[str, float]:
    """Map a log with each of wherry's methods.

    Args:
        log: The lidar log.

    Returns:
        Median processor time per scan of each method, ms.

    Raises:
        InputError: The log cannot be used.
    """
    return {backend: run(MappingSettings(log, backend=backend)).ms_per_scan_median for backend in SLAM_METHODS}


def measure_external(log: Path) -> Mapping[str, float]:
    """Map a log with the external methods that are installed.

    Args:
        log: The lidar log.

    Returns:
        Median processor time of a scan by method, ms.
    """
    if importlib.util.find_spec("yag_slam") is None:
        return {}
    return {"yag_slam": _yag_slam(read_log(log))}


def _yag_slam(log: LidarLog) -> float:
    """Median processor time per scan of yag_slam with its default settings, ms."""
    from yag_slam.graph_slam import GraphSlam, default_config, default_config_loop  # noqa: PLC0415
    from yag_slam.models import LocalizedRangeScan  # noqa: PLC0415
    from yag_slam.scan_matching import Scan2DMatcherCpp  # noqa: PLC0415

    slam = GraphSlam(Scan2DMatcherCpp(default_config), Scan2DMatcherCpp(default_config_loop))
    taken = []
    for scan, odometry in zip(log.scans, log.scan_odometry, strict=True):
        if odometry is None:
            continue
        lidar = odometry.pose @ log.lidar
        last = scan.angle_min + scan.angle_increment * (len(scan.ranges) - 1)
        ranges = np.where(scan.valid, scan.ranges, scan.range_max)
        before = time.process_time()
        slam.process_scan(
            LocalizedRangeScan(
                ranges,
                scan.angle_min,
                last,
                scan.angle_increment,
                scan.range_min,
                scan.range_max,
                min(scan.range_max, 12.0),
                lidar.x,
                lidar.y,
                lidar.theta,
            )
        )
        taken.append(1e3 * (time.process_time() - before))
    return float(np.median(taken))
