"""Lidar logs in all formats, and malformed lines."""

from __future__ import annotations

import gzip
import math
from pathlib import Path

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.logs.options import ReadingOptions
from wherry.logs.reading import read_log
from wherry.logs.tables import read_odometry
from wherry.space.pose import Pose
from wherry_testing.buildings import shared_data

FLASER = "FLASER 4 1.0 2.0 81.83 3.0 {x} 0.5 0.1 {x} 0.5 0.1 {t} host {t}"
ROBOTLASER = "ROBOTLASER1 0 -0.5 1.0 0.5 50.0 0.01 0 3 1.0 2.0 50.0 0 {x} {y} 0.1 {rx} 0.5 0.1 0 0 0 0 0 {t} host {t}"
ODOM = "ODOM {x} 0.5 0.1 0 0 0 {t} host {t}"


def write(folder: Path, *lines: str) -> Path:
    path = folder / "some.log"
    path.write_text("\n".join(lines) + "\n")
    return path


def flaser(t: float, x: float = 0.0) -> str:
    return FLASER.format(t=t, x=x)


def test_flaser_messages_are_read(tmp_path: Path) -> None:
    odometry = [ODOM.format(t=0.5, x=0.0), ODOM.format(t=1.5, x=0.1)]
    log = read_log(
        write(tmp_path, "# comment", "PARAM a b c", odometry[0], flaser(1.0, 0.05), odometry[1], flaser(2.0, 0.2))
    )
    scan = log.scans[1]
    assert scan.time == 2.0
    np.testing.assert_array_equal(scan.ranges, [1.0, 2.0, np.inf, 3.0])
    assert scan.angle_min == -math.pi / 2
    assert scan.angle_increment == math.pi / 4
    assert log.scan_odometry[1] is not None
    assert log.scan_odometry[1].pose == Pose(0.2, 0.5, 0.1)
    np.testing.assert_array_equal(log.odometry.times, [0.5, 1.0, 1.5, 2.0])
    np.testing.assert_array_equal(log.odometry.poses[:, 0], [0.0, 0.05, 0.1, 0.2])
    assert log.lidar == Pose()


@pytest.mark.parametrize(("beams", "increment"), [(180, 1.0), (181, 1.0), (360, 0.5), (361, 0.5)])
def test_beams_cover_the_half_circle(tmp_path: Path, beams: int, increment: float) -> None:
    line = f"FLASER {beams} {'1.0 ' * beams}0 0 0 0 0 0 1.0 host 1.0"
    assert math.degrees(read_log(write(tmp_path, line)).scans[0].angle_increment) == pytest.approx(increment)


def test_robotlaser_messages_give_the_pose_of_the_lidar(tmp_path: Path) -> None:
    ahead, aside = 0.25 * math.cos(0.1), 0.25 * math.sin(0.1)
    lines = [ROBOTLASER.format(t=t, x=t + ahead, y=0.5 + aside, rx=t) for t in (1.0, 2.0)]
    log = read_log(write(tmp_path, *lines))
    assert (log.lidar.x, log.lidar.y, log.lidar.theta) == pytest.approx((0.25, 0.0, 0.0), abs=1e-9)
    np.testing.assert_array_equal(log.scans[0].ranges, [1.0, 2.0, np.inf])
    assert log.scans[0].range_max == 50.0
    assert log.scans[0].angle_increment == 0.5


def test_wean_hall_messages_are_read_in_centimetres(tmp_path: Path) -> None:
    ranges = " ".join(["100"] * 179 + ["250"])
    log = read_log(write(tmp_path, "O 10 20 0.5 0.1", f"L 100 200 0.0 125 200 0.0 {ranges} 0.2", "O 101 200 0 0.3"))
    assert log.scans[0].ranges[-1] == 2.5
    assert log.scans[0].angles[-1] == pytest.approx(math.radians(89.0))
    assert log.lidar.x == pytest.approx(0.25)
    np.testing.assert_allclose(log.odometry.poses[:, 0], [0.1, 1.0, 1.01])


def test_gzipped_and_plain_logs_are_equal(tmp_path: Path) -> None:
    path = write(tmp_path, flaser(1.0), flaser(2.0))
    packed = tmp_path / "some.log.gz"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    assert len(read_log(packed).scans) == len(read_log(path).scans) == 2


def test_repeated_scans_are_dropped_and_different_ones_with_the_same_time_are_kept(tmp_path: Path) -> None:
    other = flaser(1.0).replace("2.0", "2.5", 1)
    assert len(read_log(write(tmp_path, flaser(1.0), flaser(1.0), other)).scans) == 2


