"""The simulated robot is never lost by itself, notices when it is put somewhere else, and finds itself."""

from __future__ import annotations

import numpy as np
import pytest

from wherry.experiments.localization.kidnapping import Settings, run, summarize
from wherry.experiments.localization.study import CONTENDERS, Claim, Row, claims


@pytest.mark.slow
def test_ten_kidnappings() -> None:
    result = summarize(list(run(Settings(seconds=60.0, kidnappings=10, patience=20.0))))
    assert result.tracking_rmse_m < 0.03
    assert result.false_alarms == 0
    assert result.relocalizations == 0
    assert np.count_nonzero(result.recovered < 20.0) >= 9
    assert result.reliability.cases == pytest.approx((60 + 200) * 10, abs=15)
    assert result.reliability.brier < 0.2 * result.reliability.base_brier
    assert result.reliability.calibration_error < 0.02


def test_the_claims_are_tried_and_not_just_stated() -> None:
    good = [Row(name, 0.02, 0.05, 20_000.0, 500.0, 1.0, 1.0) for name in CONTENDERS]
    bad_markov = Row("grid Markov", 0.2, 0.5, 500_000.0, 20.0, 1.0, 1.0)
    bad_ekf = Row("EKF", 0.02, 0.05, 96.0, 2000.0, 0.0, 0.0)
    assert all(claim.holds for claim in claims([bad_ekf, bad_markov, *good[2:]]))
    assert not any(claim.holds for claim in claims(good))
    assert isinstance(claims(good)[0], Claim)
