"""Units of time stamps, and repair of coarse and constant ones."""

from __future__ import annotations

import numpy as np
import pytest

from wherry.logs.timestamps import increasing_times, unit_of


def test_increasing_and_decreasing_times_are_unchanged() -> None:
    for times in (np.array([1.0, 2.0, 2.5]), np.array([1.0, 1.0, 0.5]), np.array([3.0])):
        assert increasing_times(times) is times


def test_scans_with_equal_stamps_are_spread_to_the_next_stamp() -> None:
    times = np.array([10.0, 10.0, 11.0, 11.0, 11.0, 11.0, 12.0, 12.0])
    assert increasing_times(times) == pytest.approx([10.0, 10.5, 11.0, 11.25, 11.5, 11.75, 12.0, 12.0 + 1 / 3])


def test_a_constant_stamp_gives_one_scan_per_second() -> None:
    assert increasing_times(np.full(4, 7.0)) == pytest.approx([7.0, 8.0, 9.0, 10.0])


@pytest.mark.parametrize("start", [2.0, 1000.0, 5000.0, 1e5, 1.6e9])
@pytest.mark.parametrize(("unit", "name"), [(1e-9, "nanoseconds"), (1e-6, "microseconds")])
@pytest.mark.parametrize("period", [0.02, 0.2])
def test_whole_numbers_of_a_clock_with_any_start_are_recognized(
    start: float, unit: float, name: str, period: float
) -> None:
    assert unit_of(np.round((start + period * np.arange(10)) / unit)) == (unit, name)


@pytest.mark.parametrize("period", [0.2, 10.0, 60.0])
def test_unix_times_are_recognized_by_their_size(period: float) -> None:
    times = 1.6e9 + period * np.arange(10)
    for unit, name in ((1e-9, "nanoseconds"), (1e-6, "microseconds"), (1e-3, "milliseconds"), (1.0, "seconds")):
        assert unit_of(times / unit) == (unit, name)


@pytest.mark.parametrize("times", [[], [0.0], [5.0, 6.0, 7.0], [0.02, 0.04], [1e5, 2e5, 3e5 + 0.5]])
def test_other_times_are_seconds(times: list[float]) -> None:
    assert unit_of(np.array(times)) == (1.0, "seconds")
