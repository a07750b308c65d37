"""Fitting the evidence and the calibration of lost detection."""

from __future__ import annotations

import numpy as np
import pytest

from wherry.experiments.localization.calibration import fit_calibration, fit_evidence
from wherry.localization.agreement import ScanAgreement
from wherry.localization.lost import EvidenceModel, LostCalibration, LostFeatures


def test_fitted_evidence_recovers_the_model_of_the_data() -> None:
    rng = np.random.default_rng(0)
    truth = EvidenceModel(inlier_weight=-3.0, blocked_weight=7.0, passed_weight=12.0, max_evidence=100.0)
    fractions = rng.dirichlet([1.0, 1.0, 3.0], 20_000)[:, :2]
    agreements = [ScanAgreement(1.0 - b - p, b, p, 0.0, 0.0, 180) for b, p in fractions]
    odds = np.array([truth.evidence(agreement) for agreement in agreements])
    lost = rng.random(len(odds)) < 1.0 / (1.0 + np.exp(-odds))
    balance = np.log((1.0 - lost.mean()) / lost.mean())  # the fit balances both classes
    found = fit_evidence(agreements, lost)
    assert found.inlier_weight == pytest.approx(-3.0 + balance, abs=0.3)
    assert found.blocked_weight == pytest.approx(7.0 + balance, rel=0.1)
    assert found.passed_weight == pytest.approx(12.0 + balance, rel=0.1)


def test_fitted_calibration_recovers_the_coefficients_at_the_weighted_base_rate() -> None:
    rng = np.random.default_rng(1)
    truth = LostCalibration(intercept=-4.0, mean_evidence_weight=0.5, z_score_weight=1.5)
    features = np.column_stack([rng.uniform(-3.0, 4.0, 20_000), rng.exponential(8.0, 20_000)])
    odds = np.array([truth.log_odds(LostFeatures(*row)) for row in features.tolist()])
    lost = rng.random(len(odds)) < 1.0 / (1.0 + np.exp(-odds))
    found = fit_calibration(features, lost, np.ones(len(odds)))
    assert found.intercept == pytest.approx(truth.intercept, abs=0.2)
    assert found.mean_evidence_weight == pytest.approx(truth.mean_evidence_weight, abs=0.05)
    assert found.z_score_weight == pytest.approx(truth.z_score_weight, abs=0.1)
    rarer = fit_calibration(features, lost, np.where(lost, 0.1, 1.0))
    assert rarer.intercept == pytest.approx(truth.intercept + np.log(0.1), abs=0.2)
