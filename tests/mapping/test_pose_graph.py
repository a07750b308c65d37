"""Pose graphs with known solutions, and covariances that are propagated along paths."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wherry.mapping.covariances import relative_covariances, rotate_covariance, transform_covariance
from wherry.mapping.pose_graph import PoseGraph, constraint_errors, optimized
from wherry.space.pose import Floats, Pose, compose, relative

INFORMATION = np.diag([100.0, 100.0, 400.0])


def ring(count: int = 40) -> tuple[Floats, PoseGraph]:
    """Poses on a circle, and their graph of odometry once around and a loop closure."""
    angles = np.linspace(0.0, math.tau, count)
    truth = np.column_stack([5.0 * np.sin(angles), 5.0 - 5.0 * np.cos(angles), angles])
    truth[:, 2] -= math.tau * np.round(truth[:, 2] / math.tau)
    ends = np.vstack([np.column_stack([np.arange(count - 1), np.arange(1, count)]), [[0, count - 1]]])
    measured = relative(truth[ends[:, 1]], truth[ends[:, 0]])
    information = np.tile(INFORMATION, (len(ends), 1, 1))
    return truth, PoseGraph(truth, ends.astype(np.int64), measured, information, np.zeros(len(ends), np.bool_))


def chained(graph: PoseGraph) -> Floats:
    """Poses by composing the first N − 1 constraints, [N, 3]."""
    poses = [graph.poses[0]]
    for measured in graph.measured[: len(graph.poses) - 1]:
        poses.append(compose(poses[-1], measured))
    return np.array(poses)


def test_a_graph_without_errors_is_solved_exactly() -> None:
    truth, graph = ring()
    rng = np.random.default_rng(0)
    disturbed = truth + rng.normal(0.0, 0.2, truth.shape) * (np.arange(len(truth)) > 0)[:, None]
    solved = optimized(replace(graph, poses=disturbed))
    np.testing.assert_allclose(relative(solved.poses, truth), 0.0, atol=1e-6)
    assert constraint_errors(solved).max() < 1e-5


def test_a_closure_spreads_the_error_over_the_loop() -> None:
    truth, graph = ring()
    measured = graph.measured.copy()
    measured[:-1, 2] += 0.01  # rad by which every step turns too far
    drifted = replace(graph, measured=measured)
    before = chained(drifted)
    solved = optimized(replace(drifted, poses=before))
    error, error_before = (np.hypot(*(poses - truth)[:, :2].T) for poses in (solved.poses, before))
    assert error.max() < 0.2 * error_before.max()


def test_a_false_closure_among_true_ones_is_down_weighted() -> None:
    truth, graph = ring()
    ends = np.vstack([graph.ends, [[5, 35], [2, 38], [0, 20]]])
    measured = np.vstack([graph.measured, relative(truth[[35, 38]], truth[[5, 2]]), [[0.0, 0.0, 0.0]]])
    robust = np.arange(len(ends)) >= len(ends) - 4
    information = np.tile(INFORMATION, (len(ends), 1, 1))
    solved = optimized(PoseGraph(truth, ends, measured, information, robust))
    assert np.hypot(*(solved.poses - truth)[:, :2].T).max() < 0.1
    trusted = optimized(PoseGraph(truth, ends, measured, information, np.zeros(len(ends), np.bool_)))
    assert np.hypot(*(trusted.poses - truth)[:, :2].T).max() > 0.5


def test_a_true_closure_after_a_long_drift_is_not_an_outlier() -> None:
    truth, graph = ring()
    bent = graph.measured.copy()
    bent[:-1, 2] += 0.005  # odometry that turns too far with every step: 11° in all
    robust = np.arange(len(bent)) == len(bent) - 1
    drifted = replace(graph, measured=bent, robust=robust)
    drifted = replace(drifted, poses=chained(drifted), information=np.tile(100.0 * INFORMATION, (len(bent), 1, 1)))
    assert constraint_errors(drifted)[-1] > 50.0
    solved = optimized(drifted)
    assert constraint_errors(solved).max() < 5.0
    assert np.hypot(*(solved.poses[-1] - truth[-1])[:2]) < 0.1


def test_a_graph_without_constraints_is_returned_unchanged() -> None:
    lone = PoseGraph(
        np.zeros((1, 3)), np.zeros((0, 2), np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0, bool)
    )
    assert optimized(lone) is lone


@given(x=st.floats(-3, 3), y=st.floats(-3, 3), theta=st.floats(-3, 3))
def test_transforming_a_covariance_back_restores_it(x: float, y: float, theta: float) -> None:
    covariance = np.array([[0.04, 0.01, 0.0], [0.01, 0.02, 0.001], [0.0, 0.001, 0.003]])
    pose = Pose(x, y, theta)
    np.testing.assert_allclose(
        transform_covariance(transform_covariance(covariance, pose), pose.inverse), covariance, atol=1e-9
    )
    np.testing.assert_allclose(rotate_covariance(rotate_covariance(covariance, theta), -theta), covariance, atol=1e-12)


def test_propagated_covariances_agree_with_samples() -> None:
    steps = np.array([[1.0, 0.0, 0.3], [2.0, 0.5, -0.8], [1.5, 0.0, 0.2]])
    covariance = np.diag([0.01**2, 0.02**2, 0.01**2])
    ends = np.array([[0, 1], [1, 2], [2, 3]])
    found = relative_covariances(0, 4, ends, steps, np.tile(covariance, (3, 1, 1)))
    rng = np.random.default_rng(0)
    poses = np.zeros((20_000, 3))
    for step in steps:
        noisy = compose(np.tile(step, (len(poses), 1)), rng.normal(size=poses.shape) * np.sqrt(np.diag(covariance)))
        poses = compose(poses, noisy)
    exact = np.zeros(3)
    for step in steps:
        exact = compose(exact, step)
    sampled = np.cov(relative(poses, np.tile(exact, (len(poses), 1))).T)
    np.testing.assert_allclose(found[3], sampled, rtol=0.08, atol=2e-5)
    # The same path in reverse gives the same covariance.
    back = relative_covariances(3, 4, ends, steps, np.tile(covariance, (3, 1, 1)))
    np.testing.assert_allclose(transform_covariance(back[0], Pose.from_array(exact).inverse), found[3], atol=1e-9)


def test_unreachable_nodes_have_infinite_covariance_and_closures_shorten_paths() -> None:
    ends, steps = np.array([[0, 1], [1, 2]]), np.array([[5.0, 0.0, 0.0], [5.0, 0.0, 0.0]])
    covariances = np.tile(np.diag([0.1, 0.1, 0.01]), (2, 1, 1))
    alone = relative_covariances(0, 4, ends, steps, covariances)
    assert np.isinf(alone[3]).all()
    closed = relative_covariances(
        0,
        4,
        np.vstack([ends, [[0, 2]]]),
        np.vstack([steps, [[10.0, 0.0, 0.0]]]),
        np.concatenate([covariances, np.diag([0.001, 0.001, 0.001])[None]]),
    )
    assert closed[2, 0, 0] == pytest.approx(0.001)
    assert closed[2, 0, 0] < alone[2, 0, 0]
