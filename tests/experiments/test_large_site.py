"""Mapping of an artificial site: accuracy, and cost in memory."""

from __future__ import annotations

import numpy as np

from wherry.experiments.mapping.large_site import RESOLUTION, SCAN_ANGLE, SCAN_DISTANCE, drive, map_site, site
from wherry.space.mapper import GridMapper
from wherry.space.pose import relative
from wherry.space.tiles import TILE_SIZE


def test_the_drive_keeps_to_the_streets() -> None:
    poses, blocked = drive(44.5), site(44.5, np.random.default_rng(0))
    cells = np.floor(poses[:, :2] / RESOLUTION).astype(np.int64)
    assert not blocked[cells[:, 1], cells[:, 0]].any()
    steps = relative(poses[1:], poses[:-1])
    assert np.hypot(steps[:, 0], steps[:, 1]).max() < SCAN_DISTANCE + 1e-9
    assert np.abs(steps[:, 2]).max() < SCAN_ANGLE + 1e-9
    assert poses[:, :2].max() > 30.0


def test_a_small_site_is_mapped_accurately() -> None:
    ticks: list[tuple[int, int]] = []
    result = map_site(24.5, seed=1, progress=lambda done, total: ticks.append((done, total)))
    assert ticks[0] == (0, result.scans)
    assert result.closures > 0
    assert result.rmse_m < 0.05
    assert result.drive_m > 3 * result.side_m
    assert 0.5 < result.known_share <= 1.0
    assert result.peak_bytes > 10_000_000


def test_memory_grows_with_the_observed_area_only() -> None:
    mapper = GridMapper(RESOLUTION)
    ends = np.array([[0.0, 2.0], [2.0, 0.0], [-2.0, 0.0], [0.0, -2.0]])
    for place in ((0.0, 0.0), (300.0, 0.0), (300.0, 300.0)):
        mapper.add(np.array(place), ends + place, np.ones(4, np.bool_))
    assert mapper.tile_count <= 3 * 9
    whole = 300.0**2 / (TILE_SIZE * RESOLUTION) ** 2
    assert mapper.tile_count < whole / 300
