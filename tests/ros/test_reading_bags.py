"""Bags of ROS 1 and ROS 2 are read as lidar logs, and damaged ones are refused in one line."""

from __future__ import annotations

import math
import sqlite3
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.logs.options import ReadingOptions
from wherry.ros.bags.reading import is_bag, read_bag
from wherry.space.pose import Pose

pytest.importorskip("rosbags", reason="the rosbags package is not installed")
from wherry_testing.recorded_bags import KINDS, LASER_SCAN, SUFFIXES, SmallBag, link

MOUNT = [link("base_link", "laser", 0.25)]
RANGES = [1.0, 2.0, math.nan, math.inf, 20.0]


def write(folder: Path, kind: str, times: list[float]) -> Path:
    """A bag with the lidar's mount, odometry, and scans at some times."""
    bag = SmallBag(kind).transforms(MOUNT).drive()
    for time in times:
        bag.scan(time, ranges=RANGES)
    return bag.write(folder / ("some.bag" if kind == "ros1" else kind))


def storage(path: Path, kind: str) -> Path:
    """The file of a bag that holds the messages."""
    return path if kind == "ros1" else next(path.glob(f"*{SUFFIXES[kind]}"))


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_is_read_as_a_log(tmp_path: Path, kind: str) -> None:
    path = write(tmp_path, kind, [2.0, 4.0])
    assert is_bag(path)
    log = read_bag(path)
    assert [scan.time for scan in log.scans] == [2.0, 4.0]
    np.testing.assert_array_equal(log.scans[0].ranges, [1.0, 2.0, np.nan, np.inf, np.inf])
    assert (log.scans[0].angle_min, log.scans[0].angle_increment) == (-1.0, 0.5)
    assert log.scan_odometry[0] is not None
    pose = log.scan_odometry[0].pose
    assert (pose.x, pose.y, pose.theta) == pytest.approx((1.0, 0.0, 0.0))
    np.testing.assert_allclose(log.odometry.times, np.arange(11.0))
    assert (log.skipped, log.notes) == ((), ())


def test_a_broken_message_is_named_or_skipped(tmp_path: Path) -> None:
    bag = SmallBag("ros1").transforms(MOUNT).drive().scan(2.0).scan(4.0).scan(5.0, ranges=[]).scan(6.0)
    path = bag.write(tmp_path / "some.bag")
    with pytest.raises(InputError, match="/scan, message 3: has 0 beams"):
        read_bag(path)
    log = read_bag(path, ReadingOptions(lenient=True))
    assert [scan.time for scan in log.scans] == [2.0, 4.0, 6.0]
    assert log.skipped == ("/scan, message 3: has 0 beams; 1 to 20,000 are possible",)


@pytest.mark.parametrize("kind", KINDS)
def test_the_number_of_beams_may_vary(tmp_path: Path, kind: str) -> None:
    bag, counts = SmallBag(kind).transforms(MOUNT).drive(), [360, 357, 363, 359, 361]
    for time, beams in enumerate(counts, start=1):
        bag.scan(float(time), ranges=np.linspace(1.0, 5.0, beams), angle_min=-math.pi, angle_increment=math.tau / beams)
    log = read_bag(bag.write(tmp_path / f"run{'.bag' * (kind == 'ros1')}"))
    assert [len(scan.ranges) for scan in log.scans] == counts
    assert log.notes == ()


@pytest.mark.parametrize("kind", KINDS)
def test_rings_of_readings_at_range_max_are_no_walls(tmp_path: Path, kind: str) -> None:
    bag = SmallBag(kind).transforms(MOUNT).drive()
    path = bag.scan(ranges=[1.0, 9.9999, 10.0, 10.5, 9.9]).write(tmp_path / f"run{'.bag' * (kind == 'ros1')}")
    (scan,) = read_bag(path).scans
    assert scan.valid.tolist() == [True, False, False, False, True]
    assert np.isinf(scan.ranges).tolist() == [False, True, True, True, False]


def test_many_readings_at_range_min_are_no_obstacles(tmp_path: Path) -> None:
    bag = SmallBag("mcap").transforms(MOUNT).drive()
    for step in range(20):
        ranges = np.full(100, 3.0)
        ranges[:10] = -math.inf if step % 2 else 0.1
        bag.scan(0.5 * step, ranges=ranges, angle_increment=0.02)
    log = read_bag(bag.write(tmp_path / "run"))
    assert all(int(scan.valid.sum()) == 90 for scan in log.scans)
    assert "/scan: 10% of the readings are −inf or range_min, which is taken for no measurement" in log.notes


