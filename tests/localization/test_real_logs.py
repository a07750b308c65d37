"""Localization of the odd scans of the Intel log on the map of the even ones."""

from __future__ import annotations

from functools import cache

import numpy as np

from wherry.localization.localizer import Localizer
from wherry.localization.parameters import AmclParameters
from wherry.localization.relocalization import Relocalizer
from wherry.logs.lidar_log import LidarLog
from wherry.logs.reading import read_log
from wherry.logs.tables import read_rows
from wherry.space.mapper import GridMapper
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry_testing.buildings import shared_data


@cache
def intel() -> tuple[LidarLog, list[Pose], OccupancyGrid]:
    """The log, its reference poses, and the map of every second scan at these poses."""
    log = read_log(shared_data("intel/intel_910_rawodom.clf.gz"))
    rows = read_rows(shared_data("intel/intel_910_gfs_corrected_tum.txt.gz"), widths=(4,))
    poses = [Pose.from_array(row[1:]) for row in rows]
    mapper = GridMapper(0.05)
    for scan, pose in zip(log.scans[::2], poses[::2], strict=True):
        lidar = pose @ log.lidar
        ends = lidar.transform(scan.points())
        mapper.add(lidar.as_array()[:2], ends, np.ones(len(ends), np.bool_))
    return log, poses, mapper.grid()


def test_one_scan_relocalizes_the_robot_in_the_intel_lab() -> None:
    log, poses, grid = intel()
    relocalizer = Relocalizer(grid, log.lidar)
    chosen = range(1, 910, 18)
    found = [relocalizer.search(log.scans[i]) for i in chosen]
    for relocalization, index in zip(found, chosen, strict=True):
        is_correct = relocalization.hypotheses[0].pose.distance_to(poses[index]) < 0.5
        assert is_correct or relocalization.is_ambiguous
    assert sum(relocalization.is_ambiguous for relocalization in found) <= 0.1 * len(found) + 2


def test_tracking_in_the_intel_lab_with_raw_odometry() -> None:
    log, poses, grid = intel()
    parameters = AmclParameters(alpha1=0.05, alpha2=0.05, alpha3=0.05, alpha4=0.05)
    localizer = Localizer(grid, log.lidar, parameters, np.random.default_rng(0))
    localizer.initialize(poses[1], np.diag([0.01, 0.01, 0.003]))
    errors = []
    for i in range(1, 910, 2):
        odometry = log.scan_odometry[i]
        assert odometry is not None
        errors.append(localizer.update(odometry, log.scans[i]).pose.distance_to(poses[i]))
    assert np.median(errors) < 0.03
    assert max(errors) < 1.0
