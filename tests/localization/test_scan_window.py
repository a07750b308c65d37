"""The window keeps the last scans at a minimum period."""

from __future__ import annotations

import numpy as np
import pytest

from wherry.localization.agreement import ScanAgreement
from wherry.localization.scan_window import MAX_SCANS, MIN_PERIOD, ScanWindow, WindowScan
from wherry.space.pose import Pose


def window_scan(number: int, lost_probability: float = 0.9) -> WindowScan:
    agreement = ScanAgreement(0.5 + 0.01 * number, 0.2, 0.1, 0.2, -1.0, 180)
    return WindowScan(number * MIN_PERIOD, Pose(float(number)), np.zeros((1, 2)), agreement, lost_probability)


def test_scan_that_follows_too_soon_is_not_added() -> None:
    window = ScanWindow()
    assert window.add(window_scan(0))
    assert not window.add(WindowScan(0.4 * MIN_PERIOD, Pose(), np.zeros((1, 2)), window_scan(0).agreement, 0.9))
    assert window.add(window_scan(1))
    assert len(window) == 2


def test_full_window_drops_the_oldest_scan() -> None:
    window = ScanWindow()
    for number in range(MAX_SCANS + 2):
        assert window.is_full == (number >= MAX_SCANS)
        window.add(window_scan(number))
    poses = [pose.x for pose, _ in window.relative_to(Pose())]
    assert poses == [float(number) for number in range(2, MAX_SCANS + 2)]
    assert window.mean_agreement().inlier_fraction == pytest.approx(0.5 + 0.01 * (MAX_SCANS + 3) / 2)


def test_lost_probability_must_be_exceeded_at_every_scan() -> None:
    window = ScanWindow()
    window.add(window_scan(0))
    assert window.is_lost_throughout(0.5)
    window.add(window_scan(1, lost_probability=0.4))
    assert not window.is_lost_throughout(0.5)
    window.clear()
    assert len(window) == 0