@pytest.mark.parametrize(("increment", "is_kept"), [(0.1, True), (0.25, True), (0.3, False), (1e6, False)])
def test_times_of_beams_longer_than_the_time_between_scans_are_ignored(
    tmp_path: Path, increment: float, is_kept: bool
) -> None:
    bag = SmallBag("mcap").transforms(MOUNT).drive()
    for time in (1.0, 2.0, 3.0, 9.0):
        bag.scan(time, time_increment=increment)
    log = read_bag(bag.write(tmp_path / "run"))
    assert log.scans[0].time_increment == pytest.approx(increment if is_kept else 0.0)
    assert len([note for note in log.notes if note.startswith("time_increment of 4 of 4 scans is not used")]) == (
        not is_kept
    )


def test_the_beams_of_a_lidar_upside_down_keep_their_times(tmp_path: Path) -> None:
    upside_down = [link("base_link", "laser", rotation=(1.0, 0.0, 0.0, 0.0))]
    bag = SmallBag("mcap").transforms(upside_down).drive().scan(1.0, time_increment=0.0625)
    (scan,) = read_bag(bag.write(tmp_path / "run")).scans
    assert scan.time_increment == -0.0625
    assert scan.ranges.tolist() == [5.0, 4.0, 3.0, 2.0, 1.0]


@pytest.mark.parametrize("is_upside_down", [False, True])
@pytest.mark.parametrize("is_clockwise", [False, True])
def test_a_scan_while_turning_is_corrected(tmp_path: Path, is_upside_down: bool, is_clockwise: bool) -> None:
    """A lidar on the axle, in the middle of a square room of 4 m, that turns at 1 rad/s."""
    rate, period, beams = 1.0, 0.1, 90
    beam_angles = np.linspace(-math.pi, math.pi, beams) * (-1.0 if is_clockwise else 1.0)
    directions = -beam_angles if is_upside_down else beam_angles
    world = directions + rate * np.linspace(0.0, period, beams)
    ranges = 2.0 / np.maximum(np.abs(np.cos(world)), np.abs(np.sin(world)))
    turned = (1.0, 0.0, 0.0, 0.0) if is_upside_down else (0.0, 0.0, 0.0, 1.0)
    bag = SmallBag("mcap").transforms([link("base_link", "laser", rotation=turned)])
    for step in range(21):
        bag.odometry(0.05 * step, yaw=0.05 * step * rate)
    step = float(beam_angles[1] - beam_angles[0])
    for time in (0.0, 0.2):
        changes = {"angle_min": float(beam_angles[0]), "angle_increment": step, "time_increment": period / (beams - 1)}
        bag.scan(time, ranges=ranges, **changes)
    log = read_bag(bag.write(tmp_path / "run"))
    raw, corrected = (np.abs(scan.points()).max(axis=1) for scan in (log.scans[0], log.deskewed(0)))
    assert np.abs(raw - 2.0).max() > 0.1
    assert np.abs(corrected - 2.0).max() < 1e-5


def test_a_file_that_is_not_a_bag_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "some.bag"
    for content in (b"", b"nonsense"):
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"some\.bag"):
            read_bag(path)
    with pytest.raises(InputError):
        read_bag(tmp_path / "missing.mcap")
    assert not is_bag(tmp_path / "some.log")


@pytest.mark.parametrize("kind", ["ros1", "sqlite"])
def test_a_truncated_bag_is_refused_in_one_line(tmp_path: Path, kind: str) -> None:
    path = write(tmp_path, kind, [0.2 * step for step in range(50)])
    file = storage(path, kind)
    whole = file.read_bytes()
    for share in (0.02, 0.3, 0.6, 0.97):
        file.write_bytes(whole[: int(len(whole) * share)])
        with pytest.raises(InputError) as caught:
            read_bag(path)
        assert str(path) in str(caught.value)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("share", [0.3, 0.6, 0.97])
def test_an_mcap_file_that_its_recorder_did_not_close_is_read_up_to_its_last_record(
    tmp_path: Path, share: float
) -> None:
    bag = SmallBag("mcap").transforms(MOUNT)
    for step in range(50):
        bag.odometry(0.2 * step, 0.1 * step).scan(0.2 * step, ranges=RANGES)
    file = storage(bag.write(tmp_path / "run", in_chunks=True), "mcap")
    whole = read_bag(file)
    contents = file.read_bytes()
    file.write_bytes(contents[: int(share * len(contents))])
    log = read_bag(file, ReadingOptions(lidar=Pose(0.25, 0.0)))
    assert log.notes[0] == "run.mcap was not closed by its recorder, so its end may be missing"
    assert 0 < len(log.scans) <= len(whole.scans)
    assert [scan.time for scan in log.scans] == [scan.time for scan in whole.scans[: len(log.scans)]]
    assert len(log.scans) >= (share - 0.3) * len(whole.scans)


