"""Assembly of logs: outliers, clocks, coverage by odometry, and what is said about them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.logs.assembly import RecordedOdometry, RecordedScan, assemble_log
from wherry.logs.lidar_log import LidarLog
from wherry.logs.options import ReadingOptions
from wherry.robot import Scan
from wherry.space.pose import IDENTITY, Pose

SCANS = 400
PERIOD = 0.1  # s between scans
START = 1000.0  # s, stamp of the first scan
DELAY = 0.03  # s until the recorder receives a scan
RECORDER = 5e6  # s by which the recorder's clock is ahead
LENIENT = ReadingOptions(lenient=True)
STRICT = ReadingOptions()


def pose_at(time: float) -> Pose:
    """Pose of a robot on a circle of 2 m at a time, s."""
    angle = 0.25 * (time - START)
    return Pose(2.0 * math.sin(angle), 2.0 - 2.0 * math.cos(angle), angle)


def scan_at(index: int, beams: int = 36) -> Scan:
    time = START + index * PERIOD
    return Scan(time, np.full(beams, 2.0 + 0.001 * index), 0.0, math.tau / beams, 0.1, 10.0)


def scans(*, received: bool = False, own_poses: bool = False) -> list[RecordedScan]:
    return [
        RecordedScan(
            f"/scan, message {index + 1}",
            scan_at(index),
            pose_at(START + index * PERIOD) if own_poses else None,
            START + index * PERIOD + DELAY + RECORDER if received else None,
        )
        for index in range(SCANS)
    ]


def odometry(
    period: float = 0.02,
    first: float = START - 0.1,
    last: float = START + 41.0,
    ahead: float = 0.0,
    *,
    received: bool = False,
) -> list[RecordedOdometry]:
    return [
        RecordedOdometry(
            f"/odom, message {index + 1}",
            time + ahead,
            pose_at(time),
            time + 0.002 + RECORDER if received else None,
        )
        for index, time in enumerate(np.arange(first, last, period).tolist())
    ]


def assembled(
    recorded: Sequence[RecordedScan], readings: Sequence[RecordedOdometry] = (), options: ReadingOptions = STRICT
) -> LidarLog:
    return assemble_log("log", recorded, readings, IDENTITY, options)


def restamped(recorded: list[RecordedScan], stamps: dict[int, float]) -> list[RecordedScan]:
    return [entry.at(stamps[index]) if index in stamps else entry for index, entry in enumerate(recorded)]


def test_a_log_without_faults_is_kept_and_odometry_is_exact_on_the_arc() -> None:
    log = assembled(scans(), odometry(period=0.07))
    assert len(log.scans) == SCANS
    assert not log.notes
    assert not log.skipped
    for scan, reading in zip(log.scans, log.scan_odometry, strict=True):
        assert reading is not None
        assert reading.pose.is_near(pose_at(scan.time), 1e-9, 1e-9)


def test_scans_before_the_clock_was_set_are_dropped() -> None:
    recorded = restamped(scans(), {index: index * PERIOD for index in range(40)})
    recorded = [entry.at(entry.scan.time + 1.6e9) if index >= 40 else entry for index, entry in enumerate(recorded)]
    log = assembled(recorded, options=LENIENT)
    assert len(log.scans) == SCANS - 40
    assert log.notes[0].startswith("40 of 400 messages are left out")


def test_constant_stamps_of_odometry_are_replaced_by_times_of_the_recorder() -> None:
    readings = [entry.at(0.0) for entry in odometry(received=True)]
    log = assembled(scans(received=True), readings)
    assert log.notes[0].endswith("constant time, 0.000000 s: the times at which the recorder received it are used")
    for scan, reading in zip(log.scans, log.scan_odometry, strict=True):
        assert reading is not None
        assert reading.pose.is_near(pose_at(scan.time), 0.02, 0.01)
    log = assembled(scans(), readings)
    assert log.notes == ("odometry is stamped with a constant time, 0.000000 s: the scans have no odometry",)


WILD_STAMPS = {
    "an hour ahead": {100: START + 3600.0},
    "an hour behind": {100: START - 3600.0},
    "the first one zero": {0: 0.0},
    "the first one ahead": {0: START + 3600.0},
    "the last one an hour ahead": {SCANS - 1: START + 3600.0},
    "slightly behind": {100: START + 9.85},
}


@pytest.mark.parametrize("stamps", WILD_STAMPS.values(), ids=WILD_STAMPS.keys())
def test_a_wild_stamp_drops_just_its_own_scan(stamps: dict[int, float]) -> None:
    (index,) = stamps
    recorded = restamped(scans(), stamps)
    with pytest.raises(InputError) as caught:
        assembled(recorded, odometry())
    assert caught.value.field == f"/scan, message {index + 1}"
    assert "--lenient" in caught.value.reason
    log = assembled(recorded, odometry(), LENIENT)
    expected = [scan_at(number).time for number in range(SCANS) if number != index]
    assert [scan.time for scan in log.scans] == expected
    assert len(log.skipped) == 1
    assert log.notes[0].startswith(f"1 of {SCANS + len(odometry()):,} messages is left out: 1 like ")


def test_two_halves_with_a_pause_of_an_hour_are_one_log() -> None:
    recorded = restamped(scans(), {index: START + 3600.0 + index * PERIOD for index in range(200, SCANS)})
    assert len(assembled(recorded).scans) == SCANS


def test_more_outliers_than_a_share_are_refused_by_the_most_frequent_reason() -> None:
    recorded = [entry for pair in zip(scans(), scans()[::-1], strict=True) for entry in pair]
    with pytest.raises(
        InputError, match=r"\d+ of 799 scans cannot be used, more than the 25%.*; most frequent: 200 like"
    ):
        assembled(recorded, options=LENIENT)


@pytest.mark.parametrize("first", [100, 720])
def test_a_scan_with_an_absurd_number_of_beams_is_the_outlier_even_as_the_first_one(first: int) -> None:
    recorded = [replace(scans()[0], scan=scan_at(0, beams=first)), *[
        replace(entry, scan=scan_at(index, beams=357 + index % 7)) for index, entry in enumerate(scans()) if index
    ]]  # fmt: skip
    with pytest.raises(InputError, match=r"/scan, message 1: has .* beams where the log's scans have 360"):
        assembled(recorded)
    log = assembled(recorded, options=LENIENT)
    assert {len(scan.ranges) for scan in log.scans} == set(range(357, 364))
    assert len(log.scans) == SCANS - 1


def test_a_lidar_that_changes_its_resolution_is_accepted() -> None:
    recorded = [replace(entry, scan=scan_at(n, 181 if n < 300 else 361)) for n, entry in enumerate(scans())]
    assert len(assembled(recorded).scans) == SCANS


LAST = len(odometry()) - 1
JUMPS = {"single": range(500, 501), "three": range(500, 503), "first": range(1), "last": range(LAST, LAST + 1)}


@pytest.mark.parametrize("wild", JUMPS.values(), ids=JUMPS.keys())
def test_outlier_poses_are_dropped_and_not_the_innocent_ones_after_them(wild: range) -> None:
    readings = odometry()
    readings = [replace(entry, pose=Pose(5e4, 0.0, 0.0)) if n in wild else entry for n, entry in enumerate(readings)]
    with pytest.raises(InputError, match=f"/odom, message {wild[0] + 1}: odometry jumps by "):
        assembled(scans(), readings)
    log = assembled(scans(), readings, LENIENT)
    assert len(log.skipped) == len(wild)
    assert np.abs(log.odometry.poses[:, :2]).max() < 5.0


def test_a_lasting_change_of_frame_is_continued_and_said() -> None:
    moved = Pose(500.0, -300.0, 2.0)
    readings = [replace(entry, pose=moved @ entry.pose) if n >= 1000 else entry for n, entry in enumerate(odometry())]
    log = assembled(scans(), readings)
    assert log.notes == (
        "odometry jumps to another frame at /odom, message 1001: it is continued from the pose before the jump",
    )
    truth = np.array([pose_at(time).as_array() for time in log.odometry.times])
    assert np.abs((log.odometry.poses - truth)[:, :2]).max() < 0.02  # the robot moves 1 cm between two readings


def test_odometry_that_jumps_all_the_time_is_refused() -> None:
    readings = [replace(entry, pose=Pose(500.0 * (n // 10 % 2), 0.0, 0.0)) for n, entry in enumerate(odometry())]
    with pytest.raises(InputError, match=r"odometry jumps by over 100 m here and .* more"):
        assembled(scans(), readings)


@pytest.mark.parametrize("received", [True, False])
def test_constant_stamps_are_replaced_by_times_of_the_recorder_or_by_a_period(received: bool) -> None:
    recorded = [entry.at(0.0) for entry in scans(received=received)]
    log = assembled(recorded, odometry(received=received))
    assert "constant time, 0.000000 s" in log.notes[0]
    if received:
        assert log.scans[7].time == pytest.approx(START + 0.7 + DELAY + RECORDER)
        assert all(reading is not None for reading in log.scan_odometry)
        assert log.scan_odometry[7].pose.is_near(pose_at(START + 0.7 + DELAY - 0.002), 1e-5, 1e-5)
    else:
        assert [scan.time for scan in log.scans[:3]] == [0.0, 1.0, 2.0]
        assert set(log.scan_odometry) == {None}


@pytest.mark.parametrize("is_odometry_coarse", [False, True])
def test_stamps_of_whole_seconds_are_spread_and_said(is_odometry_coarse: bool) -> None:
    recorded = [entry.at(math.floor(entry.scan.time + 1e-6)) for entry in scans()]
    readings = odometry(first=START)
    if is_odometry_coarse:
        readings = [entry.at(math.floor(entry.time + 1e-6)) for entry in readings]
    log = assembled(recorded, readings)
    coarse = "the scans and of odometry" if is_odometry_coarse else "the scans"
    assert log.notes == (f"the stamps of {coarse} are coarse: they are spread evenly up to the next stamp",)
    for index, reading in enumerate(log.scan_odometry):
        assert reading is not None
        assert reading.pose.is_near(pose_at(START + index * PERIOD), 1e-6, 1e-6)


@pytest.mark.parametrize("ahead", [-3600.0, -2.0, 2.0, 3600.0])
def test_odometry_of_another_clock_is_left_out_and_the_offset_said(ahead: float) -> None:
    log = assembled(scans(received=True), odometry(ahead=ahead, received=True))
    assert set(log.scan_odometry) == {None}
    assert not len(log.odometry.times)
    side = "ahead of" if ahead > 0 else "behind"
    assert log.notes[0].startswith("odometry is stamped by another clock, ")
    assert log.notes[0].endswith(f" s {side} that of the scans: the scans have no odometry")
    assert float(log.notes[0].split("clock, ")[1].split(" s ")[0].replace(",", "")) == pytest.approx(
        abs(ahead), abs=0.05
    )


@pytest.mark.parametrize("drift", [-0.1, -0.02, 0.02, 0.1])
def test_odometry_of_a_clock_that_drifts_is_left_out_and_the_largest_difference_said(drift: float) -> None:
    recorded = [entry.at(entry.scan.time + drift * (entry.scan.time - START)) for entry in scans(received=True)]
    log = assembled(recorded, odometry(received=True))
    assert set(log.scan_odometry) == {None}
    side = "behind" if drift > 0 else "ahead of"
    assert log.notes[0].endswith(f" s {side} that of the scans: the scans have no odometry")
    difference = float(log.notes[0].split("clock, ")[1].split(" s ")[0])
    assert difference == pytest.approx(abs(drift) * SCANS * PERIOD, abs=0.05)


@pytest.mark.parametrize("ahead", [-0.3, 0.2, 0.4])
def test_a_difference_that_delays_may_explain_is_said(ahead: float) -> None:
    log = assembled(scans(received=True), odometry(ahead=ahead, received=True))
    assert None not in log.scan_odometry[10:-10]
    side = "ahead of" if ahead > 0 else "behind"
    assert log.notes[0].startswith("odometry may be stamped by another clock, 0.")
    assert log.notes[0].endswith(f" s {side} that of the scans, or one of them is sent late: it is used")


def test_scans_that_are_received_in_bursts_are_of_one_clock() -> None:
    burst = 3.0  # s
    recorded = [replace(entry, received=burst * math.ceil(entry.scan.time / burst)) for entry in scans()]
    readings = [replace(entry, received=entry.time) for entry in odometry()]
    log = assembled(recorded, readings)
    assert None not in log.scan_odometry
    assert log.notes == ()


@pytest.mark.parametrize("count", [1, 5, 40])
@pytest.mark.parametrize("is_at_end", [False, True])
@pytest.mark.parametrize("step", [15.0, 90.0])
def test_stamps_that_jump_while_no_time_passes_for_the_recorder_are_outliers(
    count: int, is_at_end: bool, step: float
) -> None:
    indices = range(SCANS - count, SCANS) if is_at_end else range(count)
    stamps = {index: START + index * PERIOD + (step if is_at_end else -step) for index in indices}
    log = assembled(restamped(scans(received=True), stamps), options=LENIENT)
    assert len(log.scans) == SCANS - count
    assert len(log.skipped) == count


def test_a_pause_of_the_recorder_is_no_outlier() -> None:
    for pause_of_robot in (0.0, 60.0):
        paused = [
            replace(entry.at(entry.scan.time + pause_of_robot * is_later), received=entry.scan.time + 60.0 * is_later)
            for entry, is_later in ((entry, index > 5) for index, entry in enumerate(scans()))
        ]
        log = assembled(paused)
        assert (len(log.scans), log.skipped) == (SCANS, ())


def test_simulated_time_at_half_speed_is_one_clock() -> None:
    recorded = [replace(entry, received=2.0 * entry.scan.time + DELAY) for entry in scans()]
    readings = [replace(entry, received=2.0 * entry.time) for entry in odometry(first=START + 20.0)]
    log = assembled(recorded, readings)
    assert sum(reading is None for reading in log.scan_odometry) == pytest.approx(199, abs=1)


def test_times_that_do_not_overlap_are_another_clock_without_times_of_the_recorder() -> None:
    log = assembled(scans(), odometry(ahead=3600.0))
    assert set(log.scan_odometry) == {None}
    assert "odometry is of another clock or of another drive than the scans, from 4599.900 to" in log.notes[0]


def test_scans_before_after_and_in_holes_of_odometry_have_none() -> None:
    readings = [
        entry for entry in odometry(first=START + 5.0, last=START + 35.0) if not 10.0 < entry.time - START < 20.0
    ]
    log = assembled(scans(), readings)
    missing = {index for index, reading in enumerate(log.scan_odometry) if reading is None}
    assert missing.issuperset({*range(49), *range(102, 199), *range(352, SCANS)})
    assert missing.isdisjoint({*range(50, 101), *range(201, 350)})
    (note,) = log.notes
    assert note.startswith(f"{len(missing)} of 400 scans have no odometry: it begins 5.0 s after the first (49 scans)")
    assert ", it ends 4.9 s before the last (4" in note
    assert ", it has a hole of 10.0 s (9" in note


def test_a_robot_that_sends_no_odometry_while_it_stands_has_no_hole() -> None:
    def stop(time: float) -> float:
        return min(time, START + 10.0) if time < START + 30.0 else time - 20.0

    readings = [replace(entry, pose=pose_at(stop(entry.time))) for entry in odometry()]
    readings = [entry for entry in readings if not 10.5 < entry.time - START < 29.5]
    log = assembled(scans(), readings)
    assert None not in log.scan_odometry
    assert not log.notes


@pytest.mark.parametrize("period", [0.1, 1.0, 4.0])
def test_odometry_at_low_rates_covers_all_scans_between_its_readings(period: float) -> None:
    log = assembled(scans(), odometry(period=period, first=START))
    assert None not in log.scan_odometry[:360]


def test_a_recording_without_odometry_says_so() -> None:
    log = assembled(scans())
    assert set(log.scan_odometry) == {None}
    assert log.notes == ("the recording has no odometry",)


def test_poses_of_the_scans_stay_where_other_odometry_has_no_use() -> None:
    shuffled = odometry()[::-1]
    log = assembled(scans(own_poses=True), shuffled)
    assert (
        "readings of odometry contradict their order: the poses recorded with the scans are used alone" in log.notes[0]
    )
    assert len(log.odometry.times) == SCANS
    elsewhere = [replace(entry, pose=Pose(1.0) @ entry.pose) for entry in odometry()]
    log = assembled(scans(own_poses=True), elsewhere)
    assert "odometry contradicts the poses recorded with the scans" in log.notes[0]
    assert len(log.odometry.times) == SCANS


def test_scans_without_any_valid_range_are_no_log() -> None:
    empty = [replace(entry, scan=replace(entry.scan, ranges=np.full(36, 1e4))) for entry in scans()]
    with pytest.raises(InputError, match=r"no range within the limits of its lidar, 0.1 to 10 m"):
        assembled(empty)


INCREMENTS: dict[str, Callable[[float], float]] = {
    "longer than the period": lambda _: 0.2 / 36,
    "in nanoseconds": lambda _: 5e4,
    "not a number": lambda _: math.nan,
}


@pytest.mark.parametrize("increment", INCREMENTS.values(), ids=INCREMENTS.keys())
def test_impossible_times_between_beams_are_not_used_and_said(increment: Callable[[float], float]) -> None:
    wrong = [replace(entry, scan=replace(entry.scan, time_increment=increment(0.0))) for entry in scans()]
    log = assembled(wrong, odometry())
    assert {scan.time_increment for scan in log.scans} == {0.0}
    assert log.notes[0].startswith("time_increment of 400 of 400 scans is not used")


def test_times_between_beams_that_fill_the_period_are_used() -> None:
    right = [replace(entry, scan=replace(entry.scan, time_increment=PERIOD / 35)) for entry in scans()]
    log = assembled(right, odometry())
    assert {scan.time_increment for scan in log.scans} == {PERIOD / 35}
    assert not log.notes
