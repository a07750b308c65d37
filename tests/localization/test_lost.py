"""The probability of being lost is calibrated, remembers a second or so, and can be fitted anew."""

from __future__ import annotations

import numpy as np
import pytest

from wherry.localization.agreement import Agreement
from wherry.localization.lost import Calibration, LostDetector, LostModel, fit, fit_calibration


def seen(blocked: float, passed: float) -> Agreement:
    return Agreement(1.0 - blocked - passed, blocked, passed, 0.0, 0.0, 180)


FITS = seen(0.02, 0.01)
BOX_AHEAD = seen(0.25, 0.01)
WRONG = seen(0.35, 0.3)


def usual_detector(usual: Agreement = FITS) -> LostDetector:
    """One that has seen scans that fit for ten seconds."""
    detector = LostDetector()
    for i in range(100):
        detector.observe(i / 10, usual)
    return detector


def test_before_any_scan_it_is_the_prior() -> None:
    assert LostDetector().probability == LostDetector().suspicion == LostModel().prior


def test_scans_that_fit_never_make_it_rise() -> None:
    detector = LostDetector()
    for i in range(1000):
        assert detector.observe(i / 10, FITS) < LostModel().prior
        assert detector.suspicion < LostModel().prior
    assert detector.probability < 1e-3
    assert detector.suspicion < 1e-4


def test_a_box_right_ahead_is_no_alarm_however_long_it_stands_there() -> None:
    detector = usual_detector()
    for i in range(1000):
        assert detector.observe(10.0 + i / 10, BOX_AHEAD) < 0.25
        assert detector.suspicion < 0.1
    assert detector.probability < 0.01  # by now it is a usual sight


def test_a_wrong_place_is_known_at_once_but_one_scan_is_not_enough_to_leave_the_place() -> None:
    detector = usual_detector()
    stated = []
    for i in range(20):
        stated.append((detector.observe(10 + i / 10, WRONG), detector.suspicion))
    assert stated[0][0] > 0.5
    assert stated[0][1] < 0.5
    assert min(stated[-1]) > 0.9
    for i in range(20):
        detector.observe(12 + i / 10, FITS)
    assert max(detector.probability, detector.suspicion) < 0.1


def test_on_a_map_that_never_fits_well_a_scan_that_does_not_is_no_proof() -> None:
    detector, clean = LostDetector(), usual_detector()
    rng = np.random.default_rng(0)
    for i in range(100):
        detector.observe(i / 10, seen(rng.uniform(0.0, 0.4), 0.02))
    changed = seen(0.5, 0.03)
    assert clean.contradiction(changed) > 3.0 * detector.contradiction(changed)
    assert clean.observe(10.0, changed) > 2.0 * detector.observe(10.0, changed)


def test_what_a_lost_robot_sees_does_not_become_usual() -> None:
    detector = usual_detector(seen(0.0, 0.0))
    hardly = Agreement(0.13, 0.06, 0.0, 0.81, -2.6, 180)  # most beams leave the map: the evidence is next to none
    assert LostModel().evidence(hardly) < 0.0
    for i in range(10):
        detector.observe(10.0 + i / 10, WRONG)
    contradiction = detector.contradiction(hardly)
    for i in range(300):
        assert detector.observe(11.0 + i / 10, hardly) > 0.1
    assert detector.contradiction(hardly) == contradiction


def test_scans_without_beams_say_nothing() -> None:
    assert LostModel().evidence(Agreement(0.0, 0.0, 0.0, 0.0, 0.0, 0)) == 0.0


def test_beams_into_the_unknown_say_nothing() -> None:
    assert LostModel().evidence(Agreement(0.0, 0.0, 0.0, 1.0, -3.0, 180)) == 0.0


def test_a_rare_scan_is_suspicious_once_and_several_of_them_decide() -> None:
    detector = LostDetector()
    for i in range(10):
        detector.observe(6.0 * i, FITS)
    wrong = []
    for i in range(4):
        detector.observe(60.0 + 6.0 * i, WRONG)
        wrong.append(detector.suspicion)
    assert wrong[0] < 0.5
    assert wrong[-1] > 0.9


def test_reset_forgets() -> None:
    detector = LostDetector()
    detector.observe(0.0, WRONG)
    detector.reset()
    assert detector.probability == LostModel().prior


def test_fitting_finds_the_model_that_made_the_data() -> None:
    rng = np.random.default_rng(0)
    truth = LostModel(explained=-3.0, blocked=7.0, passed=12.0, most=100.0)
    agreements = [seen(*pair) for pair in rng.dirichlet([1.0, 1.0, 3.0], 20_000)[:, :2]]
    odds = np.array([truth.evidence(agreement) for agreement in agreements])
    lost = rng.random(len(odds)) < 1.0 / (1.0 + np.exp(-odds))
    balance = np.log((1.0 - lost.mean()) / lost.mean())  # the fit takes both kinds as equally frequent
    found = fit(agreements, lost)
    assert found.explained == pytest.approx(-3.0 + balance, abs=0.3)
    assert found.blocked == pytest.approx(7.0 + balance, rel=0.1)
    assert found.passed == pytest.approx(12.0 + balance, rel=0.1)


def test_calibrating_finds_the_coefficients_that_made_the_data_at_the_rate_that_is_asked_for() -> None:
    rng = np.random.default_rng(1)
    truth = Calibration(constant=-4.0, recent=0.5, contradiction=1.5)
    features = np.column_stack([rng.uniform(-3.0, 4.0, 20_000), rng.exponential(8.0, 20_000)])
    odds = np.array([truth.log_odds(*row) for row in features.tolist()])
    lost = rng.random(len(odds)) < 1.0 / (1.0 + np.exp(-odds))
    found = fit_calibration(features, lost, np.ones(len(odds)))
    assert found.constant == pytest.approx(truth.constant, abs=0.2)
    assert found.recent == pytest.approx(truth.recent, abs=0.05)
    assert found.contradiction == pytest.approx(truth.contradiction, abs=0.1)
    rarer = fit_calibration(features, lost, np.where(lost, 0.1, 1.0))
    assert rarer.constant == pytest.approx(truth.constant + np.log(0.1), abs=0.2)