def test_messages_in_the_serialization_of_ros_1_are_refused(tmp_path: Path) -> None:
    path = write(tmp_path, "sqlite", [2.0, 4.0])
    with closing(sqlite3.connect(storage(path, "sqlite"))) as database, database:
        database.execute("UPDATE topics SET serialization_format = 'ros1'")
    with pytest.raises(InputError, match="/scan: is serialized as 'ros1' instead of 'cdr'; rosbags-convert"):
        read_bag(path)


def test_an_mcap_file_cut_off_in_its_first_record_is_refused_in_one_line(tmp_path: Path) -> None:
    file = storage(write(tmp_path, "mcap", [1.0]), "mcap")
    file.write_bytes(file.read_bytes()[:30])
    with pytest.raises(InputError, match=r"no usable LaserScan messages|not a bag that can be read"):
        read_bag(file)


@pytest.mark.parametrize("share", [0.1, 1.0])
def test_messages_in_the_write_ahead_log_of_a_killed_recorder_are_read(tmp_path: Path, share: float) -> None:
    source = storage(write(tmp_path, "sqlite", [0.2 * step for step in range(50)]), "sqlite")
    folder = tmp_path / "killed"
    folder.mkdir()
    file = folder / "killed_0.db3"
    with closing(sqlite3.connect(source)) as whole, closing(sqlite3.connect(file)) as database:
        database.executescript("PRAGMA journal_mode = WAL; PRAGMA wal_autocheckpoint = 0")
        statements = [line for line in whole.iterdump() if not line.startswith(("BEGIN", "COMMIT"))]
        written = len(statements) - int(share * len(statements))
        database.executescript(";".join(statements[:written]) + "; PRAGMA wal_checkpoint")
        database.executescript(";".join(statements[written:]))
        copies = {path.name: path.read_bytes() for path in folder.iterdir()}
    for name, contents in copies.items():
        (folder / name).write_bytes(contents)
    log = read_bag(folder)
    assert len(log.scans) == 50
    assert log.notes == ("killed_0.db3-wal was not closed by its recorder, so its end may be missing",)
    assert file.read_bytes() == copies[file.name]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["run #1", "50%41", "why?", "a&b=c", "it's", "Fahrt ü"])
def test_a_path_may_have_any_characters(tmp_path: Path, kind: str, name: str) -> None:
    path = write(tmp_path, kind, [2.0, 4.0])
    moved = tmp_path / name / path.name
    moved.parent.mkdir()
    path.rename(moved)
    assert len(read_bag(moved).scans) == 2
    assert len(read_bag(storage(moved, kind)).scans) == 2


@pytest.mark.parametrize("kind", ["mcap", "sqlite"])
def test_the_metadata_file_stands_for_its_folder(tmp_path: Path, kind: str) -> None:
    path = write(tmp_path, kind, [2.0, 4.0]) / "metadata.yaml"
    assert is_bag(path)
    assert len(read_bag(path).scans) == 2


@pytest.mark.parametrize(("kind", "tool"), [("ros1", "rosbag reindex"), ("sqlite", "sqlite3's .recover")])
def test_the_error_of_a_damaged_bag_names_the_tool_that_may_repair_it(tmp_path: Path, kind: str, tool: str) -> None:
    path = write(tmp_path, kind, [2.0, 4.0])
    file = storage(path, kind)
    file.write_bytes(file.read_bytes()[:5000])
    with pytest.raises(InputError, match=f"is not a bag that can be read: .*; {tool} may repair it"):
        read_bag(file)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("odd", [1, 3])
def test_stamps_that_the_times_of_the_recorder_contradict_are_outliers(tmp_path: Path, kind: str, odd: int) -> None:
    bag = SmallBag(kind).transforms(MOUNT)
    for step in range(50):
        time = 100.0 + 0.2 * step
        bag.scan(time - 40.0 * (step < odd), received=time)
        bag.odometry(time - 0.01 - 40.0 * (step < odd), 0.1 * step, received=time)
    path = bag.write(tmp_path / ("some.bag" if kind == "ros1" else kind))
    with pytest.raises(InputError, match=r"/scan, message 1: is stamped 60\.000000, 4. s before all others"):
        read_bag(path)
    log = read_bag(path, ReadingOptions(lenient=True))
    assert (len(log.scans), len(log.skipped)) == (50 - odd, 2 * odd)
    assert None not in log.scan_odometry


