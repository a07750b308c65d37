"""Repair of coarse and constant time stamps."""

from __future__ import annotations

import numpy as np
import pytest

from wherry.logs.timestamps import increasing_times


def test_increasing_and_decreasing_times_are_unchanged() -> None:
    for times in (np.array([1.0, 2.0, 2.5]), np.array([1.0, 1.0, 0.5]), np.array([3.0])):
        assert increasing_times(times) is times


def test_scans_with_equal_stamps_are_spread_to_the_next_stamp() -> None:
    times = np.array([10.0, 10.0, 11.0, 11.0, 11.0, 11.0, 12.0, 12.0])
    assert increasing_times(times) == pytest.approx([10.0, 10.5, 11.0, 11.25, 11.5, 11.75, 12.0, 12.0 + 1 / 3])


def test_a_constant_stamp_gives_one_scan_per_second() -> None:
    assert increasing_times(np.full(4, 7.0)) == pytest.approx([7.0, 8.0, 9.0, 10.0])
