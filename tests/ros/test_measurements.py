from __future__ import annotations

import contextlib
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wherry.robot import Odometry, Scan, Velocity
from wherry.ros.decoding import MessageError
from wherry.ros.nodes.errors import TimeMovedBackwardsError
from wherry.ros.nodes.measurements import MeasurementSequencer, StampValidator
from wherry.space.pose import Pose


def odometry(time: float, x: float | None = None) -> Odometry:
    return Odometry(time, Pose(time if x is None else x), Velocity())


def scan(time: float) -> Scan:
    return Scan(time, np.ones(4), 0.0, 1.0, 0.0, 9.0)


def test_scan_with_the_time_of_odometry_is_returned_at_once() -> None:
    sequencer = MeasurementSequencer()
    assert sequencer.add_odometry(odometry(1.0)) == (odometry(1.0),)
    (returned,) = sequencer.add_scan(scan(1.0))
    assert returned.time == 1.0


def test_scan_waits_for_odometry() -> None:
    sequencer = MeasurementSequencer()
    assert sequencer.add_scan(scan(1.0)) == ()
    first, second = sequencer.add_odometry(odometry(1.0))
    assert isinstance(first, Odometry)
    assert isinstance(second, Scan)


def test_scan_between_two_readings_gets_interpolated_odometry() -> None:
    sequencer = MeasurementSequencer()
    sequencer.add_odometry(odometry(1.0))
    assert sequencer.add_scan(scan(1.25)) == ()
    between, returned, last = sequencer.add_odometry(odometry(2.0))
    assert isinstance(between, Odometry)
    assert (between.time, between.pose.x) == (1.25, 1.25)
    assert returned.time == 1.25
    assert last == odometry(2.0)


def test_late_scan_gets_the_pose_of_its_time_and_the_latest_time() -> None:
    sequencer = MeasurementSequencer()
    for time in (1.0, 1.5, 2.0):
        sequencer.add_odometry(odometry(time))
    past, returned, last = sequencer.add_scan(scan(1.25))
    assert isinstance(past, Odometry)
    assert (past.time, past.pose.x) == (2.0, 1.25)
    assert returned.time == 2.0
    assert last == odometry(2.0)


def test_headings_are_interpolated_the_short_way_around() -> None:
    sequencer = MeasurementSequencer()
    sequencer.add_odometry(Odometry(0.0, Pose(theta=3.1), Velocity()))
    sequencer.add_scan(scan(0.5))
    between = sequencer.add_odometry(Odometry(1.0, Pose(theta=-3.1), Velocity()))[0]
    assert isinstance(between, Odometry)
    assert abs(between.pose.theta) == pytest.approx(np.pi)


def test_scan_older_than_all_odometry_is_rejected() -> None:
    sequencer = MeasurementSequencer()
    sequencer.add_odometry(odometry(5.0))
    with pytest.raises(MessageError, match="odometry begins"):
        sequencer.add_scan(scan(4.0))


@given(
    st.lists(st.integers(0, 40), min_size=1, max_size=12),
    st.lists(st.integers(0, 40), min_size=1, max_size=12),
    st.randoms(use_true_random=False),
)
def test_times_never_decrease_and_every_scan_has_odometry(ticks: list[int], turns: list[int], order: object) -> None:
    # Each topic is in order; only the interleaving is random.
    sources = [[odometry(t / 20) for t in sorted(set(ticks))], [scan(t / 20 + 0.01) for t in sorted(set(turns))]]
    sequencer, out = MeasurementSequencer(), []
    while any(sources):
        source = order.choice([source for source in sources if source])  # type: ignore[attr-defined]
        item = source.pop(0)
        with contextlib.suppress(MessageError):  # older than all odometry
            out += sequencer.add_odometry(item) if isinstance(item, Odometry) else sequencer.add_scan(item)
    assert all(earlier.time <= later.time for earlier, later in pairwise(out))
    for before, item in pairwise(out):
        if isinstance(item, Scan):
            assert isinstance(before, Odometry)
            assert before.time == item.time


def test_increasing_stamps_are_accepted() -> None:
    stamps = StampValidator("/scan")
    for stamp in (100.0, 100.1, 100.1, 100.9):
        stamps.check(stamp)


@pytest.mark.parametrize("outlier", [0.0, 99.9, 150.0, 1e9])
def test_isolated_outlier_is_rejected(outlier: float) -> None:
    stamps = StampValidator("/scan")
    stamps.check(100.0)
    for step in range(20):
        with pytest.raises(MessageError, match="stamp"):
            stamps.check(outlier)
        stamps.check(100.1 + step / 10)


def test_gap_is_accepted_once_confirmed() -> None:
    stamps = StampValidator("/scan")
    stamps.check(100.0)
    for step in range(4):
        with pytest.raises(MessageError):
            stamps.check(110.0 + step / 10)
    stamps.check(110.4)
    stamps.check(110.5)


def test_confirmed_earlier_time_is_an_error() -> None:
    stamps = StampValidator("/scan")
    stamps.check(100.0)
    for step in range(4):
        with pytest.raises(MessageError):
            stamps.check(step / 10)
    with pytest.raises(TimeMovedBackwardsError, match="/scan: time moved backwards from 100"):
        stamps.check(0.4)


def test_outliers_that_do_not_agree_are_always_rejected() -> None:
    stamps = StampValidator("/scan")
    stamps.check(100.0)
    for step in range(50):
        with pytest.raises(MessageError):
            stamps.check(1000.0 * (step % 7) - 500.0)
