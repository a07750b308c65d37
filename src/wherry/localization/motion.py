"""Odometry motion models: samples of p(x_t | u_t, x_{t−1}).

Thrun, Burgard and Fox, Probabilistic Robotics, table 5.6, with amcl's two refinements: driving backwards is no more
uncertain than driving forwards, and a turn on the spot has no direction of travel.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import kernel
from wherry.localization.parameters import AmclParameters
from wherry.localization.particles import ParticleSet
from wherry.space.pose import Floats, Pose, wrap

Noise = NDArray[np.float32]

MIN_DIRECTED_TRANSLATION = 0.01  # m, translation below which the direction of travel is undefined

MotionModel = Callable[[Floats, Pose, AmclParameters, Noise], None]
"""Moves particles [N, 3] in place by a motion, with parameters and standard normal noise [N, 3] or [N, 4]."""


def propagate_differential(particles: Floats, motion: Pose, parameters: AmclParameters, noise: Noise) -> None:
    """Move particles in place by the model of a differential drive: rotation, translation, rotation.

    Args:
        particles: [N, 3] m, m, rad, map frame; changed in place.
        motion: New pose of base_link by odometry relative to the old one.
        parameters: alpha1 to alpha4 and turn_slip are used.
        noise: [N, 3] standard normal samples; [N, 4] if turn_slip is not 0.
    """
    translation = math.hypot(motion.x, motion.y)
    turn1 = math.atan2(motion.y, motion.x) if translation >= MIN_DIRECTED_TRANSLATION else 0.0
    turn2 = wrap(motion.theta - turn1)
    noise1, noise2 = _undirected_turn(turn1), _undirected_turn(turn2)
    p = parameters
    _move_differential(
        particles,
        np.array([turn1, translation, turn2]),
        np.array(
            [
                math.sqrt(p.alpha1 * noise1**2 + p.alpha2 * translation**2),
                math.sqrt(p.alpha3 * translation**2 + p.alpha4 * (noise1**2 + noise2**2)),
                math.sqrt(p.alpha1 * noise2**2 + p.alpha2 * translation**2),
                p.turn_slip * abs(motion.theta),
            ]
        ),
        noise,
    )


def propagate_omnidirectional(particles: Floats, motion: Pose, parameters: AmclParameters, noise: Noise) -> None:
    """Move particles in place by the model of a robot that translates in any direction while it turns.

    Args:
        particles: [N, 3] m, m, rad, map frame; changed in place.
        motion: New pose of base_link by odometry relative to the old one.
        parameters: alpha1 to alpha5 are used; alpha5 is the noise across the direction of travel.
        noise: [N, 3] standard normal samples.
    """
    translation = math.hypot(motion.x, motion.y)
    p = parameters
    _move_omnidirectional(
        particles,
        np.array([math.atan2(motion.y, motion.x), translation, motion.theta]),
        np.array(
            [
                math.sqrt(p.alpha3 * translation**2 + p.alpha1 * motion.theta**2),
                math.sqrt(p.alpha5 * translation**2 + p.alpha1 * motion.theta**2),
                math.sqrt(p.alpha4 * motion.theta**2 + p.alpha2 * translation**2),
            ]
        ),
        noise,
    )


MOTION_MODELS: MappingProxyType[str, MotionModel] = MappingProxyType(
    {"differential": propagate_differential, "omnidirectional": propagate_omnidirectional}
)


class MotionUpdate:
    """Moves particles by odometry with sampled noise.

    Args:
        parameters: The filter's parameters.
        rng: Source of the noise.
    """

    def __init__(self, parameters: AmclParameters, rng: np.random.Generator) -> None:
        self._parameters = parameters
        self._rng = rng
        self._model = MOTION_MODELS[parameters.robot_model_type]
        self._noise_columns = 4 if parameters.turn_slip else 3

    def propagate(self, particles: ParticleSet, motion: Pose) -> ParticleSet:
        """Sample the new poses of all particles, x_t ~ p(x_t | u_t, x_{t−1}).

        Args:
            particles: The particles at the last filter update.
            motion: Pose of base_link by odometry, relative to its pose at the last filter update.
        """
        poses = particles.poses.copy()
        noise = self._rng.standard_normal((len(poses), self._noise_columns), np.float32)
        self._model(poses, motion, self._parameters, noise)
        return replace(particles, poses=poses)


def _undirected_turn(angle: float) -> float:
    """Absolute angle of a turn, rad, measured from straight ahead or straight back, whichever is nearer."""
    return min(abs(wrap(angle)), abs(wrap(angle - math.pi)))


@kernel
def _wrapped(angle: float) -> float:
    """The equivalent angle in [−π, π), rad."""
    return angle - math.tau * math.floor((angle + math.pi) / math.tau)


@kernel
def _move_differential(particles: Floats, motion: Floats, spread: Floats, noise: Noise) -> None:
    for i in range(len(particles)):
        direction = particles[i, 2] + motion[0] - spread[0] * noise[i, 0]
        translation = motion[1] - spread[1] * noise[i, 1]
        cos, sin = math.cos(direction), math.sin(direction)
        slip = spread[3] * noise[i, 3] if spread[3] else 0.0
        particles[i, 0] += translation * cos - slip * sin
        particles[i, 1] += translation * sin + slip * cos
        heading = direction + motion[2] - spread[2] * noise[i, 2]
        particles[i, 2] = _wrapped(heading)


@kernel
def _move_omnidirectional(particles: Floats, motion: Floats, spread: Floats, noise: Noise) -> None:
    for i in range(len(particles)):
        bearing = particles[i, 2] + motion[0]
        cos, sin = math.cos(bearing), math.sin(bearing)
        along = motion[1] + spread[0] * noise[i, 0]
        across = spread[1] * noise[i, 1]
        particles[i, 0] += along * cos - across * sin
        particles[i, 1] += along * sin + across * cos
        heading = particles[i, 2] + motion[2] + spread[2] * noise[i, 2]
        particles[i, 2] = _wrapped(heading)
