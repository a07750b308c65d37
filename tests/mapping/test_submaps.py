"""The cache of submaps' matching grids."""

from __future__ import annotations

import math

import numpy as np

from wherry.mapping.graph_slam import GraphSlam
from wherry.mapping.submaps import MatchingGridCache
from wherry.robot import Odometry, Scan, Velocity
from wherry.space.pose import Pose


def test_evicted_grids_are_rebuilt_bit_for_bit() -> None:
    rng = np.random.default_rng(0)
    slam = GraphSlam()
    for n in range(60):
        ranges = 5.0 + np.sin(np.linspace(0.0, 9.0, 360) + 0.1 * n) + 0.01 * rng.normal(size=360)
        scan = Scan(float(n), ranges, -math.pi, math.tau / 360, 0.05, 20.0)
        slam.add(scan, Odometry(float(n), Pose(0.3 * n, 0.0, 0.0), Velocity()))
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
