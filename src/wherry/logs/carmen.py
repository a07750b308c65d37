"""Lidar logs: CARMEN's and Wean Hall's formats, plain or gzipped, checked line by line.

Broken lines are an error that names the line or, where the caller is lenient, are left out and counted.
"""

from __future__ import annotations

import gzip
import math
import re
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from wherry.errors import InputError
from wherry.robot import Odometry, Scan, Velocity
from wherry.space.pose import IDENTITY, Floats, Pose
from wherry.space.trajectory import Trajectory

LARGEST_FILE = 1_000_000_000  # bytes, unpacked
MOST_PACKED, ALWAYS_UNPACKED = 100, 10_000_000  # a log is not packed more than so many times; bytes that are no bomb
LONGEST_LINE = 200_000  # bytes
MOST_BEAMS = 20_000
LARGEST_NUMBER = 1e18  # times in nanoseconds are smaller
LARGEST_COORDINATE = 1e9  # m
LONGEST_JUMP = 100.0  # m from scan to scan: no robot's step, and a map of such a log would be wrong
SICK_MAX = 80.0  # m, from where on a reading of an unnamed lidar is none; SICKs answer 81.83 or 81.91
WEAN_MAX = 80.0  # m, likewise
WEAN_UNIT = 0.01  # m, its logs are in centimetres
RANGE_MIN = 0.02  # m
# A lidar answers with its longest range, or a code near it, where nothing was met; few logs say what that is. It shows:
# so many readings of the log, at least and at most, lie within the first distance of the longest one, and no more in
# the second distance below, m. In a building, readings become fewer and fewer towards the longest.
LEAST_ANSWERS, LEAST_SHARE, LARGEST_SHARE = 50, 0.002, 0.5
ANSWERS, BELOW = 0.1, 1.0
SAME_MOUNT = 1e-3  # m and rad, by which a lidar's place on its robot may differ from line to line
CARMEN_WORD = re.compile(r"[A-Z][A-Z0-9_]*$")


@dataclass(frozen=True)
class LidarLog:
    """What was recorded.

    Attributes:
        scans: In the order of their times.
        scan_odometry: [N] of the robot at each scan's instant, or None where the log has none.
        odometry: All odometry of the log, that of the scans included, in the order of its times.
        lidar: Where it is mounted, in the base_link frame.
        skipped: Lines that were left out, as ``line 12: why``.
    """

    scans: tuple[Scan, ...]
    scan_odometry: tuple[Odometry | None, ...]
    odometry: Trajectory
    lidar: Pose
    skipped: tuple[str, ...]


def read_log(path: str | Path, *, lenient: bool = False) -> LidarLog:
    """Read a log of CARMEN messages (FLASER, ROBOTLASER1, ODOM) or of Wean Hall's O and L lines.

    Args:
        path: The file; gzipped if its name ends in .gz.
        lenient: Whether to leave broken lines out instead of refusing the file.

    Raises:
        InputError: The file cannot be read, is too large, has no scans, or (unless lenient) a line is broken: the
            error names it.
    """
    collected = _Collected(str(path), lenient)
    for number, line in _lines(Path(path)):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        try:
            PARSERS.get(words[0], _pass_over)(collected, words)
        except _BrokenLineError as error:
            collected.refuse(number, str(error))
    return collected.log()


def read_odometry(path: str | Path) -> Trajectory:
    """Read poses of increasing time, a line each: ``t x y θ``, or TUM's ``t x y z qx qy qz qw``.

    Raises:
        InputError: The file cannot be read or a line is broken.
    """
    rows = read_rows(path, widths=(4, 8))
    if rows.shape[1] == 8:
        rows = np.column_stack([rows[:, :3], 2.0 * np.arctan2(rows[:, 6], rows[:, 7])])
    backwards = np.flatnonzero(np.diff(rows[:, 0]) < 0.0)
    if len(backwards):
        raise InputError(path, f"pose {backwards[0] + 2}", "time runs backwards")
    return Trajectory(rows[:, 0], rows[:, 1:])


