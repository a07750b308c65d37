"""Motion models: exact motion without noise, and the variances of table 5.6 with it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from wherry.localization.motion import MIN_DIRECTED_TRANSLATION, MOTION_MODELS
from wherry.localization.parameters import ROBOT_MODELS, AmclParameters
from wherry.space.pose import Pose

coordinates = st.floats(-50.0, 50.0)
angles = st.floats(-math.pi, math.pi)
poses = st.builds(Pose, coordinates, coordinates, angles)
EXACT = AmclParameters(alpha1=0.0, alpha2=0.0, alpha3=0.0, alpha4=0.0, alpha5=0.0)


def test_every_robot_model_of_the_parameters_exists() -> None:
    assert tuple(MOTION_MODELS) == ROBOT_MODELS


@pytest.mark.parametrize("model", ROBOT_MODELS)
@settings(deadline=None)  # the first call compiles
@given(start=poses, motion=poses)
def test_without_noise_the_particles_follow_the_odometry(model: str, start: Pose, motion: Pose) -> None:
    assume(math.hypot(motion.x, motion.y) > MIN_DIRECTED_TRANSLATION or motion.x == motion.y == 0.0)
    particles = start.as_array()[None, :].repeat(3, axis=0)
    MOTION_MODELS[model](particles, motion, EXACT, np.ones((3, 3), np.float32))
    expected = start @ motion
    for particle in particles:
        found = Pose.from_array(particle)
        assert found.distance_to(expected) < 1e-6
        assert abs(math.remainder(found.theta - expected.theta, math.tau)) < 1e-6
        assert abs(particle[2]) < math.pi + 1e-9


def spread(model: str, motion: Pose, parameters: AmclParameters) -> np.ndarray:
    """[3] variances of x, y and heading of 40,000 particles that start at the origin."""
    particles = np.zeros((40_000, 3))
    noise = np.random.default_rng(1).standard_normal((40_000, 3)).astype(np.float32)
    MOTION_MODELS[model](particles, motion, parameters, noise)
    return particles.var(axis=0)


def test_noise_of_a_differential_drive() -> None:
    p = AmclParameters(alpha1=0.0, alpha2=0.01, alpha3=0.02, alpha4=0.0)
    along, across, heading = spread("differential", Pose(1.0, 0.0, 0.0), p)
    assert along == pytest.approx(0.02, rel=0.05)  # alpha3 · 1² (and the first turn's cosine)
    assert across == pytest.approx(0.01, rel=0.05)  # alpha2 · 1²: the first rotation's error moves it sideways
    assert heading == pytest.approx(0.02, rel=0.05)  # alpha2 for either turn


def test_noise_of_a_turn_on_the_spot() -> None:
    p = AmclParameters(alpha1=0.04, alpha2=0.0, alpha3=0.0, alpha4=0.01)
    along, across, heading = spread("differential", Pose(0.0, 0.0, 0.5), p)
    assert heading == pytest.approx(0.04 * 0.25, rel=0.05)
    assert along == pytest.approx(0.01 * 0.25, rel=0.05)
    assert across < 1e-9


def test_turn_slip_moves_particles_sideways() -> None:
    p = AmclParameters(alpha1=0.0, alpha2=0.0, alpha3=0.0, alpha4=0.0, turn_slip=0.1)
    particles, noise = np.zeros((40_000, 3)), np.random.default_rng(1).standard_normal((40_000, 4)).astype(np.float32)
    MOTION_MODELS["differential"](particles, Pose(0.0, 0.0, 0.5), p, noise)
    along, across, heading = particles.var(axis=0)
    assert across == pytest.approx(0.01 * 0.25, rel=0.05)
    assert max(along, heading) < 1e-9


def test_driving_backwards_is_as_precise_as_forwards() -> None:
    p = AmclParameters(alpha1=0.1, alpha2=0.0, alpha3=0.0, alpha4=0.0)
    np.testing.assert_allclose(spread("differential", Pose(-1.0, 0.0, 0.0), p), 0.0, atol=1e-9)


def test_noise_of_an_omnidirectional_drive() -> None:
    p = AmclParameters(alpha1=0.0, alpha2=0.03, alpha3=0.02, alpha4=0.0, alpha5=0.05)
    along, across, heading = spread("omnidirectional", Pose(0.0, 1.0, 0.0), p)
    assert along == pytest.approx(0.05, rel=0.05)  # driving to the left, alpha5 shows along x
    assert across == pytest.approx(0.02, rel=0.05)
    assert heading == pytest.approx(0.03, rel=0.05)
