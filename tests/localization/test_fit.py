"""The fit of scans to a map: 1 for inliers only, less for blocked beams, and least for beams through walls."""

from __future__ import annotations

import pytest

from wherry.localization.agreement import ScanAgreement
from wherry.localization.fit import MIN_COVERAGE, MIN_FIT, MapFit


def agreement(inliers: float, blocked: float, passed: float, beams: int = 100) -> ScanAgreement:
    return ScanAgreement(inliers, blocked, passed, 1.0 - inliers - blocked - passed, -1.0, beams)


def fit_of(*scans: ScanAgreement) -> MapFit:
    fit = MapFit()
    for scan in scans:
        fit = fit.with_scan(scan)
    return fit


def test_inliers_alone_fit_perfectly() -> None:
    fit = fit_of(agreement(1.0, 0.0, 0.0))
    assert (fit.value, fit.coverage, fit.is_fitting) == (1.0, 1.0, True)


def test_passed_beams_weigh_more_than_blocked_ones() -> None:
    assert fit_of(agreement(0.5, 0.0, 0.5)).value == 0.5
    assert fit_of(agreement(0.5, 0.5, 0.0)).value == pytest.approx(0.5 / (0.5 + 0.5 * 5.8 / 14.3))


def test_beams_in_unknown_space_say_nothing_but_that_the_map_lacks_the_place() -> None:
    assert fit_of(agreement(0.6, 0.0, 0.0)).value == 1.0
    covered = fit_of(agreement(MIN_COVERAGE, 0.0, 0.0))
    assert covered.is_fitting
    assert not fit_of(agreement(MIN_COVERAGE - 0.01, 0.0, 0.0)).is_fitting


def test_a_building_with_much_new_clutter_still_fits() -> None:
    assert fit_of(agreement(0.6, 0.38, 0.02)).is_fitting


def test_another_building_does_not_fit() -> None:
    fit = fit_of(agreement(0.5, 0.2, 0.25))  # the best that a foreign map gave in the recorded logs
    assert fit.value < MIN_FIT
    assert not fit.is_fitting


def test_scans_are_averaged_and_those_without_readings_are_left_out() -> None:
    fit = fit_of(agreement(1.0, 0.0, 0.0), agreement(0.0, 0.0, 1.0), agreement(0.0, 0.0, 0.0, beams=0))
    assert (fit.value, fit.scans) == (0.5, 2)


def test_nothing_fits_without_scans() -> None:
    assert not MapFit().is_fitting
    assert (MapFit().value, MapFit().coverage) == (0.0, 0.0)


def test_a_moving_average_forgets() -> None:
    fit = MapFit()
    for _ in range(20):
        fit = fit.with_scan(agreement(1.0, 0.0, 0.0), decay=0.5)
    for _ in range(20):
        fit = fit.with_scan(agreement(0.0, 0.0, 1.0), decay=0.5)
    assert fit.value < 1e-5


@pytest.mark.parametrize(
    ("scan", "mismatch"),
    [
        (agreement(MIN_COVERAGE - 0.1, 0.0, 0.0), "it covers only 40% of what the lidar sees"),
        (agreement(0.6999, 0.0, 0.3001), "fit 0.69, at least 0.7 on the right map"),
        (agreement(0.388, 0.0, 0.612), "fit 0.39, at least 0.7 on the right map"),
        (agreement(0.7, 0.0, 0.2), ""),
    ],
)
def test_the_mismatch_is_that_of_the_limit_that_is_missed(scan: ScanAgreement, mismatch: str) -> None:
    assert fit_of(scan).mismatch == mismatch
    assert fit_of(scan).is_fitting is not bool(mismatch)
