"""The cache of submaps' matching grids."""

from __future__ import annotations

import numpy as np

from wherry.mapping.graph_slam import GraphSlam
from wherry.mapping.submaps import MatchingGridCache
from wherry_testing.buildings import LIDAR, drive


def test_evicted_grids_are_rebuilt_bit_for_bit() -> None:
    slam, driven = GraphSlam(LIDAR), drive(noise=0.01, spacing=0.25)
    for scan, odometry in zip(driven.scans[:150], driven.odometry[:150], strict=True):
        slam.add(scan, odometry)
    submaps = slam.snapshot().submaps
    assert len(submaps) > 3
    large, small = MatchingGridCache(slam.keyframes), MatchingGridCache(slam.keyframes, capacity=0)
    for index in (0, 1, 2, 0, 3, 1):
        first, second = (cache.grid_of(index, submaps[index]) for cache in (large, small))
        assert first.scan_count == second.scan_count == len(submaps[index].members)
        np.testing.assert_array_equal(first.corner, second.corner)
        np.testing.assert_array_equal(first.likelihood, second.likelihood)
        np.testing.assert_array_equal(first.surfels, second.surfels)
    assert large.grid_of(0, submaps[0]) is large.grid_of(0, submaps[0])
