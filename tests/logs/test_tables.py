"""Tables of trajectories, and odometry files besides a log."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.logs.assembly import RecordedScan, assemble_log
from wherry.logs.lidar_log import LidarLog
from wherry.logs.odometry_files import with_odometry_file
from wherry.logs.options import ReadingOptions
from wherry.logs.tables import read_odometry, read_trajectory
from wherry.robot import Scan
from wherry.space.pose import IDENTITY, Pose
from wherry.space.trajectory import Trajectory, save_trajectory

TIMES = np.array([1.0, 2.5, 4.0])
POSES = np.array([[0.0, 1.0, 0.5], [1.0, 2.0, -3.0], [-3.0, 0.5, 3.0]])


def write(folder: Path, text: str) -> Path:
    path = folder / "odometry.txt"
    path.write_text(text)
    return path


def quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """x, y, z, w of rotations about x, then y, then z, rad."""
    (sr, cr), (sp, cp), (sy, cy) = ((math.sin(a / 2.0), math.cos(a / 2.0)) for a in (roll, pitch, yaw))
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def tum(roll: float = 0.0, pitch: float = 0.0, scale: float = 1.0) -> str:
    rows = [
        (time, x, y, 0.3, *(scale * value for value in quaternion(roll, pitch, theta)))
        for time, (x, y, theta) in zip(TIMES, POSES, strict=True)
    ]
    return "\n".join(" ".join(f"{value:.9f}" for value in row) for row in rows) + "\n"


def assert_is_the_trajectory(found: Trajectory) -> None:
    np.testing.assert_allclose(found.times, TIMES, atol=1e-6)
    np.testing.assert_allclose(found.poses[:, :2], POSES[:, :2], atol=1e-6)
    np.testing.assert_allclose(np.cos(found.poses[:, 2] - POSES[:, 2]), 1.0, atol=1e-11)


SEPARATED = {
    "spaces": "{} {} {} {}",
    "tabs": "{}\t{}\t{}\t{}",
    "commas": "{},{},{},{}",
    "commas and spaces": " {}, {}, {}, {}",
    "commas at the end": "{},{},{},{},",
    "semicolons": "{};{};{};{}",
}


@pytest.mark.parametrize("line", SEPARATED.values(), ids=SEPARATED.keys())
@pytest.mark.parametrize("start", ["", "\ufeff", "# time x y theta\n", "// c\n\n"])
def test_separators_are_recognized(tmp_path: Path, line: str, start: str) -> None:
    lines = "\n".join(line.format(time, *pose) for time, pose in zip(TIMES, POSES.tolist(), strict=True))
    assert_is_the_trajectory(read_odometry(write(tmp_path, start + lines)))


HEADERS = {
    "time,x,y,theta": (0, 1, 2, 3),
    "x,y,yaw,timestamp": (1, 2, 3, 0),
    "Time [s],X [m],Y [m],Heading [rad]": (0, 1, 2, 3),
}


@pytest.mark.parametrize(("header", "order"), HEADERS.items(), ids=HEADERS.keys())
def test_a_header_names_the_columns(tmp_path: Path, header: str, order: tuple[int, ...]) -> None:
    rows = np.column_stack([TIMES, POSES])[:, order]
    lines = "\n".join(",".join(str(value) for value in row) for row in rows.tolist())
    assert_is_the_trajectory(read_odometry(write(tmp_path, f"{header}\n{lines}\n")))


@pytest.mark.parametrize("name", ["tum", "csv"])
def test_what_was_saved_is_read(tmp_path: Path, name: str) -> None:
    save_trajectory(Trajectory(TIMES, POSES), tmp_path / "a", name)
    assert_is_the_trajectory(read_odometry(tmp_path / "a"))


@pytest.mark.parametrize(
    ("roll", "pitch", "scale"), [(0, 0, 1), (0.2, 0, 1), (-0.1, 0.2, 1), (0, 0, 0.95), (0.1, 0, 1.08)]
)
def test_the_heading_of_a_quaternion_is_its_yaw(tmp_path: Path, roll: float, pitch: float, scale: float) -> None:
    assert_is_the_trajectory(read_odometry(write(tmp_path, tum(roll, pitch, scale))))


@pytest.mark.parametrize(("unit", "name"), [(1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")])
def test_unix_times_in_small_units_are_converted_and_said(tmp_path: Path, unit: float, name: str) -> None:
    lines = "".join(f"{int((1.6e9 + n) * unit)} 0 0 0\n" for n in range(5))
    path = write(tmp_path, lines)
    trajectory, notes = read_trajectory(path)
    np.testing.assert_allclose(trajectory.times, 1.6e9 + np.arange(5.0), atol=1e-5)
    assert notes == (f"the times of {path} are in {name}: they are converted to seconds",)


MATRIX = "1 0 0 0.5 0 1 0 0.5 0 0 1 0\n"
REFUSED = {
    r"line 2: has a quaternion of norm 0, not 1": "1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 0\n",
    r"line 1: has a quaternion of norm 2, not 1": "1 0 0 0 0 0 0 2\n2 0 0 0 0 0 0 1\n",
    r"line 1: has a pose tilted by 180°.*the order of quaternions is qx qy qz qw": "1 0 0 0 1 0 0 0\n" * 2,
    r"line 1: has a pose tilted by 30°": tum(roll=math.pi / 6.0),
    r"line 1: has 12 numbers, not 4 or 8, as in the KITTI format, which has no times": MATRIX * 3,
    r"line 1: has 3 numbers, not 4 or 8": "1 2 3\n",
    r"line 2: has 3 numbers, not 4$": "1 2 3 4\n1 2 3\n",
    r"line 1: has a decimal comma in 1,5": "1,5 2 3 4\n2,5 2 3 4\n",
    r"line 2: has a decimal comma in 2,5": "t;x;y;theta\n2,5;2;3;4\n",
    r"line 1: has the columns time,? ?x y z; t x y θ or TUM": "time,x,y,z\n1,2,3,4\n2,2,3,4\n",
    r"line 3: time runs backwards": "# t\n2 0 0 0\n1 0 0 0\n",
    r"has one pose only": "2 0 0 0\n",
    r"line 3: has a time beyond 1e\+12 s": "1 0 0 0\n2 0 0 0\n1e19 0 0 0\n",
    r"has no numbers in it": "# nothing\n",
    r"line 1: has a number that is not finite": "nan 0 0 0\n2 0 0 0\n",
    r"line 2: has a pose beyond 1e\+09 m": "1 0 0 0\n2 1e10 0 0\n",
}


@pytest.mark.parametrize(("reason", "text"), REFUSED.items(), ids=range(len(REFUSED)))
def test_what_is_no_trajectory_in_the_plane_is_named(tmp_path: Path, reason: str, text: str) -> None:
    with pytest.raises(InputError, match=reason):
        read_odometry(write(tmp_path, text))


# ---- odometry files besides a log


def pose_at(time: float) -> Pose:
    return Pose(0.3 * time, math.sin(0.5 * time), 0.2 * time)


def log(*, has_odometry: bool) -> LidarLog:
    scans = [
        RecordedScan(
            str(n),
            Scan(float(n), np.full(20, 2.0 + 0.01 * n), 0.0, 0.1, 0.1, 10.0),
            pose_at(n) if has_odometry else None,
        )
        for n in range(40)
    ]
    return assemble_log("log", scans, [], Pose(), ReadingOptions())


def odometry_file(folder: Path, frame: Pose = IDENTITY, ahead: float = 0.0, scale: float = 1.0) -> Path:
    times = np.arange(-1.0, 41.0, 0.05)
    poses = np.array([(frame @ pose_at(time)).as_array() for time in times.tolist()]) * (scale, scale, 1.0)
    save_trajectory(Trajectory(times + ahead, poses), folder / "dense.csv")
    return folder / "dense.csv"


def test_a_file_of_the_same_odometry_is_merged(tmp_path: Path) -> None:
    merged = with_odometry_file(log(has_odometry=True), odometry_file(tmp_path))
    assert len(merged.odometry.times) == 840
    between = merged.odometry.along_arcs(np.array([7.025]))[0]
    assert Pose.from_array(between).is_near(pose_at(7.025), 1e-3, 1e-3)


def test_a_file_gives_odometry_to_scans_that_have_none(tmp_path: Path) -> None:
    merged = with_odometry_file(log(has_odometry=False), odometry_file(tmp_path))
    for n, reading in enumerate(merged.scan_odometry):
        assert reading is not None
        assert reading.pose.is_near(pose_at(n), 1e-3, 1e-3)
    assert merged.notes[-1] == f"40 of 40 scans have the odometry of {tmp_path / 'dense.csv'}"


@pytest.mark.parametrize(
    ("frame", "ahead", "scale", "reason"),
    [
        (Pose(), 1000.0, 1.0, "covers 999.000 to 1040.950 s, the scans 0.000 to 39.000 s: it is of another clock"),
        (Pose(3.0, -1.0, 2.0), 0.0, 1.0, "is in another frame than the log's odometry, which is"),
        (Pose(), 2.0, 1.0, r"disagrees with the log's odometry by \d\.\d\d m and 22\.9°"),
        (Pose(), 0.0, 1.3, "disagrees with the log's odometry by"),
    ],
)
def test_a_file_of_another_clock_frame_or_drive_is_refused(
    tmp_path: Path, frame: Pose, ahead: float, scale: float, reason: str
) -> None:
    path = odometry_file(tmp_path, frame, ahead, scale)
    with pytest.raises(InputError, match=reason) as caught:
        with_odometry_file(log(has_odometry=True), path)
    assert caught.value.source == str(path)
