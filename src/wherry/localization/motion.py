"""Odometry motion models: how far the particles spread when the wheels report a motion.

Thrun, Burgard and Fox, Probabilistic Robotics, table 5.6, with amcl's two refinements: driving backwards is no more
uncertain than driving forwards, and a turn on the spot has no direction of travel.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import kernel
from wherry.localization.parameters import AmclParameters
from wherry.space.pose import Pose, wrap

Floats = NDArray[np.float64]
Noise = NDArray[np.float32]

STANDING = 0.01  # m; a shorter motion has no direction of travel

MotionModel = Callable[[Floats, Pose, AmclParameters, Noise], None]


def propagate_differential(particles: Floats, motion: Pose, parameters: AmclParameters, noise: Noise) -> None:
    """Move particles in place as a differential drive moves: turn, drive straight, turn.

    Args:
        particles: [N, 3] m, m, rad, map frame; changed in place.
        motion: The new odometry pose as seen from the old one.
        parameters: alpha1 to alpha4 and turn_slip count.
        noise: [N, 3] standard normal; [N, 4] if there is turn_slip.
    """
    translation = math.hypot(motion.x, motion.y)
    turn1 = math.atan2(motion.y, motion.x) if translation >= STANDING else 0.0
    turn2 = wrap(motion.theta - turn1)
    noise1, noise2 = _least_turn(turn1), _least_turn(turn2)
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
    """Move particles in place as a robot moves that drives in any direction while it turns.

    Args:
        particles: [N, 3] m, m, rad, map frame; changed in place.
        motion: The new odometry pose as seen from the old one.
        parameters: alpha1 to alpha5 count; alpha5 is the noise across the direction of travel.
        noise: [N, 3] standard normal.
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


def _least_turn(angle: float) -> float:
    """The turn's size, where turning round to drive backwards counts as none."""
    return min(abs(wrap(angle)), abs(wrap(angle - math.pi)))


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
        particles[i, 2] = heading - math.tau * math.floor((heading + math.pi) / math.tau)


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
        particles[i, 2] = heading - math.tau * math.floor((heading + math.pi) / math.tau)
