"""The probability of being lost is calibrated, remembers a second or so, and can be fitted anew."""

from __future__ import annotations

import numpy as np
import pytest

from wherry.localization.agreement import Agreement
from wherry.localization.lost import LostDetector, LostModel, fit


def seen(blocked: float, passed: float) -> Agreement:
    return Agreement(1.0 - blocked - passed, blocked, passed, 0.0, 0.0, 180)


FITS = seen(0.02, 0.01)
BOX_AHEAD = seen(0.25, 0.01)
WRONG = seen(0.35, 0.3)


def test_before_any_scan_it_is_the_prior() -> None:
    assert LostDetector().probability == LostModel().prior


def test_scans_that_fit_never_make_it_rise() -> None:
    detector = LostDetector()
    probabilities = [detector.observe(i / 10, FITS) for i in range(1000)]
    assert max(probabilities) < LostModel().prior
    assert max(probabilities[10:]) < 1e-4


def test_a_box_right_ahead_is_no_alarm_however_long_it_stands_there() -> None:
    detector = LostDetector()
    assert max(detector.observe(i / 10, BOX_AHEAD) for i in range(1000)) < 0.1


def test_a_wrong_place_is_noticed_within_two_seconds_and_forgotten_when_it_is_right_again() -> None:
    detector = LostDetector()
    for i in range(100):
        detector.observe(i / 10, FITS)
    wrong = [detector.observe(10 + i / 10, WRONG) for i in range(20)]
    assert wrong[0] < 0.5  # one scan is not enough
    assert wrong[-1] > 0.9
    right = [detector.observe(12 + i / 10, FITS) for i in range(20)]
    assert right[-1] < 0.1


def test_scans_without_beams_say_nothing() -> None:
    assert LostModel().evidence(Agreement(0.0, 0.0, 0.0, 0.0, 0.0, 0)) == 0.0


def test_beams_into_the_unknown_say_nothing() -> None:
    assert LostModel().evidence(Agreement(0.0, 0.0, 0.0, 1.0, -3.0, 180)) == 0.0


def test_a_rare_scan_counts_once_and_several_of_them_decide() -> None:
    detector = LostDetector()
    for i in range(10):
        detector.observe(6.0 * i, FITS)
    wrong = [detector.observe(60.0 + 6.0 * i, WRONG) for i in range(4)]
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
