"""Pose graphs whose answers are known, and covariances along ways."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wherry.mapping.pose_graph import PoseGraph, edge_errors, optimized
from wherry.mapping.uncertainty import carried, relative_covariances, turned
from wherry.space.pose import Floats, Pose, compose, relative

INFORMATION = np.diag([100.0, 100.0, 400.0])


def ring(count: int = 40) -> tuple[Floats, PoseGraph]:
    """Poses on a circle, driven around once, with a closure; the graph starts from nothing but odometry."""
    angles = np.linspace(0.0, math.tau, count)
    truth = np.column_stack([5.0 * np.sin(angles), 5.0 - 5.0 * np.cos(angles), angles])
    truth[:, 2] -= math.tau * np.round(truth[:, 2] / math.tau)
    ends = np.vstack([np.column_stack([np.arange(count - 1), np.arange(1, count)]), [[0, count - 1]]])
    measured = relative(truth[ends[:, 1]], truth[ends[:, 0]])
    information = np.tile(INFORMATION, (len(ends), 1, 1))
    return truth, PoseGraph(truth, ends.astype(np.int64), measured, information, np.zeros(len(ends), np.bool_))


def chained(graph: PoseGraph) -> Floats:
    """[N, 3] poses by putting the first N − 1 edges together."""
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
    assert edge_errors(solved).max() < 1e-5


def test_a_closure_spreads_the_error_over_the_loop() -> None:
    truth, graph = ring()
    measured = graph.measured.copy()
    measured[:-1, 2] += 0.01  # every step turns a little too far
    drifted = replace(graph, measured=measured)
    before = chained(drifted)
    solved = optimized(replace(drifted, poses=before))
    error, error_before = (np.hypot(*(poses - truth)[:, :2].T) for poses in (solved.poses, before))
    assert error.max() < 0.2 * error_before.max()


def test_one_wrong_closure_among_right_ones_is_outvoted() -> None:
    truth, graph = ring()
    ends = np.vstack([graph.ends, [[5, 35], [2, 38], [0, 20]]])
    measured = np.vstack([graph.measured, relative(truth[[35, 38]], truth[[5, 2]]), [[0.0, 0.0, 0.0]]])
    robust = np.arange(len(ends)) >= len(ends) - 4
    information = np.tile(INFORMATION, (len(ends), 1, 1))
    solved = optimized(PoseGraph(truth, ends, measured, information, robust))
    assert np.hypot(*(solved.poses - truth)[:, :2].T).max() < 0.1
    trusted = optimized(PoseGraph(truth, ends, measured, information, np.zeros(len(ends), np.bool_)))
    assert np.hypot(*(trusted.poses - truth)[:, :2].T).max() > 0.5


def test_a_true_closure_after_a_long_drift_is_listened_to() -> None:
    truth, graph = ring()
    bent = graph.measured.copy()
    bent[:-1, 2] += 0.005  # odometry that turns too far with every step: 11° in all
    robust = np.arange(len(bent)) == len(bent) - 1
    drifted = replace(graph, measured=bent, robust=robust)
    drifted = replace(drifted, poses=chained(drifted), information=np.tile(100.0 * INFORMATION, (len(bent), 1, 1)))
    assert edge_errors(drifted)[-1] > 50.0
    solved = optimized(drifted)
    assert edge_errors(solved).max() < 5.0
    assert np.hypot(*(solved.poses[-1] - truth[-1])[:2]) < 0.1


def test_nothing_to_solve_is_left_alone() -> None:
    lone = PoseGraph(
        np.zeros((1, 3)), np.zeros((0, 2), np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0, bool)
    )
    assert optimized(lone) is lone


@given(x=st.floats(-3, 3), y=st.floats(-3, 3), theta=st.floats(-3, 3))
def test_a_covariance_carried_there_and_back_is_the_same(x: float, y: float, theta: float) -> None:
    covariance = np.array([[0.04, 0.01, 0.0], [0.01, 0.02, 0.001], [0.0, 0.001, 0.003]])
    pose = Pose(x, y, theta)
    np.testing.assert_allclose(carried(carried(covariance, pose), pose.inverse), covariance, atol=1e-9)
    np.testing.assert_allclose(turned(turned(covariance, theta), -theta), covariance, atol=1e-12)


def test_uncertainty_grows_along_the_way_as_samples_do() -> None:
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
    # From the other end, the same ways lead back.
    back = relative_covariances(3, 4, ends, steps, np.tile(covariance, (3, 1, 1)))
    np.testing.assert_allclose(carried(back[0], Pose.from_array(exact).inverse), found[3], atol=1e-9)


def test_what_cannot_be_reached_is_infinitely_uncertain_and_closures_shorten_the_way() -> None:
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
