"""A scan matched to the map finds the pose that it was taken from, and leaves the prior alone where it says nothing."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wherry.localization.parameters import AmclParameters
from wherry.localization.refinement import agrees, match_scan
from wherry.localization.sensor import valid_beams
from wherry.space.distance_field import DistanceField
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry_testing.rooms import LIDAR, Building

PRIOR = np.diag([0.1**2, 0.1**2, 0.05**2])


def fine_map(origin: Pose) -> DistanceField:
    """A map so fine that its cells are the walls."""
    return DistanceField.of(Building().grid(resolution=0.01, origin=origin), 1.0)


@pytest.mark.parametrize("origin", [Pose(-0.5, -0.5, 0.0), Pose(3.0, -4.0, 0.9)])
def test_finds_the_true_pose(origin: Pose) -> None:
    # Turned by 0.9 rad only part of the building fits the grid: the beams that leave it must not matter.
    field = fine_map(origin)
    truth = Pose(4.5, 2.0, 0.4)
    ends = valid_beams(Building().scan(0.0, truth), LIDAR, AmclParameters()).ends
    prior = Pose(4.56, 1.93, 0.36)
    match = match_scan(field, ends, prior, PRIOR, 0.05)
    assert match.accepted
    assert match.pose.distance_to(truth) < 0.006
    assert abs(match.pose.theta - truth.theta) < 0.003
    assert np.linalg.eigvalsh(match.covariance).min() > 0.0
    assert np.trace(match.covariance) < np.trace(PRIOR)


def test_along_a_corridor_the_prior_decides() -> None:
    probability = np.full((60, 400), 0.1, np.float32)
    probability[[10, 50]] = 0.9
    field = DistanceField.of(OccupancyGrid(probability, 0.05), 1.0)
    x = np.linspace(-3.0, 3.0, 61)
    ends = np.vstack([np.column_stack([x, np.full(61, side)]) for side in (-1.0, 1.0)])
    match = match_scan(field, ends, Pose(10.0, 1.475, 0.05), PRIOR, 0.05)
    assert match.accepted
    assert match.pose.x == pytest.approx(10.0, abs=0.003)
    assert match.pose.y == pytest.approx(1.525, abs=0.003)
    assert match.pose.theta == pytest.approx(0.0, abs=0.003)
    assert math.sqrt(match.covariance[0, 0]) == pytest.approx(0.1, rel=0.02)
    assert math.sqrt(match.covariance[1, 1]) < 0.01


def test_a_map_without_obstacles_changes_nothing() -> None:
    field = DistanceField.of(OccupancyGrid(np.full((50, 50), 0.5, np.float32), 0.05), 1.0)
    match = match_scan(field, np.ones((10, 2)), Pose(1.0, 1.0, 1.0), PRIOR, 0.05)
    assert match.pose.distance_to(Pose(1.0, 1.0)) < 1e-9
    assert match.explained < 1e-9


def test_no_beams_change_nothing() -> None:
    field = fine_map(Pose(-0.5, -0.5))
    match = match_scan(field, np.empty((0, 2)), Pose(1.0, 1.0, 1.0), PRIOR, 0.05)
    assert match.pose.distance_to(Pose(1.0, 1.0)) < 1e-9


def test_agreement_wraps_angles() -> None:
    assert agrees(Pose(0.0, 0.0, math.pi - 0.01), Pose(0.0, 0.0, -math.pi + 0.01), PRIOR)
    assert not agrees(Pose(0.5, 0.0, 0.0), Pose(), PRIOR)
