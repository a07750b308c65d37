"""Particle SLAM: shared maps, resampling, and whole runs."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from wherry.mapping.matching_grid import MatchingGrid
from wherry.mapping.particle_slam import ParticleSlam, _systematic_resample
from wherry.mapping.point_cloud import PointCloud
from wherry.mapping.settings import ParticleSlamSettings
from wherry.mapping.shared_tiles import SharedTiles, log_likelihood
from wherry.space.pose import relative
from wherry_testing.buildings import LIDAR, drive

IDENTITY_TABLE = np.arange(256, dtype=np.float64)


def likelihoods(maps: SharedTiles, particle: int, points: np.ndarray) -> list[float]:
    index = maps.index[particle]
    return [
        log_likelihood(index, maps.tiles, maps.corner, point[None], 0.0, 0.0, 0.0, IDENTITY_TABLE) for point in points
    ]


def test_a_particle_map_equals_the_finest_level_of_a_matching_grid() -> None:
    points = np.random.default_rng(0).uniform(-8.0, 8.0, (500, 2))
    maps, grid = SharedTiles(2), MatchingGrid()
    maps.add(1, points[:250])
    maps.add(1, points[250:])
    grid.add(PointCloud(points, np.zeros_like(points)))
    rows, columns = np.indices(grid.surfel_at.shape)
    centres = (np.column_stack([columns.ravel(), rows.ravel()]) + grid.corner + 0.5) * 0.05
    np.testing.assert_array_equal(likelihoods(maps, 1, centres), grid.likelihood[0].ravel())
    assert not any(likelihoods(maps, 0, centres[::50]))


def test_tiles_are_copied_only_when_written_to() -> None:
    rng = np.random.default_rng(0)
    maps = SharedTiles(3)
    first = rng.uniform(0.5, 9.0, (100, 2))
    maps.add(0, first)
    maps.resample(np.array([0, 0, 0]))
    used = len(np.unique(maps.index))
    alone = np.array([[1.0, 1.0]])
    maps.add(1, alone)
    assert len(np.unique(maps.index)) == used + 1, "more than the one tile that was written to was copied"
    assert likelihoods(maps, 1, alone) == [255.0]
    for particle in (0, 2):
        assert likelihoods(maps, particle, first) == [255.0] * len(first)
        assert likelihoods(maps, particle, alone) == likelihoods(maps, 0, alone)
    maps.resample(np.array([1, 1, 1]))
    for particle in range(3):
        assert likelihoods(maps, particle, np.vstack([first, alone])) == [255.0] * (len(first) + 1)
        maps.add(particle, rng.uniform(-3.0, 12.0, (20, 2)))


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=40).filter(lambda w: sum(w) > 0.01), st.floats(0.0, 0.999))
def test_resampling_draws_particles_in_proportion_to_their_weights(raw: list[float], start: float) -> None:
    weights = np.array(raw) / sum(raw)
    counts = np.bincount(_systematic_resample(weights, start), minlength=len(weights))
    assert (np.abs(counts - weights * len(weights)) < 1.0 + 1e-9).all()


def test_the_trajectory_through_a_building_is_accurate_and_repeatable() -> None:
    driven = drive(noise=0.01, drift=0.02, spacing=0.2)

    def run(seed: int) -> ParticleSlam:
        slam = ParticleSlam(LIDAR, np.random.default_rng(seed), ParticleSlamSettings(particles=10))
        for scan, odometry in zip(driven.scans, driven.odometry, strict=True):
            slam.add(scan, odometry)
        return slam

    slam = run(0)
    off = relative(slam.trajectory.poses, driven.truth)
    assert np.hypot(off[:, 0], off[:, 1]).max() < 0.12
    assert np.abs(off[:, 2]).max() < math.radians(2.0)
    assert slam.grid().occupied.sum() > 500
    assert run(0).trajectory.poses.tobytes() == slam.trajectory.poses.tobytes()
    assert run(1).trajectory.poses.tobytes() != slam.trajectory.poses.tobytes()
