"""Adaptive resampling: KLD sampling of the number of particles, and injection of random particles for recovery."""

from __future__ import annotations

import math

import numpy as np

from wherry.localization.initialization import FreeSpace
from wherry.localization.parameters import AmclParameters
from wherry.localization.particles import ParticleSet
from wherry.localization.recovery import RecoveryProbability
from wherry.localization.resampling import BIN_SIZE, Integers, adaptive_sample_size, low_variance_resample

SELECTIVE_MAX_EFFECTIVE = 0.5  # effective sample size, as fraction of the particles, up to which they are resampled


class AdaptiveResampler:
    """Resamples particles by weight.

    Args:
        free_space: Distribution of the random particles.
        parameters: The filter's parameters.
        table: Scratch memory from `resampling.hash_table` for max_particles.
        rng: Source of the randomness.
    """

    def __init__(
        self, free_space: FreeSpace, parameters: AmclParameters, table: Integers, rng: np.random.Generator
    ) -> None:
        p = parameters
        self._free_space = free_space
        self._parameters = p
        self._table = table
        self._rng = rng
        self._bin_size = np.array(BIN_SIZE)
        self._recovery = RecoveryProbability(p.recovery_alpha_slow, p.recovery_alpha_fast)
        self._updates = 0

    def reset(self) -> None:
        """Forget the likelihoods of past scans and the updates since the last resampling."""
        self._recovery.reset()
        self._updates = 0

    def resample(self, particles: ParticleSet, likelihood: float) -> ParticleSet:
        """Draw a new set by weight, if resampling is due.

        Args:
            particles: The reweighted particles.
            likelihood: The scan's likelihood, averaged over the particles.

        Returns:
            The new particles, equally weighted; the given ones where resampling is not due.
        """
        self._recovery.update(likelihood)
        self._updates += 1
        if not self._is_due(particles):
            return particles
        random_probability = 0.0 if self._free_space.is_empty else self._recovery.value
        count = self._sample_size(particles, random_probability)
        poses = np.empty((count, 3))
        low_variance_resample(particles.poses, particles.weights, self._rng.random(), poses)
        if random_probability > 0.0:
            replaced = self._rng.choice(count, self._rng.binomial(count, random_probability), replace=False)
            poses[replaced] = self._free_space.draw(len(replaced), self._rng)
        return ParticleSet.uniform(poses)

    def _is_due(self, particles: ParticleSet) -> bool:
        p = self._parameters
        if self._updates % p.resample_interval:
            return False
        return not p.selective_resampling or particles.effective_size <= SELECTIVE_MAX_EFFECTIVE * len(particles)

    def _sample_size(self, particles: ParticleSet, random_probability: float) -> int:
        """Number of particles by KLD sampling, counting a bin for each random particle."""
        p = self._parameters
        count = adaptive_sample_size(
            particles.poses,
            particles.weights,
            self._table,
            self._bin_size,
            p.pf_err,
            p.pf_z,
            p.min_particles,
            p.max_particles,
            self._rng.random(),
        )
        growth = random_probability / (2.0 * p.pf_err)
        return p.max_particles if growth >= 1.0 else min(math.ceil(count / (1.0 - growth)), p.max_particles)
