"""Detection of being lost: evidence, baseline, and the two probabilities."""

from __future__ import annotations

import numpy as np

from wherry.localization.agreement import ScanAgreement
from wherry.localization.lost import EvidenceModel, LostDetector


def agreement(blocked: float, passed: float) -> ScanAgreement:
    return ScanAgreement(1.0 - blocked - passed, blocked, passed, 0.0, 0.0, 180)


GOOD = agreement(0.02, 0.01)
BLOCKED = agreement(0.25, 0.01)
WRONG = agreement(0.35, 0.3)


def detector_with_baseline(baseline: ScanAgreement = GOOD) -> LostDetector:
    """A detector after ten seconds of scans with the same agreement."""
    detector = LostDetector()
    for i in range(100):
        detector.update(i / 10, baseline)
    return detector


def test_probability_before_any_scan_is_the_prior() -> None:
    assert LostDetector().probability == LostDetector().sustained_probability == EvidenceModel().prior


def test_good_scans_never_raise_the_probability() -> None:
    detector = LostDetector()
    for i in range(1000):
        assert detector.update(i / 10, GOOD) < EvidenceModel().prior
        assert detector.sustained_probability < EvidenceModel().prior
    assert detector.probability < 1e-3
    assert detector.sustained_probability < 1e-4


def test_box_ahead_raises_no_alarm() -> None:
    detector = detector_with_baseline()
    for i in range(1000):
        assert detector.update(10.0 + i / 10, BLOCKED) < 0.25
        assert detector.sustained_probability < 0.1
    assert detector.probability < 0.01  # by now the box is part of the baseline


def test_wrong_pose_is_detected_by_one_scan_and_sustained_by_several() -> None:
    detector = detector_with_baseline()
    stated = []
    for i in range(20):
        stated.append((detector.update(10 + i / 10, WRONG), detector.sustained_probability))
    assert stated[0][0] > 0.5
    assert stated[0][1] < 0.5
    assert min(stated[-1]) > 0.9
    for i in range(20):
        detector.update(12 + i / 10, GOOD)
    assert max(detector.probability, detector.sustained_probability) < 0.1


def test_outlier_scan_weighs_less_on_an_outdated_map() -> None:
    detector, clean = LostDetector(), detector_with_baseline()
    rng = np.random.default_rng(0)
    for i in range(100):
        detector.update(i / 10, agreement(rng.uniform(0.0, 0.4), 0.02))
    changed = agreement(0.5, 0.03)
    assert clean.z_score(changed) > 3.0 * detector.z_score(changed)
    assert clean.update(10.0, changed) > 2.0 * detector.update(10.0, changed)


def test_scans_of_a_lost_robot_do_not_change_the_baseline() -> None:
    detector = detector_with_baseline(agreement(0.0, 0.0))
    uninformative = ScanAgreement(0.13, 0.06, 0.0, 0.81, -2.6, 180)  # most beams leave the map
    assert EvidenceModel().evidence(uninformative) < 0.0
    for i in range(10):
        detector.update(10.0 + i / 10, WRONG)
    z_score = detector.z_score(uninformative)
    for i in range(300):
        assert detector.update(11.0 + i / 10, uninformative) > 0.1
    assert detector.z_score(uninformative) == z_score


def test_scan_without_beams_has_no_evidence() -> None:
    assert EvidenceModel().evidence(ScanAgreement(0.0, 0.0, 0.0, 0.0, 0.0, 0)) == 0.0


def test_beams_into_unknown_space_have_no_evidence() -> None:
    assert EvidenceModel().evidence(ScanAgreement(0.0, 0.0, 0.0, 1.0, -3.0, 180)) == 0.0


def test_infrequent_scans_count_once_each() -> None:
    detector = LostDetector()
    for i in range(10):
        detector.update(6.0 * i, GOOD)
    wrong = []
    for i in range(4):
        detector.update(60.0 + 6.0 * i, WRONG)
        wrong.append(detector.sustained_probability)
    assert wrong[0] < 0.5
    assert wrong[-1] > 0.9


def test_reset_restores_the_prior() -> None:
    detector = LostDetector()
    detector.update(0.0, WRONG)
    detector.reset()
    assert detector.probability == EvidenceModel().prior
