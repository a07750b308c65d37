"""The measurement update: importance weights by a tempered likelihood, and a proposal around a scan match if needed."""

from __future__ import annotations

import math

import numpy as np

from wherry.localization.parameters import AmclParameters
from wherry.localization.particles import ParticleSet
from wherry.localization.proposal import draw_around_match
from wherry.localization.resampling import log_sum, tempering_exponent
from wherry.localization.sensor import SENSOR_MODELS, Beams
from wherry.space.distance_field import DistanceField
from wherry.space.pose import Floats, Pose

UNIMODAL_EFFECTIVE_FACTOR = 0.1  # factor on least_effective for a unimodal posterior, which has no modes to preserve


class MeasurementUpdate:
    """Updates the importance weights of particles with a scan.

    Args:
        field: Distances to the map's obstacles.
        parameters: The filter's parameters.
        rng: Source of the randomness.
    """

    def __init__(self, field: DistanceField, parameters: AmclParameters, rng: np.random.Generator) -> None:
        self._field = field
        self._parameters = parameters
        self._rng = rng
        self._sensor = SENSOR_MODELS[parameters.laser_model_type](field, parameters)

    def reweight(self, particles: ParticleSet, beams: Beams, *, is_unimodal: bool) -> tuple[ParticleSet, float]:
        """Multiply the weights by the scan's likelihood: w_t ∝ p(z_t | x_t, m) w_{t−1}.

        Args:
            particles: The particles after the motion update.
            beams: The beams of the scan; at least one.
            is_unimodal: Whether the particles lie around one mode, so that they may be redrawn around a match.

        Returns:
            The reweighted particles, and the geometric mean of the beams' likelihoods, averaged over the particles.
        """
        p = self._parameters
        prior = particles.log_weights
        log_likelihood = np.zeros(len(particles))
        self._sensor.add_log_likelihood(particles.poses, beams, log_likelihood)
        mean_likelihood = math.exp(log_sum(prior + log_likelihood) / len(beams))
        log_likelihood *= min(1.0, p.independent_beams / len(beams))
        poses, min_effective = particles.poses, p.least_effective * len(particles)
        if is_unimodal and particles.is_uniform and tempering_exponent(prior, log_likelihood, min_effective) < 1.0:
            poses, correction = self._redraw(poses, beams, log_likelihood)
            prior = prior + correction
            min_effective *= UNIMODAL_EFFECTIVE_FACTOR
        log_likelihood *= tempering_exponent(prior, log_likelihood, min_effective)
        return ParticleSet.weighted(poses, prior + log_likelihood), mean_likelihood

    def _redraw(self, poses: Floats, beams: Beams, log_likelihood: Floats) -> tuple[Floats, Floats]:
        """Draw some particles around a scan match, since too few of them have a high likelihood.

        Args:
            poses: [N, 3] m, m, rad.
            beams: The beams of the scan.
            log_likelihood: [N] updated in place for the particles that are redrawn.

        Returns:
            [N, 3] the new poses, and [N] logarithms of the importance weights that correct for the proposal.
        """
        p = self._parameters
        best = Pose.from_array(poses[int(log_likelihood.argmax())])
        redundancy = max(1.0, len(beams) / p.independent_beams)
        proposal = draw_around_match(poses, best, self._field, beams.ends, p.sigma_hit, redundancy, self._rng)
        redrawn = np.zeros(len(proposal.redrawn))
        self._sensor.add_log_likelihood(proposal.poses[proposal.redrawn], beams, redrawn)
        log_likelihood[proposal.redrawn] = redrawn / redundancy
        return proposal.poses, proposal.log_weights