@pytest.mark.parametrize("lenient", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_flipped_bits_end_in_a_log_or_an_error_of_one_line(tmp_path: Path, kind: str, lenient: bool) -> None:
    path = write(tmp_path, kind, [2.0 + step for step in range(5)])
    file = storage(path, kind)
    whole = file.read_bytes()
    rng = np.random.default_rng(3)
    refused = []
    for _ in range(30):
        damaged = bytearray(whole)
        for place in rng.integers(0, len(whole), 8):
            damaged[place] ^= 1 << int(rng.integers(8))
        file.write_bytes(bytes(damaged))
        try:
            assert read_bag(path, ReadingOptions(lenient=lenient)).scans
        except InputError as error:
            refused.append(str(error))
    assert refused
    assert not any("\n" in line for line in refused)


def test_the_error_of_a_bag_without_scans_names_the_type_of_its_scan_topic(tmp_path: Path) -> None:
    path = (
        SmallBag("mcap")
        .add("/scan", "std_msgs/msg/String", 1.0, SimpleNamespace(data="a scan"))
        .write(tmp_path / "run")
    )
    with pytest.raises(InputError, match=r"no usable LaserScan.*its /scan is of std_msgs/msg/String"):
        read_bag(path)


def test_the_error_of_a_bag_without_messages_names_the_empty_topic(tmp_path: Path) -> None:
    path = SmallBag("mcap").drive().declare("/scan", LASER_SCAN).write(tmp_path / "run")
    with pytest.raises(InputError, match=r"no usable LaserScan messages; its /scan \(0 messages\) is empty"):
        read_bag(path)


def test_the_error_of_a_bag_with_only_broken_scans_names_the_first(tmp_path: Path) -> None:
    path = SmallBag("mcap").transforms(MOUNT).scan(ranges=[]).write(tmp_path / "run")
    with pytest.raises(InputError, match="/scan, message 1: has 0 beams"):
        read_bag(path)
    with pytest.raises(InputError, match="1 skipped, the first: /scan, message 1: has 0 beams"):
        read_bag(path, ReadingOptions(lenient=True))


def test_more_scans_than_fit_into_memory_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path, "mcap", [2.0 + step for step in range(5)])
    monkeypatch.setattr("wherry.ros.bags.recorded_scans.MAX_RANGES", 12)
    with pytest.raises(InputError, match="/scan, message 3"):
        read_bag(path)


@pytest.mark.parametrize("name", ["run.bag.active", "run.active"])
def test_a_recording_that_was_cut_off_is_not_read(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"")
    assert is_bag(tmp_path / name)
    with pytest.raises(InputError, match="cut off"):
        read_bag(tmp_path / name)


@pytest.mark.parametrize("kind", KINDS)
def test_without_odometry_messages_transforms_give_the_odometry(tmp_path: Path, kind: str) -> None:
    bag = SmallBag(kind)
    for time in (0.0, 4.0):
        base = link("odom", "base_footprint", 1.0 + time)
        links = [link("map", "odom", 9.0), base, link("base_footprint", "laser", 0.25)]
        bag.transforms(links, time, "/tf")
    log = read_bag(bag.scan(2.0).write(tmp_path / f"run{'.bag' * (kind == 'ros1')}"))
    np.testing.assert_allclose(log.odometry.poses[:, 0], [1.0, 5.0])
    assert log.scan_odometry[0] is not None
    assert log.scan_odometry[0].pose.x == pytest.approx(3.0)
    assert log.lidar.x == 0.25


def test_transforms_of_another_robot_are_not_its_odometry(tmp_path: Path) -> None:
    bag = SmallBag("mcap").scan(1.0, topic="/robot2/scan")
    for time in (0.0, 2.0):
        for number in (1, 2):
            links = [link("odom", "base_link", float(number)), link("base_link", "laser", 0.1 * number)]
            bag.transforms(links, time, f"/robot{number}/tf")
    log = read_bag(bag.write(tmp_path / "run"))
    np.testing.assert_allclose(log.odometry.poses[:, 0], [2.0, 2.0])
    assert log.lidar.x == 0.2


def test_odometry_whose_time_runs_backwards_is_named(tmp_path: Path) -> None:
    bag = SmallBag("ros1").transforms(MOUNT).odometry(2.0, received=1.0).odometry(1.0, received=2.0).scan(1.5)
    with pytest.raises(InputError, match=r"/odom, message 2: .*2\.0.*1\.0"):
        read_bag(bag.write(tmp_path / "some.bag"))
