"""Weighted particles: the posterior over poses as a set of samples."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from wherry.localization.resampling import normalize
from wherry.space.pose import Floats


@dataclass(frozen=True, slots=True)
class ParticleSet:
    """Samples of the posterior. Every stage of the filter returns a new set.

    Attributes:
        poses: [N, 3] m, m, rad, poses of base_link in the map frame.
        weights: [N] importance weights, summing to 1.
        log_weights: [N] logarithms of the weights.
        is_uniform: Whether all weights are equal, as after resampling.
    """

    poses: Floats
    weights: Floats
    log_weights: Floats
    is_uniform: bool

    def __len__(self) -> int:
        return len(self.poses)

    @classmethod
    def uniform(cls, poses: Floats) -> ParticleSet:
        """Equally weighted particles at poses [N, 3] m, m, rad."""
        count = len(poses)
        return cls(poses, np.full(count, 1.0 / count), np.full(count, -math.log(count)), is_uniform=True)

    @classmethod
    def weighted(cls, poses: Floats, log_weights: Floats) -> ParticleSet:
        """Particles with given weights, which are normalized.

        Args:
            poses: [N, 3] m, m, rad, map frame.
            log_weights: [N] logarithms of unnormalized weights; normalized in place.
        """
        weights = np.empty(len(log_weights))
        normalize(log_weights, weights)
        return cls(poses, weights, log_weights, is_uniform=False)

    @property
    def effective_size(self) -> float:
        """Effective sample size 1 / Σw², at most the number of particles."""
        return 1.0 / float(self.weights @ self.weights)