@pytest.mark.parametrize("longest", [8.19, 29.99, 51.05])
def test_beams_without_a_return_are_not_walls(tmp_path: Path, longest: float) -> None:
    rng = np.random.default_rng(0)
    walls = rng.exponential(3.0, (40, 180)) + 0.5
    expected = np.where(walls >= longest - 0.1, np.inf, walls.round(3))
    expected[:, 90:95] = np.inf  # a window
    lines = [
        f"FLASER 180 {' '.join(f'{value:.3f}' for value in np.minimum(row, longest))} 0 0 0 0 0 0 {n}.5 host {n}.5"
        for n, row in enumerate(np.where(np.isinf(expected), longest, expected))
    ]
    log = read_log(write(tmp_path, *lines))
    np.testing.assert_array_equal(np.array([scan.ranges for scan in log.scans]), expected)
    assert log.scans[0].range_max == pytest.approx(longest - 0.1)


def test_the_longest_readings_are_walls_unless_they_are_frequent(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for ranges in (rng.uniform(0.5, 6.0, (40, 180)), np.full((40, 180), 5.0), np.full((1, 40), 7.0)):
        lines = [
            f"FLASER {len(row)} {' '.join(f'{value:.3f}' for value in row)} 0 0 0 0 0 0 {n}.5 host {n}.5"
            for n, row in enumerate(ranges)
        ]
        log = read_log(write(tmp_path, *lines))
        np.testing.assert_array_equal(np.array([scan.ranges for scan in log.scans]), ranges.round(3))


def test_a_log_with_unrelated_lines_is_read(tmp_path: Path) -> None:
    """Windows line ends, comments, parameters, a rear lidar, other messages, and equal stamps."""
    lines = [
        "# CARMEN Logfile",
        "# message formats defined: PARAM SYNC ODOM FLASER RLASER TRUEPOS",
        "PARAM robot_frontlaser_offset 0.08 nohost 0",
        "PARAM robot_use_laser on nohost 0",
        "",
        "SYNC tagname 976052857.3 nohost 0.1",
        ODOM.format(t=976052857.34, x=0.0),
        flaser(976052857.34),
        "RLASER 2 1.0 2.0 0 0 0 0 0 0 976052857.34 nohost 0.2",
        "NEFF 30",
        ODOM.format(t=976052857.34, x=0.0),
        flaser(976052857.34, 0.5).replace("2.0", "2.5", 1),
        "TRUEPOS 0 0 0 0 0 0 976052857.4 nohost 0.3",
    ]
    path = tmp_path / "robot.log"
    path.write_bytes("\r\n".join(lines).encode())
    log = read_log(path)
    assert [scan.time for scan in log.scans] == [976052857.34, 976052857.34]
    assert [odometry.pose.x for odometry in log.scan_odometry if odometry] == [0.0, 0.5]
    assert log.lidar == Pose(0.08, 0.0, 0.0)
    assert not log.skipped


BROKEN = {
    "too few words": flaser(2.0).replace("3.0 ", "", 1),
    "beam count": "FLASER 3 1.0 2.0 3.0 0 0 0 0 0 0 2.0 host 2.0",
    "absurd count": "FLASER 999999999 1.0",
    "no count": "FLASER many 1.0",
    "NaN pose": flaser(2.0).replace("0.5", "nan", 1),
    "word for number": flaser(2.0).replace("1.0", "one", 1),
    "infinite time": flaser(math.inf),
    "time backwards": flaser(0.5),
    "cut short": flaser(2.0)[:20],
    "odometry cut short": "ODOM 1 2",
    "binary": "\x00\x01\xff",
    "lower case": "nonsense 1 2 3",
    "wean cut short": "O 1 2",
    "distant pose": flaser(2.0).replace("0.5", "1e300", 1),
    "jump of odometry": flaser(2.0).replace("0.5", "1e5"),
}


def test_ranges_that_are_no_distances_are_read_as_in_bags(tmp_path: Path) -> None:
    line = "FLASER 7 1.0 inf nan -inf -1 0 81.83 0 0 0 0 0 0 1.0 host 1.0"
    for text in (line, line.replace("inf", "Infinity").replace("nan", "NaN")):
        scan = read_log(write(tmp_path, text)).scans[0]
        np.testing.assert_array_equal(scan.ranges, [1.0, np.inf, np.nan, 0.02, np.nan, 0.0, np.inf])


@pytest.mark.parametrize("broken", BROKEN.values(), ids=BROKEN.keys())
def test_a_malformed_line_is_named_or_left_out(tmp_path: Path, broken: str) -> None:
    path = write(tmp_path, flaser(1.0), broken, flaser(3.0))
    with pytest.raises(InputError) as caught:
        read_log(path)
    assert caught.value.field == "line 2"
    log = read_log(path, ReadingOptions(lenient=True))
    assert [scan.time for scan in log.scans] == [1.0, 3.0]
    assert len(log.skipped) == 1
    assert log.skipped[0].startswith("line 2:")


@pytest.mark.parametrize("broken", ["ROBOTLASER1 0 1", ROBOTLASER.format(t=1.0, x=0, y=0, rx=0)[:-10]])
def test_a_malformed_robotlaser_line_is_named(tmp_path: Path, broken: str) -> None:
    with pytest.raises(InputError, match="line 2"):
        read_log(write(tmp_path, ROBOTLASER.format(t=0.5, x=0, y=0, rx=0), broken))


def test_decreasing_times_of_odometry_are_named(tmp_path: Path) -> None:
    path = write(tmp_path, flaser(1.0), ODOM.format(t=5.0, x=0), ODOM.format(t=4.0, x=0))
    with pytest.raises(InputError, match="line 3: time runs backwards"):
        read_log(path)


def test_odometry_without_a_stamp_is_ignored(tmp_path: Path) -> None:
    log = read_log(
        write(tmp_path, ODOM.format(t=5.0, x=0), flaser(6.0), ODOM.format(t=0, x=9), ODOM.format(t=7.0, x=1))
    )
    np.testing.assert_array_equal(log.odometry.times, [5.0, 6.0, 7.0])


def test_files_that_are_not_logs_are_rejected(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no scans"):
        read_log(write(tmp_path, "# nothing"))
    with pytest.raises(InputError):
        read_log(tmp_path / "missing.log")
    with pytest.raises(InputError):
        read_log(tmp_path)
    packed = tmp_path / "broken.log.gz"
    packed.write_bytes(gzip.compress(flaser(1.0).encode())[:-9])
    with pytest.raises(InputError, match="gzip"):
        read_log(packed)
    packed.write_bytes(b"not gzip")
    with pytest.raises(InputError, match="line 1: is not a message"):
        read_log(packed)


def test_a_gzip_bomb_is_rejected_at_its_first_line(tmp_path: Path) -> None:
    packed = tmp_path / "bomb.log.gz"
    packed.write_bytes(gzip.compress(b"0" * 50_000_000))
    assert packed.stat().st_size < 100_000
    with pytest.raises(InputError, match="line 1: is longer"):
        read_log(packed, ReadingOptions(lenient=True))


def test_a_gzip_bomb_of_short_lines_is_rejected_at_the_size_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("wherry.logs.text_files.MAX_FILE_SIZE", 1_000_000)
    packed = tmp_path / "bomb.log.gz"
    packed.write_bytes(gzip.compress(b"# nothing\n" * 1_000_000))
    with pytest.raises(InputError, match="larger than 1,000,000 bytes"):
        read_log(packed, ReadingOptions(lenient=True))


def test_a_gzip_bomb_of_short_lines_is_rejected_at_the_compression_limit(tmp_path: Path) -> None:
    packed = tmp_path / "bomb.log.gz"
    packed.write_bytes(gzip.compress(b"# nothing\n" * 2_000_000))
    with pytest.raises(InputError, match="unpacks to over 100 times"):
        read_log(packed, ReadingOptions(lenient=True))


def test_tables_of_odometry_are_checked(tmp_path: Path) -> None:
    path = tmp_path / "odometry.txt"
    path.write_text("# t x y theta\n1 0 0 0\n2 1 0 0.5\n")
    np.testing.assert_array_equal(read_odometry(path).poses, [[0, 0, 0], [1, 0, 0.5]])
    for broken, match in (("1 0 0\n", "has 3 numbers"), ("2 0 0 0\n1 0 0 0\n", "backwards"), ("1 0 0 x\n", "line 1")):
        path.write_text(broken)
        with pytest.raises(InputError, match=match):
            read_odometry(path)


@pytest.mark.parametrize(
    ("name", "scans", "mount"),
    [
        ("intel/intel_910_rawodom.clf.gz", 910, 0.0),
        ("radish/csail-corrected.log.gz", 406, 0.0),
        ("wean/robotdata1.log.gz", 713, 0.25),
    ],
)
def test_recorded_logs_are_read_completely(name: str, scans: int, mount: float) -> None:
    log = read_log(shared_data(name))
    assert len(log.scans) == scans
    assert not log.skipped
    assert log.lidar.x == pytest.approx(mount, abs=1e-3)


def test_a_small_file_that_unpacks_to_millions_of_empty_lines_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "some.log.gz"
    path.write_bytes(gzip.compress(f"{flaser(1.0)}\n".encode() + b"\n" * 3_000_000, 1))
    with pytest.raises(InputError, match="lines that are almost empty"):
        read_log(path)