def read_rows(path: str | Path, *, widths: tuple[int, ...]) -> Floats:
    """Read a table of finite numbers, a row a line; # begins a comment.

    Args:
        path: The file; gzipped if its name ends in .gz.
        widths: How many numbers a line may have; all lines have the same.

    Raises:
        InputError: The file cannot be read, is empty, or a line is broken.
    """
    rows: list[list[float]] = []
    for number, line in _lines(Path(path)):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        allowed = (len(rows[0]),) if rows else widths
        if len(words) not in allowed:
            wanted = " or ".join(str(width) for width in allowed)
            raise InputError(path, f"line {number}", f"has {len(words)} numbers, not {wanted}")
        try:
            rows.append(_numbers(words))
        except _BrokenLineError as error:
            raise InputError(path, f"line {number}", str(error)) from error
    if not rows:
        raise InputError(path, "", "has no numbers in it")
    return np.array(rows)


class _BrokenLineError(Exception):
    """A line that cannot be used, and why."""


@dataclass
class _Collected:
    """What was read so far.

    Attributes:
        source: The file.
        lenient: Whether broken lines are left out.
        lidar_word: The message that scans are taken from: the first kind that came.
        offset: m, of the lidar before the robot's middle, if the log says so.
        range_max: m, if the log says so.
        scans: With the odometry of their instant and the lidar's pose in the odometry's frame.
        odometry: Times and poses from odometry messages.
        skipped: Lines that were left out.
    """

    source: str
    lenient: bool
    lidar_word: str = ""
    offset: float | None = None
    range_max: float = SICK_MAX
    scans: list[tuple[Scan, Pose, Pose]] = field(default_factory=list)
    odometry: list[tuple[float, Pose]] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)

    def refuse(self, number: int, reason: str) -> None:
        """Leave a line out, or refuse the file."""
        if not self.lenient:
            raise InputError(self.source, f"line {number}", reason)
        self.skipped.append(f"line {number}: {reason}")

    def add_scan(self, scan: Scan, robot: Pose, lidar: Pose) -> None:
        """Take a scan if it follows the ones before."""
        if self.scans:
            last = self.scans[-1][0]
            if scan.time < last.time:
                raise _BrokenLineError(f"time runs backwards, from {last.time:.6f} to {scan.time:.6f}")
            if len(scan.ranges) != len(last.ranges):
                raise _BrokenLineError(f"has {len(scan.ranges)} beams where the scans before have {len(last.ranges)}")
            if scan.time == last.time and np.array_equal(scan.ranges, last.ranges):
                return  # logged twice
            before = self.scans[-1][1]
            jump = math.hypot(robot.x - before.x, robot.y - before.y)
            if jump > LONGEST_JUMP:
                raise _BrokenLineError(f"odometry jumps by {jump:,.0f} m since the scan before")
        self.scans.append((scan, robot, lidar))

    def add_odometry(self, time: float, pose: Pose) -> None:
        """Take odometry if it follows that before."""
        if time == 0.0 and self.odometry:
            return  # gmapping repeats each scan's pose so, without a time
        if self.odometry and time < self.odometry[-1][0]:
            raise _BrokenLineError(f"time runs backwards, from {self.odometry[-1][0]:.6f} to {time:.6f}")
        self.odometry.append((time, pose))

    def log(self) -> LidarLog:
        """Everything, in order.

        Raises:
            InputError: There are no scans.
        """
        if not self.scans:
            left_out = (
                f" ({len(self.skipped)} lines were left out, the first: {self.skipped[0]})" if self.skipped else ""
            )
            raise InputError(self.source, "", "has no scans in it" + left_out)
        scans = _without_empty_answers([scan for scan, _, _ in self.scans])
        at_scans = tuple(Odometry(scan.time, robot, Velocity()) for scan, robot, _ in self.scans)
        every = dict(self.odometry) | {now.time: now.pose for now in at_scans}
        times = sorted(every)
        trajectory = Trajectory(np.array(times), np.array([every[time].as_array() for time in times]))
        return LidarLog(scans, at_scans, trajectory, self._mount(), tuple(self.skipped))

    def _mount(self) -> Pose:
        """Where the lidar is: as the scans' two poses say if they always agree, else as the parameter says.

        Where the lidar's pose was corrected afterwards and the robot's was not, the two do not agree.
        """
        mounts = np.array([lidar.relative_to(robot).as_array() for _, robot, lidar in self.scans])
        if np.abs(mounts - mounts[0]).max() <= SAME_MOUNT and np.abs(mounts[0]).max() > SAME_MOUNT:
            return Pose.from_array(mounts[0])
        return IDENTITY if self.offset is None else Pose(self.offset, 0.0, 0.0)


