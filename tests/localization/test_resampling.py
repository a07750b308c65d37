"""Resampling keeps proportions, and KLD sampling keeps the number of particles of Fox's bound."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2, norm

from wherry.localization.clusters import dominant_cluster
from wherry.localization.resampling import (
    BIN_SIZE,
    adaptive_sample_size,
    hash_table,
    kld_sample_size,
    low_variance_resample,
    normalize,
)
from wherry.space.pose import wrap_angles


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=50))
def test_normalization_works_at_any_scale(values: list[float]) -> None:
    log_weights = np.array(values)
    weights = np.empty_like(log_weights)
    total = normalize(log_weights, weights)
    assert weights.sum() == pytest.approx(1.0)
    assert total == pytest.approx(np.logaddexp.reduce(np.array(values)))
    np.testing.assert_allclose(np.exp(log_weights), weights)


@settings(deadline=None)
@given(st.integers(1, 40), st.integers(1, 100), st.floats(0.0, 0.999), st.integers(0, 2**32 - 1))
def test_every_particle_is_copied_in_proportion_to_its_weight(count: int, wanted: int, start: float, seed: int) -> None:
    weights = np.random.default_rng(seed).random(count)
    weights /= weights.sum()
    particles = np.column_stack([np.arange(count), np.zeros(count), np.zeros(count)])
    resampled = np.empty((wanted, 3))
    low_variance_resample(particles, weights, start, resampled)
    copies = np.bincount(resampled[:, 0].astype(int), minlength=count)
    assert (copies >= np.floor(wanted * weights - 1e-9)).all()
    assert (copies <= np.ceil(wanted * weights + 1e-9)).all()


def test_kld_sample_size_is_the_chi_square_bound() -> None:
    # Fox (2001): n = χ²_{k−1, 1−δ} / 2ε; the Wilson–Hilferty approximation is within a percent of it.
    for bins in (5, 20, 200):
        exact = chi2.ppf(0.99, bins - 1) / (2 * 0.05)
        assert kld_sample_size(bins, 0.05, float(norm.ppf(0.99)), 1, 10**9) == pytest.approx(exact, rel=0.01)
    assert kld_sample_size(1, 0.05, 2.33, 17, 1000) == 17
    assert kld_sample_size(10_000, 0.05, 2.33, 17, 1000) == 1000


def count_for(particles: np.ndarray, weights: np.ndarray, min_count: int = 10, max_count: int = 5000) -> int:
    table = hash_table(max_count)
    return adaptive_sample_size(particles, weights, table, np.array(BIN_SIZE), 0.05, 0.99, min_count, max_count, 0.3)


def test_posterior_in_one_bin_needs_the_minimum() -> None:
    particles = np.full((1000, 3), 0.1)
    assert count_for(particles, np.full(1000, 1e-3)) == 10


def test_posterior_over_all_bins_needs_the_maximum() -> None:
    particles = np.random.default_rng(0).uniform(-3.0, 3.0, (5000, 3)) * [10.0, 10.0, 1.0]
    assert count_for(particles, np.full(5000, 1 / 5000)) == 5000


def test_particles_without_weight_occupy_no_bins() -> None:
    particles = np.random.default_rng(0).uniform(-3.0, 3.0, (5000, 3)) * [10.0, 10.0, 1.0]
    weights = np.zeros(5000)
    weights[42] = 1.0
    assert count_for(particles, weights) == 10


def test_sample_size_is_that_of_the_occupied_bins() -> None:
    centres = np.array([[x + 0.25, 0.25, 0.1] for x in range(8)])
    particles = centres.repeat(100, axis=0)
    expected = kld_sample_size(8, 0.05, 0.99, 10, 5000)
    assert count_for(particles, np.full(800, 1 / 800)) == expected


def test_dominant_cluster_is_not_averaged_with_another() -> None:
    rng = np.random.default_rng(3)
    here = rng.normal([1.0, 2.0, math.pi], [0.1, 0.05, 0.02], (600, 3))
    here[:, 2] = wrap_angles(here[:, 2])  # around ±π
    there = rng.normal([8.0, 2.0, 0.0], [0.1, 0.05, 0.02], (400, 3))
    cluster = dominant_cluster(np.vstack([here, there]), np.full(1000, 1e-3), hash_table(1000))
    assert cluster.weight == pytest.approx(0.6)
    assert (cluster.mean.x, cluster.mean.y) == pytest.approx((1.0, 2.0), abs=0.02)
    assert abs(cluster.mean.theta) == pytest.approx(math.pi, abs=0.005)
    np.testing.assert_allclose(np.sqrt(np.diag(cluster.covariance)), [0.1, 0.05, 0.02], rtol=0.1)
