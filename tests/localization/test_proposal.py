"""The mixture proposal: particles around a scan match, importance weights, and tempering of the likelihood."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from wherry.localization.amcl import Amcl
from wherry.localization.parameters import PRECISE_PARAMETERS, AmclParameters
from wherry.localization.proposal import draw_around_match
from wherry.localization.resampling import tempering_exponent
from wherry.localization.sensor import valid_beams
from wherry.robot import Odometry, Velocity
from wherry.space.distance_field import DistanceField
from wherry.space.pose import Pose
from wherry_testing.rooms import LIDAR, Building

GRID = Building().grid()
TRUTH = Pose(4.5, 2.0, 0.4)
WIDE = np.diag([0.3**2, 0.3**2, 0.2**2])


def test_importance_weights_keep_the_mean_of_the_posterior() -> None:
    rng = np.random.default_rng(0)
    mean = TRUTH.as_array() + np.array([0.2, -0.1, 0.1])
    particles = rng.multivariate_normal(mean, WIDE, 20_000)
    ends = valid_beams(Building().scan(0.0, TRUTH), LIDAR, AmclParameters()).evenly_spaced(60).ends
    field = DistanceField.of(GRID, 2.0)
    proposal = draw_around_match(particles, TRUTH, field, ends, 0.2, 4.0, rng)
    assert len(proposal.redrawn) == 4000
    np.testing.assert_allclose(proposal.poses[proposal.redrawn].mean(axis=0), TRUTH.as_array(), atol=0.05)
    weights = np.exp(proposal.log_weights)
    assert weights.mean() == pytest.approx(1.0, abs=0.03)
    np.testing.assert_allclose(weights @ proposal.poses / weights.sum(), mean, atol=0.02)
    assert weights.max() < 1.3  # no particle dominates


def test_long_motion_with_noisy_odometry_is_tracked() -> None:
    rng = np.random.default_rng(1)
    start, parameters = Pose(4.5, 0.8, 1.2), replace(PRECISE_PARAMETERS, alpha1=0.1, alpha2=0.1, alpha3=0.1, alpha4=0.1)
    amcl = Amcl(GRID, LIDAR, parameters, rng)
    amcl.initialize(start, np.diag([0.01, 0.01, 0.01]))
    amcl.update(Odometry(0.0, Pose(), Velocity()), Building().scan(0.0, start, rng))
    goal = Pose(5.4, 2.4, 2.4)
    reported = goal.relative_to(start) @ Pose(0.15, -0.1, 0.12)
    found = amcl.update(Odometry(5.0, reported, Velocity()), Building().scan(5.0, goal, rng))
    assert found.pose.distance_to(goal) < 0.05


def test_tempering_keeps_the_effective_sample_size() -> None:
    rng = np.random.default_rng(0)
    even, increments = np.full(1000, -math.log(1000)), rng.normal(0.0, 5.0, 1000)
    exponent = tempering_exponent(even, increments, 300.0)
    weights = np.exp(exponent * increments)
    assert 0.0 < exponent < 1.0
    assert weights.sum() ** 2 / (weights @ weights) == pytest.approx(300.0, rel=0.02)
    assert tempering_exponent(even, 0.1 * increments, 300.0) == 1.0
