from __future__ import annotations

import contextlib
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wherry.robot import Odometry, Scan, Velocity
from wherry.ros.decoding import MessageError
from wherry.ros.nodes.measurements import Row, StampGuard, TimeWentBackError
from wherry.space.pose import Pose


def odometry(time: float, x: float | None = None) -> Odometry:
    return Odometry(time, Pose(time if x is None else x), Velocity())


def scan(time: float) -> Scan:
    return Scan(time, np.ones(4), 0.0, 1.0, 0.0, 9.0)


def test_a_scan_of_odometrys_instant_follows_it_at_once() -> None:
    row = Row()
    assert row.hear_odometry(odometry(1.0)) == (odometry(1.0),)
    (there,) = row.hear_scan(scan(1.0))
    assert there.time == 1.0


def test_a_scan_that_comes_first_waits() -> None:
    row = Row()
    assert row.hear_scan(scan(1.0)) == ()
    first, second = row.hear_odometry(odometry(1.0))
    assert isinstance(first, Odometry)
    assert isinstance(second, Scan)


def test_a_scan_in_between_gets_odometry_of_its_own() -> None:
    row = Row()
    row.hear_odometry(odometry(1.0))
    assert row.hear_scan(scan(1.25)) == ()
    between, there, last = row.hear_odometry(odometry(2.0))
    assert isinstance(between, Odometry)
    assert (between.time, between.pose.x) == (1.25, 1.25)
    assert there.time == 1.25
    assert last == odometry(2.0)


def test_a_late_scan_gets_the_pose_of_its_time_and_the_time_of_now() -> None:
    row = Row()
    for time in (1.0, 1.5, 2.0):
        row.hear_odometry(odometry(time))
    then, there, last = row.hear_scan(scan(1.25))
    assert isinstance(then, Odometry)
    assert (then.time, then.pose.x) == (2.0, 1.25)
    assert there.time == 2.0
    assert last == odometry(2.0)


def test_headings_are_interpolated_the_short_way() -> None:
    row = Row()
    row.hear_odometry(Odometry(0.0, Pose(theta=3.1), Velocity()))
    row.hear_scan(scan(0.5))
    between = row.hear_odometry(Odometry(1.0, Pose(theta=-3.1), Velocity()))[0]
    assert isinstance(between, Odometry)
    assert abs(between.pose.theta) == pytest.approx(np.pi)


def test_a_scan_older_than_all_odometry_is_refused() -> None:
    row = Row()
    row.hear_odometry(odometry(5.0))
    with pytest.raises(MessageError, match="odometry begins"):
        row.hear_scan(scan(4.0))


@given(
    st.lists(st.integers(0, 40), min_size=1, max_size=12),
    st.lists(st.integers(0, 40), min_size=1, max_size=12),
    st.randoms(use_true_random=False),
)
def test_times_never_decrease_and_every_scan_has_its_pose(ticks: list[int], turns: list[int], order: object) -> None:
    # Each topic is in order; how the two interleave is random.
    sources = [[odometry(t / 20) for t in sorted(set(ticks))], [scan(t / 20 + 0.01) for t in sorted(set(turns))]]
    row, out = Row(), []
    while any(sources):
        source = order.choice([source for source in sources if source])  # type: ignore[attr-defined]
        item = source.pop(0)
        with contextlib.suppress(MessageError):  # older than all odometry
            out += row.hear_odometry(item) if isinstance(item, Odometry) else row.hear_scan(item)
    assert all(earlier.time <= later.time for earlier, later in pairwise(out))
    for before, item in pairwise(out):
        if isinstance(item, Scan):
            assert isinstance(before, Odometry)
            assert before.time == item.time


def test_stamps_that_go_on_are_accepted() -> None:
    guard = StampGuard("/scan")
    for stamp in (100.0, 100.1, 100.1, 100.9):
        guard.check(stamp)


@pytest.mark.parametrize("strange", [0.0, 99.9, 150.0, 1e9])
def test_a_single_strange_stamp_is_refused_and_forgotten(strange: float) -> None:
    guard = StampGuard("/scan")
    guard.check(100.0)
    for step in range(20):
        with pytest.raises(MessageError, match="stamp"):
            guard.check(strange)
        guard.check(100.1 + step / 10)


def test_a_gap_is_believed_when_it_is_confirmed() -> None:
    guard = StampGuard("/scan")
    guard.check(100.0)
    for step in range(4):
        with pytest.raises(MessageError):
            guard.check(110.0 + step / 10)
    guard.check(110.4)
    guard.check(110.5)


def test_time_that_goes_back_for_good_is_a_fault() -> None:
    guard = StampGuard("/scan")
    guard.check(100.0)
    for step in range(4):
        with pytest.raises(MessageError):
            guard.check(step / 10)
    with pytest.raises(TimeWentBackError, match="/scan: time went back from 100"):
        guard.check(0.4)


def test_strange_stamps_that_do_not_agree_are_refused_forever() -> None:
    guard = StampGuard("/scan")
    guard.check(100.0)
    for step in range(50):
        with pytest.raises(MessageError):
            guard.check(1000.0 * (step % 7) - 500.0)
