"""A better proposal: some particles are drawn where the scan says that the robot is, and weighed so that this is fair.

After a long motion the particles are so far apart that hardly one of them is where the scan fits. A share of them is
then drawn around a match of the scan with the map, as in gmapping (Grisetti et al., 2007) and Mixture-MCL (Thrun et
al., 2001). Every particle gets the weight p(x | motion) / q(x), where q is the mixture that it was drawn from (the
balance heuristic; Veach and Guibas, 1995): the belief is the same as without, only better sampled.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wherry.localization.clusters import moments
from wherry.localization.refinement import match_scan
from wherry.space.distance_field import DistanceField
from wherry.space.pose import Pose

Floats = NDArray[np.float64]

SHARE = 0.2  # of the particles, drawn around the match
COARSE_SIGMA = 0.2  # m, of a first match, which finds the way from farther off
LEAST_DEVIATION = (0.03, 0.03, 0.02)  # m, m, rad, of the particles around the match
ROUND = np.diag([1e-6, 1e-6, 1e-6])  # keeps the covariance of particles that all lie at one place invertible


def draw_around_match(
    particles: Floats,
    best: Pose,
    field: DistanceField,
    ends: Floats,
    sigma: float,
    repetition: float,
    rng: np.random.Generator,
) -> tuple[NDArray[np.int64], Floats]:
    """Move a share of equally weighted particles to where the scan fits best.

    Args:
        particles: [N, 3] m, m, rad, just propagated; changed in place. They must lie around one place.
        best: The one that explains the scan best, where the match begins.
        field: Distances to the map's obstacles.
        ends: [B, 2] m, where the beams ended, base_link frame.
        sigma: σ, m, of the readings.
        repetition: How many beams are worth one: the particles must spread at least as far as the weighing tells.
        rng: Where the randomness comes from.

    Returns:
        [M] which particles were moved, and [N] the logarithms of the weights that make it fair.
    """
    count = len(particles)
    mean, covariance = moments(particles, np.full(count, 1.0 / count), np.ones(count, np.bool_))
    covariance += ROUND
    centre = Pose.from_array(mean)
    coarse = match_scan(field, ends, centre, covariance, max(sigma, COARSE_SIGMA), start=best)
    match = match_scan(field, ends, centre, covariance, sigma, start=coarse.pose)
    around = repetition * match.covariance + np.diag(np.square(LEAST_DEVIATION))
    moved = np.arange(0, count, round(1.0 / SHARE))
    particles[moved] = rng.multivariate_normal(match.pose.as_array(), around, len(moved), method="eigh")
    share = len(moved) / count
    motion = _log_density(particles, mean, covariance)
    matched = _log_density(particles, match.pose.as_array(), around)
    return moved, motion - np.logaddexp(math.log(1.0 - share) + motion, math.log(share) + matched)


def _log_density(particles: Floats, mean: Floats, covariance: Floats) -> Floats:
    """[N] log N(x; mean, covariance), headings compared as directions."""
    offset = particles - mean
    offset[:, 2] = np.remainder(offset[:, 2] + math.pi, math.tau) - math.pi
    _, log_determinant = np.linalg.slogdet(covariance)
    distance = np.einsum("ni,ij,nj->n", offset, np.linalg.inv(covariance), offset)
    density: Floats = -0.5 * (distance + log_determinant + 3.0 * math.log(math.tau))
    return density