def _without_empty_answers(scans: Sequence[Scan]) -> tuple[Scan, ...]:
    """The scans, with inf where a reading is what the lidar answers when it meets nothing.

    Taken for a wall, it would be a ring around the robot wherever that goes.
    """
    ranges = np.concatenate([scan.ranges for scan in scans])
    readings = ranges[np.isfinite(ranges)]
    if len(readings) == 0:
        return tuple(scans)
    longest = float(readings.max()) - ANSWERS
    answers = int((readings >= longest).sum())
    below = int((readings >= longest - BELOW).sum()) - answers
    share = answers / len(readings)
    if answers < max(LEAST_ANSWERS, below) or not LEAST_SHARE <= share <= LARGEST_SHARE:
        return tuple(scans)
    return tuple(
        replace(scan, ranges=np.where(scan.ranges >= longest, np.inf, scan.ranges), range_max=longest) for scan in scans
    )


def _parse_flaser(collected: _Collected, words: list[str]) -> None:
    """``FLASER n r₁…rₙ x y θ odom_x odom_y odom_θ time host logger_time``: metres, over the 180° ahead."""
    if collected.lidar_word not in ("", "FLASER"):
        return
    count = _count(words, 1)
    if len(words) != count + 11:
        raise _BrokenLineError(f"has {len(words)} words, where {count} beams need {count + 11}")
    ranges = _ranges(words[2 : 2 + count], collected.range_max)
    poses = _numbers(words[2 + count : 8 + count])
    (time,) = _numbers(words[8 + count : 9 + count])
    # An even number of beams leaves the last one of the half circle out, an odd one has it.
    increment = math.pi / (count if count % 2 == 0 else max(count - 1, 1))
    scan = Scan(time, ranges, -math.pi / 2.0, increment, RANGE_MIN, collected.range_max)
    collected.add_scan(scan, _pose(poses[3:]), _pose(poses[:3]))
    collected.lidar_word = "FLASER"


def _parse_robotlaser(collected: _Collected, words: list[str]) -> None:
    """``ROBOTLASER1 type start fov step range_max accuracy mode n r₁…rₙ m e₁…eₘ lidar(x y θ) robot(x y θ) …``."""
    if collected.lidar_word not in ("", "ROBOTLASER1"):
        return
    if len(words) < 10:
        raise _BrokenLineError(f"has only {len(words)} words")
    start, _, increment, range_max = _numbers(words[2:6])
    count = _count(words, 8)
    if len(words) <= 9 + count:
        raise _BrokenLineError(f"has {len(words)} words, too few for {count} beams")
    remissions = _count(words, 9 + count, least=0)
    first = 10 + count + remissions
    if len(words) != first + 14:
        raise _BrokenLineError(f"has {len(words)} words, where {count} beams need {first + 14}")
    if increment <= 0.0 or range_max <= 0.0:
        raise _BrokenLineError("the angle between beams and the longest range must be above 0")
    ranges = _ranges(words[9 : 9 + count], range_max)
    poses = _numbers(words[first : first + 6])
    (time,) = _numbers(words[first + 11 : first + 12])
    collected.add_scan(Scan(time, ranges, start, increment, RANGE_MIN, range_max), _pose(poses[3:]), _pose(poses[:3]))
    collected.lidar_word = "ROBOTLASER1"


def _parse_odom(collected: _Collected, words: list[str]) -> None:
    """``ODOM x y θ tv rv accel time host logger_time``."""
    if len(words) != 10:
        raise _BrokenLineError(f"has {len(words)} words, not 10")
    values = _numbers(words[1:8])
    collected.add_odometry(values[6], _pose(values[:3]))


def _parse_param(collected: _Collected, words: list[str]) -> None:
    """``PARAM name value …``: two of them say where the lidar is and how far it sees."""
    if len(words) >= 3 and words[1] in ("robot_frontlaser_offset", "robot_front_laser_max"):
        (value,) = _numbers(words[2:3])
        if words[1] == "robot_frontlaser_offset":
            collected.offset = value
        elif value > 0.0:
            collected.range_max = value


