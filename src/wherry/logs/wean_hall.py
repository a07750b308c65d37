"""Messages of the logs of Carnegie Mellon's Wean Hall: O for odometry, L for scans, both in centimetres."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from wherry.logs.carmen_angles import HALF_CIRCLE, unstated_angles
from wherry.logs.collector import LogCollector
from wherry.logs.lidar_log import MAX_BEAMS
from wherry.logs.log_lines import RANGE_MIN, MalformedLineError, parse_numbers, parse_pose, parse_ranges, parse_stamp
from wherry.robot import Scan

RANGE_MAX = 80.0  # m, longest valid range of the lidar
CENTIMETRE = 0.01  # m


def _lidar(collector: LogCollector, words: list[str]) -> None:
    """``L x y θ lidar_x lidar_y lidar_θ r₁…rₙ t``: cm and rad, of the half circle ahead from right to left."""
    count = len(words) - 8
    if not 1 <= count <= MAX_BEAMS:
        raise MalformedLineError(f"has {len(words)} words, too few or too many")
    values = parse_numbers(words[1:7])
    robot = [values[0] * CENTIMETRE, values[1] * CENTIMETRE, values[2]]
    lidar = [values[3] * CENTIMETRE, values[4] * CENTIMETRE, values[5]]
    ranges = parse_ranges(words[7:-1], RANGE_MAX, unit=CENTIMETRE)
    time = parse_stamp(words[-1])
    angles = unstated_angles(count, HALF_CIRCLE, None)
    scan = Scan(time, ranges, angles.start, angles.increment, RANGE_MIN, RANGE_MAX)
    collector.add_scan("L", scan, parse_pose(robot), parse_pose(lidar))


def _odometry(collector: LogCollector, words: list[str]) -> None:
    """``O x y θ t``: cm, rad and s."""
    if len(words) != 5:
        raise MalformedLineError(f"has {len(words)} words, not 5")
    x, y, theta = parse_numbers(words[1:4])
    collector.add_odometry(parse_stamp(words[4]), parse_pose([x * CENTIMETRE, y * CENTIMETRE, theta]))


WEAN_HALL_PARSERS: Mapping[str, Callable[[LogCollector, list[str]], None]] = MappingProxyType(
    {"L": _lidar, "O": _odometry}
)
