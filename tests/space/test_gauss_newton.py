"""Gauss–Newton steps with a prior."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wherry.space.gauss_newton import gauss_newton_step


def test_without_residuals_the_step_reaches_the_prior() -> None:
    pose, prior = np.array([1.0, 2.0, 3.0]), np.array([1.5, 1.0, -3.0])
    step = gauss_newton_step(pose, np.zeros(3), np.zeros((3, 3)), prior, np.eye(3), 0.0)
    assert step == pytest.approx([0.5, -1.0, math.tau - 6.0])


def test_prior_and_residuals_are_weighted_by_their_information() -> None:
    information = np.diag([3.0, 3.0, 3.0])
    gradient = information @ np.array([-1.0, 0.0, 0.0])  # the residuals alone ask for a step of 1 m in x
    step = gauss_newton_step(np.zeros(3), gradient, information, np.zeros(3), np.eye(3), 0.0)
    assert step == pytest.approx([0.75, 0.0, 0.0])


def test_damping_makes_an_undetermined_system_regular() -> None:
    step = gauss_newton_step(np.zeros(3), np.zeros(3), np.zeros((3, 3)), np.ones(3), np.zeros((3, 3)), 1.0)
    assert step == pytest.approx([0.0, 0.0, 0.0])