def _parse_wean_lidar(collected: _Collected, words: list[str]) -> None:
    """``L x y θ lidar_x lidar_y lidar_θ r₁…rₙ t``: centimetres, from right to left over the 180° ahead."""
    count = len(words) - 8
    if not 1 <= count <= MOST_BEAMS:
        raise _BrokenLineError(f"has {len(words)} words, too few or too many")
    values = _numbers(words[1:7])
    metres = [values[0] * WEAN_UNIT, values[1] * WEAN_UNIT, values[2]]
    lidar = [values[3] * WEAN_UNIT, values[4] * WEAN_UNIT, values[5]]
    ranges = _ranges(words[7:-1], WEAN_MAX, unit=WEAN_UNIT)
    (time,) = _numbers(words[-1:])
    increment = math.pi / (count if count % 2 == 0 else max(count - 1, 1))
    collected.add_scan(Scan(time, ranges, -math.pi / 2.0, increment, RANGE_MIN, WEAN_MAX), _pose(metres), _pose(lidar))


def _parse_wean_odometry(collected: _Collected, words: list[str]) -> None:
    """``O x y θ t``: centimetres."""
    if len(words) != 5:
        raise _BrokenLineError(f"has {len(words)} words, not 5")
    x, y, theta, time = _numbers(words[1:])
    collected.add_odometry(time, _pose([x * WEAN_UNIT, y * WEAN_UNIT, theta]))


def _pass_over(collected: _Collected, words: list[str]) -> None:
    """A message of another kind; anything that cannot be one is a broken line."""
    if not CARMEN_WORD.match(words[0]):
        raise _BrokenLineError("is not a message of a CARMEN or Wean log")


PARSERS: dict[str, Callable[[_Collected, list[str]], None]] = {
    "FLASER": _parse_flaser,
    "ROBOTLASER1": _parse_robotlaser,
    "ODOM": _parse_odom,
    "PARAM": _parse_param,
    "L": _parse_wean_lidar,
    "O": _parse_wean_odometry,
}


def _numbers(words: list[str]) -> list[float]:
    """The words as finite numbers."""
    try:
        values = [float(word) for word in words]
    except ValueError as error:
        raise _BrokenLineError(f"has a word that is not a number: {str(error).rpartition(': ')[2]}") from error
    if not all(math.isfinite(value) for value in values):
        raise _BrokenLineError("has a number that is not finite")
    if any(abs(value) > LARGEST_NUMBER for value in values):
        raise _BrokenLineError(f"has a number beyond {LARGEST_NUMBER:g}")
    return values


def _count(words: list[str], at: int, least: int = 1) -> int:
    """A number of things that follow."""
    try:
        count = int(words[at])
    except (ValueError, IndexError) as error:
        raise _BrokenLineError("does not say how many beams it has") from error
    if not least <= count <= MOST_BEAMS:
        raise _BrokenLineError(f"has {count} beams; {least} to {MOST_BEAMS:,} are possible")
    return count


def _ranges(words: list[str], range_max: float, unit: float = 1.0) -> Floats:
    """[R] m; what is at or beyond the longest range met nothing."""
    ranges = np.array(_numbers(words)) * unit
    if (ranges < 0.0).any():
        raise _BrokenLineError("has a negative range")
    return np.where(ranges >= range_max, np.inf, ranges)


def _pose(values: list[float]) -> Pose:
    """A pose of three finite numbers."""
    if max(abs(value) for value in values) > LARGEST_COORDINATE:
        raise _BrokenLineError(f"has a pose beyond {LARGEST_COORDINATE:g} m")
    return Pose.from_array(np.array(values))


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """The lines of a text file, plain or gzipped, numbered from 1; never more at once than one of them."""
    size = 0
    try:
        packed = path.stat().st_size if path.suffix == ".gz" else LARGEST_FILE
        with gzip.open(path, "rb") if path.suffix == ".gz" else path.open("rb") as file:
            number = 0
            while line := file.readline(LONGEST_LINE + 1):
                number, size = number + 1, size + len(line)
                if len(line) > LONGEST_LINE:
                    raise InputError(path, f"line {number}", f"is longer than {LONGEST_LINE:,} bytes")
                if size > LARGEST_FILE:
                    raise InputError(path, "", f"is larger than {LARGEST_FILE:,} bytes, unpacked")
                if size > max(ALWAYS_UNPACKED, MOST_PACKED * packed):
                    raise InputError(path, f"line {number}", f"unpacks to over {MOST_PACKED} times the file's size")
                yield number, line.decode("utf-8", errors="replace")
    except (OSError, EOFError, zlib.error) as error:
        reason = getattr(error, "strerror", None) or f"is not a whole gzip file: {error}"
        raise InputError(path, "", reason) from error
