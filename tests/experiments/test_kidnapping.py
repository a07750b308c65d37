"""Kidnapping in simulation, and the verdicts on the paper's claims."""

from __future__ import annotations

import numpy as np
import pytest

from wherry.experiments.localization.filter_comparison import FILTERS, FilterMetrics, claims
from wherry.experiments.localization.kidnapping import KidnappingSettings, run, summarize


@pytest.mark.slow
def test_kidnapped_robot_is_relocalized_without_false_alarms() -> None:
    result = summarize(
        list(run(KidnappingSettings(tracking_seconds=60.0, kidnappings=10, seconds_per_kidnapping=20.0)))
    )
    assert result.tracking_rmse_m < 0.03
    assert result.false_alarms == 0
    assert result.relocalizations == 0
    assert np.count_nonzero(result.recovery_seconds < 20.0) >= 9
    assert result.reliability.cases == pytest.approx((60 + 200) * 10, abs=15)
    assert result.reliability.brier < 0.2 * result.reliability.base_brier
    assert result.reliability.calibration_error < 0.02


def test_claims_depend_on_the_metrics() -> None:
    good = [FilterMetrics(name, 0.02, 0.05, 20_000.0, 500.0, 1.0, 1.0) for name in FILTERS]
    bad_markov = FilterMetrics("grid Markov", 0.2, 0.5, 500_000.0, 20.0, 1.0, 1.0)
    bad_ekf = FilterMetrics("EKF", 0.02, 0.05, 96.0, 2000.0, 0.0, 0.0)
    assert all(claim.holds for claim in claims([bad_ekf, bad_markov, *good[2:]]))
    assert not any(claim.holds for claim in claims(good))
