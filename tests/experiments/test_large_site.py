"""A made-up site: what a drive over it costs, and that it is mapped right."""

from __future__ import annotations

import math

import numpy as np

from wherry.experiments.mapping.large_site import RESOLUTION, SPACING, TURN, drive, run, site
from wherry.mapping.graph_slam import GraphSlam
from wherry.mapping.pieces import SubmapStore
from wherry.robot import Odometry, Scan, Velocity
from wherry.space.mapper import TILE, GridMapper
from wherry.space.pose import Pose, relative


def test_the_drive_keeps_to_the_streets() -> None:
    way, blocked = drive(44.5), site(44.5, np.random.default_rng(0))
    cells = np.floor(way[:, :2] / RESOLUTION).astype(np.int64)
    assert not blocked[cells[:, 1], cells[:, 0]].any()
    steps = relative(way[1:], way[:-1])
    assert np.hypot(steps[:, 0], steps[:, 1]).max() < SPACING + 1e-9
    assert np.abs(steps[:, 2]).max() < TURN + 1e-9
    assert way[:, :2].max() > 30.0


def test_a_small_site_is_mapped_right() -> None:
    ticks: list[tuple[int, int]] = []
    result = run(24.5, seed=1, progress=lambda done, total: ticks.append((done, total)))
    assert ticks[0] == (0, result.scans)
    assert result.closures > 0
    assert result.rmse_m < 0.05
    assert result.way_m > 3 * result.side_m
    assert 0.5 < result.known_share <= 1.0
    assert result.peak_bytes > 10_000_000


def test_only_what_was_seen_costs() -> None:
    mapper = GridMapper(RESOLUTION)
    ends = np.array([[0.0, 2.0], [2.0, 0.0], [-2.0, 0.0], [0.0, -2.0]])
    for place in ((0.0, 0.0), (300.0, 0.0), (300.0, 300.0)):
        mapper.add(np.array(place), ends + place, np.ones(4, np.bool_))
    assert mapper.tile_count <= 3 * 9
    whole = 300.0**2 / (TILE * RESOLUTION) ** 2
    assert mapper.tile_count < whole / 300


def test_submaps_that_were_dropped_come_back_as_they_were() -> None:
    rng = np.random.default_rng(0)
    slam = GraphSlam()
    for n in range(60):
        ranges = 5.0 + np.sin(np.linspace(0.0, 9.0, 360) + 0.1 * n) + 0.01 * rng.normal(size=360)
        scan = Scan(float(n), ranges, -math.pi, math.tau / 360, 0.05, 20.0)
        slam.add(scan, Odometry(float(n), Pose(0.3 * n, 0.0, 0.0), Velocity()))
    assert len(slam.pieces) > 3
    roomy, tight = SubmapStore(slam.keyscans), SubmapStore(slam.keyscans, room=0)
    for number in (0, 1, 2, 0, 3, 1):
        first, second = (store.of(number, slam.pieces[number]) for store in (roomy, tight))
        assert first.scans == second.scans == len(slam.pieces[number].members)
        np.testing.assert_array_equal(first.corner, second.corner)
        np.testing.assert_array_equal(first.likelihood, second.likelihood)
        np.testing.assert_array_equal(first.surfels, second.surfels)
    assert roomy.of(0, slam.pieces[0]) is roomy.of(0, slam.pieces[0])
