"""A mixture proposal: some particles are drawn around a scan match and corrected by importance weights.

After a long motion the particles are so far apart that few of them have a high likelihood. A fraction of them is then
drawn around a match of the scan with the map, as in gmapping (Grisetti et al., 2007) and Mixture-MCL (Thrun et
al., 2001). Every particle gets the weight p(x | motion) / q(x), where q is the mixture it was drawn from (the balance
heuristic; Veach and Guibas, 1995), so that the posterior stays the same and is only sampled better.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.localization.clusters import moments
from wherry.localization.refinement import match_scan
from wherry.space.distance_field import DistanceField
from wherry.space.pose import Floats, Pose, wrap_angles

MATCH_FRACTION = 0.2  # fraction of the particles drawn around the match
COARSE_SIGMA = 0.2  # m, standard deviation σ of the first match, a large one to converge from farther away
PROPOSAL_MARGIN = np.diag([0.03**2, 0.03**2, 0.02**2])  # m², m², rad², added to the match's covariance
REGULARIZATION = np.diag([1e-6, 1e-6, 1e-6])  # m², m², rad²; added to keep the covariance of equal particles invertible


@dataclass(frozen=True, slots=True)
class MatchProposal:
    """Particles of which some were redrawn around a match.

    Attributes:
        poses: [N, 3] m, m, rad, map frame.
        redrawn: [M] indices of the particles that were redrawn.
        log_weights: [N] logarithms of the importance weights that correct for the proposal.
    """

    poses: Floats
    redrawn: NDArray[np.int64]
    log_weights: Floats


def draw_around_match(
    particles: Floats,
    best: Pose,
    field: DistanceField,
    ends: Floats,
    sigma: float,
    redundancy: float,
    rng: np.random.Generator,
) -> MatchProposal:
    """Redraw a fraction of equally weighted particles around a match of the scan.

    Args:
        particles: [N, 3] m, m, rad, map frame, just propagated, of a unimodal distribution.
        best: The particle with the highest likelihood, where the match starts.
        field: Distances to the map's obstacles.
        ends: [B, 2] m, beam ends, base_link frame.
        sigma: Standard deviation σ of the readings, m.
        redundancy: Number of beams that are worth one independent reading; the match's covariance is multiplied by it.
        rng: Source of the randomness.
    """
    particles = particles.copy()
    count = len(particles)
    mean, covariance = moments(particles, np.full(count, 1.0 / count), np.ones(count, np.bool_))
    covariance += REGULARIZATION
    centre = Pose.from_array(mean)
    coarse = match_scan(field, ends, centre, covariance, max(sigma, COARSE_SIGMA), start=best)
    match = match_scan(field, ends, centre, covariance, sigma, start=coarse.pose)
    around = redundancy * match.covariance + PROPOSAL_MARGIN
    redrawn = np.arange(0, count, round(1.0 / MATCH_FRACTION))
    particles[redrawn] = rng.multivariate_normal(match.pose.as_array(), around, len(redrawn), method="eigh")
    fraction = len(redrawn) / count
    motion = _log_density(particles, mean, covariance)
    matched = _log_density(particles, match.pose.as_array(), around)
    mixture = np.logaddexp(math.log(1.0 - fraction) + motion, math.log(fraction) + matched)
    return MatchProposal(particles, redrawn, motion - mixture)


def _log_density(particles: Floats, mean: Floats, covariance: Floats) -> Floats:
    """[N] log density N(x; mean, covariance) of every particle x."""
    offset = particles - mean
    offset[:, 2] = wrap_angles(offset[:, 2])
    _, log_determinant = np.linalg.slogdet(covariance)
    distance = np.einsum("ni,ij,nj->n", offset, np.linalg.inv(covariance), offset)
    density: Floats = -0.5 * (distance + log_determinant + 3.0 * math.log(math.tau))
    return density
