"""CARMEN's messages of lidars: mounts, directions of beams, several lidars, and units of time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.logs.options import ReadingOptions
from wherry.logs.reading import read_log
from wherry.space.pose import Pose

BEHIND = Pose(-0.2, 0.05, math.pi)


def numbers(pose: Pose, digits: int = 9) -> str:
    return f"{pose.x:.{digits}f} {pose.y:.{digits}f} {pose.theta:.{digits}f}"


def poses(count: int = 20) -> list[Pose]:
    return [Pose(0.1 * n, -0.05 * n, 0.7 * n) for n in range(count)]


def flaser(time: float, robot: Pose, lidar: Pose, beams: int = 4, name: str = "FLASER", digits: int = 9) -> str:
    ranges = " ".join(f"{1.0 + 0.001 * time + 0.01 * beam:.4f}" for beam in range(beams))
    return f"{name} {beams} {ranges} {numbers(lidar, digits)} {numbers(robot, digits)} {time} host {time + 0.1}"


def laser(name: str, angles: str, time: float, robot: Pose | None, beams: int = 180, remissions: str = "0 ") -> str:
    ranges = " ".join(["2.0"] * beams)
    poses = "" if robot is None else f"{numbers(robot @ BEHIND)} {numbers(robot)} 0 0 0 0 0 "
    return f"{name} 0 {angles} 50.0 0.01 0 {beams} {ranges} {remissions}{poses}{time} host {time}"


def odom(time: float, pose: Pose) -> str:
    return f"ODOM {numbers(pose)} 0 0 0 {time} host {time + 0.1}"


def write(folder: Path, lines: Sequence[str]) -> Path:
    path = folder / "some.log"
    path.write_text("\n".join(lines) + "\n")
    return path


def assert_mount(found: Pose, expected: Pose, tolerance: float = 1e-6) -> None:
    assert found.is_near(expected, tolerance, tolerance), (found, expected)


@pytest.mark.parametrize("digits", [9, 3])
@pytest.mark.parametrize("theta", [math.pi, -math.pi, 3.14, -3.14, 0.0, math.pi / 2.0])
def test_a_mount_is_understood_at_any_angle_and_up_to_rounding(tmp_path: Path, theta: float, digits: int) -> None:
    mount = Pose(-0.2, 0.05, theta)
    lines = [flaser(n, pose, pose @ mount, digits=digits) for n, pose in enumerate(poses())]
    log = read_log(write(tmp_path, lines))
    assert_mount(log.lidar, mount, 1e-6 if digits == 9 else 1e-3)
    assert not [note for note in log.notes if "lidar" in note]


def test_poses_that_disagree_assume_the_centre_and_name_the_option(tmp_path: Path) -> None:
    corrected = [Pose(0.12 * n, -0.07 * n, 0.71 * n) for n in range(20)]
    lines = [flaser(n, pose, other) for n, (pose, other) in enumerate(zip(poses(), corrected, strict=True))]
    log = read_log(write(tmp_path, lines))
    assert log.lidar == Pose()
    assert any("the centre of the robot is assumed; --lidar x,y,theta states it" in note for note in log.notes)
    parameters = ["PARAM robot_frontlaser_offset 0.25 nohost 0", "PARAM robot_frontlaser_angular_offset 0.1 nohost 0"]
    log = read_log(write(tmp_path, [*parameters, "PARAM robot_frontlaser_side_offset -0.03 nohost 0", *lines]))
    assert_mount(log.lidar, Pose(0.25, -0.03, 0.1))
    given = Pose(0.3, 0.0, 0.0)
    log = read_log(write(tmp_path, [*parameters, *lines]), ReadingOptions(lidar=given))
    assert log.lidar == given
    expected = "the log states the lidar at (0.250 m, 0.000 m, 5.7°): the given (0.300 m, 0.000 m, 0.0°) is used"
    assert expected in log.notes


def test_a_mount_that_is_not_on_a_robot_is_no_mount(tmp_path: Path) -> None:
    lines = [flaser(n, pose, pose @ Pose(25.0, 0.0, 0.0)) for n, pose in enumerate(poses())]
    log = read_log(write(tmp_path, lines))
    assert log.lidar == Pose()
    assert any("the centre of the robot is assumed; --lidar" in note for note in log.notes)
    with pytest.raises(InputError, match=r"states by PARAM that the lidar is at \(25.000 m, 0.000 m, 0.0°\); --lidar"):
        read_log(write(tmp_path, ["PARAM robot_frontlaser_offset 25 nohost 0", *lines]))


def test_raw_scans_need_a_stated_mount_and_get_poses_of_odometry(tmp_path: Path) -> None:
    lines = [odom(0.5 * n, pose) for n, pose in enumerate(poses())]
    lines += [laser("RAWLASER1", "-1.570796 3.141593 0.017453", 0.5 * n + 0.25, None) for n in range(19)]
    with pytest.raises(InputError, match=r"which state where the lidar sits; --lidar x,y,theta states it"):
        read_log(write(tmp_path, lines))
    log = read_log(write(tmp_path, lines), ReadingOptions(lidar=BEHIND))
    assert log.lidar == BEHIND
    assert None not in log.scan_odometry
    log = read_log(write(tmp_path, ["PARAM robot_frontlaser_offset 0.1 nohost 0", *lines]))
    assert_mount(log.lidar, Pose(0.1))


@pytest.mark.parametrize("remissions", ["", "0 ", "3 1 2 3 "])
@pytest.mark.parametrize(
    ("angles", "start", "increment"),
    [
        ("-1.570796 3.141593 0.017453", -90.0, 1.0),
        ("-1.570796 3.124139 0.017453", -90.0, 1.0),
        ("-90 180 1", -90.0, 1.0),
        ("-3.141593 6.283185 0.034907", -180.0, 2.0),
        ("0 0 0.017453", 0.0, 1.0),
        ("-1.570796 3.141593 0", -90.0, 1.0),
        ("0 6.283185 0", 0.0, 2.0),
        ("-1.570796 3.141593 0.008727", -90.0, 1.0),
        ("-1.570796 3.141593 1.0", -90.0, 1.0),
        ("-1.570796 6.0 0.017453", -90.0, 1.0),
    ],
)
def test_stated_angles_are_used_or_outvoted_by_two_that_agree(
    tmp_path: Path, angles: str, start: float, increment: float, remissions: str
) -> None:
    line = laser("ROBOTLASER1", angles, 1.0, Pose(), remissions=remissions)
    scan = read_log(write(tmp_path, [line])).scans[0]
    assert len(scan.ranges) == 180
    assert math.degrees(scan.angle_min) == pytest.approx(start, abs=0.01)
    assert math.degrees(scan.angle_increment) == pytest.approx(increment, abs=0.001)


def test_angles_that_contradict_one_another_are_named(tmp_path: Path) -> None:
    line = laser("ROBOTLASER1", "-1.0 3.141593 0.03", 1.0, Pose())
    with pytest.raises(InputError, match=r"line 1: start angle -1, field of view 3.142 and resolution 0.03 rad of 180"):
        read_log(write(tmp_path, [line]))


@pytest.mark.parametrize(
    ("beams", "parameters", "start", "increment", "is_assumed"),
    [
        (180, (), -90.0, 1.0, False),
        (361, (), -90.0, 0.5, False),
        (360, (), -90.0, 0.5, True),
        (360, ("laser_front_laser_fov 6.283185",), -180.0, 1.0, False),
        (541, (), -135.0, 0.5, True),
        (1081, (), -135.0, 0.25, True),
        (401, (), -50.0, 0.25, True),
        (682, (), -119.883, 0.3516, True),
        (300, (), -90.0, 0.6, True),
        (541, ("laser_front_laser_fov 4.712389",), -135.0, 0.5, False),
        (541, ("laser_front_laser_fov 180",), -90.0, 1 / 3, False),
        (361, ("laser_front_laser_resolution 0.5",), -90.0, 0.5, False),
        (361, ("laser_front_laser_resolution 0.25",), -45.0, 0.25, True),
    ],
)
def test_directions_that_a_message_leaves_open(
    tmp_path: Path, beams: int, parameters: tuple[str, ...], start: float, increment: float, is_assumed: bool
) -> None:
    lines = [*(f"PARAM {parameter} nohost 0" for parameter in parameters), flaser(1.0, Pose(), Pose(), beams)]
    log = read_log(write(tmp_path, lines))
    assert math.degrees(log.scans[0].angle_min) == pytest.approx(start, abs=0.01)
    assert math.degrees(log.scans[0].angle_increment) == pytest.approx(increment, abs=0.001)
    assert bool(log.notes) == is_assumed


def test_of_several_lidars_one_is_used_and_the_choice_is_said(tmp_path: Path) -> None:
    lines: list[str] = []
    for n, pose in enumerate(poses()):
        lines += [
            flaser(n, pose, pose, name="RLASER"),
            flaser(n, pose, pose, beams=180),
            laser("ROBOTLASER1", "-1.570796 3.141593 0.017453", n, pose),
            laser("ROBOTLASER2", "-1.570796 3.141593 0.008727", n, pose, beams=360),
            f"OLDLASER 1 2 3 {n}",
        ]
    log = read_log(write(tmp_path, lines))
    assert_mount(log.lidar, BEHIND)
    assert {len(scan.ranges) for scan in log.scans} == {180}
    assert log.notes[0] == (
        "the scans are those of ROBOTLASER1, of RLASER (20), FLASER (20), ROBOTLASER1 (20), ROBOTLASER2 (20),"
        " OLDLASER (20); --scan-topic chooses others"
    )
    log = read_log(write(tmp_path, lines), ReadingOptions(scan_topic="ROBOTLASER2"))
    assert {len(scan.ranges) for scan in log.scans} == {360}
    with pytest.raises(InputError, match=r"--scan-topic: /scan has no scans in it; there are RLASER \(20\)"):
        read_log(write(tmp_path, lines), ReadingOptions(scan_topic="/scan"))


def test_one_early_scan_of_another_lidar_does_not_decide(tmp_path: Path) -> None:
    lines = [laser("ROBOTLASER1", "-1.570796 3.141593 0.017453", 0.0, Pose())]
    lines += [flaser(n + 1, pose, pose) for n, pose in enumerate(poses())]
    assert len(read_log(write(tmp_path, lines)).scans) == 20


def test_a_log_of_unknown_scans_only_names_them(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"has scans in messages of unknown formats only: OLDLASER \(1\)"):
        read_log(write(tmp_path, ["OLDLASER 1 2 3"]))


@pytest.mark.parametrize(("unit", "name"), [(1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")])
def test_unix_times_in_small_units_are_converted(tmp_path: Path, unit: float, name: str) -> None:
    start = 1_600_000_000
    lines: list[str] = []
    for n in range(20):
        pose, between = Pose(0.1 * n), Pose(0.1 * n + 0.05)
        lines += [flaser(n, pose, pose).replace(f" {n} host", f" {int((start + n) * unit)} host")]
        lines += [odom(n + 0.5, between).replace(f" {n + 0.5} host", f" {int((start + n + 0.5) * unit)} host")]
    log = read_log(write(tmp_path, lines))
    np.testing.assert_allclose([scan.time for scan in log.scans], start + np.arange(20.0), atol=1e-5)
    assert f"the times of the scans are in {name}: they are converted to seconds" in log.notes
    assert f"the times of the odometry are in {name}: they are converted to seconds" in log.notes
    assert len(log.odometry.times) == 40


def test_an_impossible_time_is_named(tmp_path: Path) -> None:
    lines = [flaser(n, pose, pose) for n, pose in enumerate(poses())]
    lines[7] = lines[7].replace(" 7 host", " 1e19 host")
    with pytest.raises(InputError, match=r"line 8: has a time beyond 1e\+12 s"):
        read_log(write(tmp_path, lines))
    assert len(read_log(write(tmp_path, lines), ReadingOptions(lenient=True)).scans) == 19


@pytest.mark.parametrize(("unit", "name"), [(1e6, "microseconds"), (1e9, "nanoseconds")])
def test_counted_small_units_are_told_by_their_steps(tmp_path: Path, unit: float, name: str) -> None:
    lines = [flaser(n, p, p).replace(f" {n} host", f" {int(0.1 * n * unit)} host") for n, p in enumerate(poses())]
    log = read_log(write(tmp_path, lines))
    assert f"the times of the scans are in {name}: they are converted to seconds" in log.notes
    np.testing.assert_allclose([scan.time for scan in log.scans], 0.1 * np.arange(20.0), atol=1e-9)


def test_readings_at_the_stated_longest_range_are_no_return(tmp_path: Path) -> None:
    line = laser("ROBOTLASER1", "-1.570796 3.141593 0.017453", 1.0, Pose())
    line = line.replace(" 2.0 2.0 2.0 2.0", " 50.0 49.9999 49.98 2.0", 1)
    assert read_log(write(tmp_path, [line])).scans[0].ranges[:4].tolist() == [math.inf, math.inf, 49.98, 2.0]


@pytest.mark.parametrize("longest", ["0", "-1", "81910", "1e-320"])
def test_a_longest_range_that_no_lidar_has_is_named(tmp_path: Path, longest: str) -> None:
    line = laser("ROBOTLASER1", "-1.570796 3.141593 0.017453", 1.0, Pose()).replace(" 50.0 0.01", f" {longest} 0.01")
    with pytest.raises(InputError, match=r"line 1: the longest range is [-\d.e]+, not above 0.02 and up to 1000 m"):
        read_log(write(tmp_path, [line]))


def test_beam_counts_that_jitter_are_read(tmp_path: Path) -> None:
    lines = [flaser(n, pose, pose, beams=357 + n % 7) for n, pose in enumerate(poses())]
    log = read_log(write(tmp_path, lines))
    assert {len(scan.ranges) for scan in log.scans} == set(range(357, 364))
    assert [note.partition(":")[0] for note in log.notes] == ["FLASER"]
