"""Particle SLAM: shared maps, drawing, and whole runs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wherry.evaluation import load_relations, relation_errors
from wherry.logs.carmen import read_log, read_odometry
from wherry.mapping.cloud import Cloud
from wherry.mapping.particle_slam import ParticleSlam, ParticleSlamSettings, _drawn
from wherry.mapping.shared_tiles import SharedTiles, log_likelihood
from wherry.mapping.submap import Submap
from wherry.pipelines.logs.mapping import merged_odometry
from wherry.space.pose import Pose, relative
from wherry_testing.buildings import LIDAR, drive, shared_data

IDENTITY_LOGS = np.arange(256, dtype=np.float64)


def likelihoods(maps: SharedTiles, particle: int, points: np.ndarray) -> list[float]:
    index = maps.index[particle]
    return [
        log_likelihood(index, maps.tiles, maps.corner, point[None], 0.0, 0.0, 0.0, IDENTITY_LOGS) for point in points
    ]


def test_a_particle_s_map_is_a_submap_s_finest_level() -> None:
    points = np.random.default_rng(0).uniform(-8.0, 8.0, (500, 2))
    maps, submap = SharedTiles(2), Submap()
    maps.add(1, points[:250])
    maps.add(1, points[250:])
    submap.add(Cloud(points, np.zeros_like(points)))
    rows, columns = np.indices(submap.surfel_at.shape)
    centres = (np.column_stack([columns.ravel(), rows.ravel()]) + submap.corner + 0.5) * 0.05
    np.testing.assert_array_equal(likelihoods(maps, 1, centres), submap.likelihood[0].ravel())
    assert not any(likelihoods(maps, 0, centres[::50]))


def test_maps_are_copied_only_where_they_differ() -> None:
    rng = np.random.default_rng(0)
    maps = SharedTiles(3)
    first = rng.uniform(0.5, 9.0, (100, 2))
    maps.add(0, first)
    maps.draw(np.array([0, 0, 0]))
    used = len(np.unique(maps.index))
    alone = np.array([[1.0, 1.0]])
    maps.add(1, alone)
    assert len(np.unique(maps.index)) == used + 1, "one tile was written to"
    assert likelihoods(maps, 1, alone) == [255.0]
    for particle in (0, 2):
        assert likelihoods(maps, particle, first) == [255.0] * len(first)
        assert likelihoods(maps, particle, alone) == likelihoods(maps, 0, alone)
    maps.draw(np.array([1, 1, 1]))
    for particle in range(3):
        assert likelihoods(maps, particle, np.vstack([first, alone])) == [255.0] * (len(first) + 1)
        maps.add(particle, rng.uniform(-3.0, 12.0, (20, 2)))


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=40).filter(lambda w: sum(w) > 0.01), st.floats(0.0, 0.999))
def test_each_particle_survives_about_as_often_as_it_weighs(raw: list[float], start: float) -> None:
    weights = np.array(raw) / sum(raw)
    counts = np.bincount(_drawn(weights, start), minlength=len(weights))
    assert (np.abs(counts - weights * len(weights)) < 1.0 + 1e-9).all()


def test_the_way_through_a_building_is_right_and_repeatable() -> None:
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


@pytest.mark.slow
def test_intel_is_mapped_as_gmapping_does() -> None:
    log = read_log(shared_data("intel/intel_910_rawodom.clf.gz"))
    slam = ParticleSlam(Pose(), np.random.default_rng(0), ParticleSlamSettings(empty_range=0.0))
    for scan, odometry in zip(log.scans, log.scan_odometry, strict=True):
        slam.add(scan, odometry)
    dense = merged_odometry(log.odometry, read_odometry(shared_data("intel/intel_rawodom_dense.txt.gz")))
    relations = load_relations(shared_data("intel/intel.relations.gz"))
    assert relation_errors(slam.trajectory, relations, dense).translational_error_m <= 0.09
