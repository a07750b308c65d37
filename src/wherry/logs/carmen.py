"""Messages of CARMEN logs: FLASER, ROBOTLASER1, ODOM and PARAM."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from types import MappingProxyType

from wherry.logs.collector import LogCollector
from wherry.logs.log_lines import (
    RANGE_MIN,
    MalformedLineError,
    half_circle_scan,
    parse_count,
    parse_numbers,
    parse_pose,
    parse_ranges,
)
from wherry.robot import Scan

MESSAGE_NAME = re.compile(r"[A-Z][A-Z0-9_]*$")


def _flaser(collector: LogCollector, words: list[str]) -> None:
    """``FLASER n r₁…rₙ x y θ odom_x odom_y odom_θ time host logger_time``: m and rad, of the half circle ahead."""
    if collector.scan_message not in ("", "FLASER"):
        return
    count = parse_count(words, 1)
    if len(words) != count + 11:
        raise MalformedLineError(f"has {len(words)} words, where {count} beams need {count + 11}")
    ranges = parse_ranges(words[2 : 2 + count], collector.range_max)
    poses = parse_numbers(words[2 + count : 8 + count])
    (time,) = parse_numbers(words[8 + count : 9 + count])
    scan = half_circle_scan(time, ranges, collector.range_max)
    collector.add_scan(scan, parse_pose(poses[3:]), parse_pose(poses[:3]))
    collector.scan_message = "FLASER"


def _robotlaser(collector: LogCollector, words: list[str]) -> None:
    """``ROBOTLASER1 type start fov step range_max accuracy mode n r₁…rₙ m e₁…eₘ lidar(x y θ) robot(x y θ) …``."""
    if collector.scan_message not in ("", "ROBOTLASER1"):
        return
    if len(words) < 10:
        raise MalformedLineError(f"has only {len(words)} words")
    start, _, increment, range_max = parse_numbers(words[2:6])
    count = parse_count(words, 8)
    if len(words) <= 9 + count:
        raise MalformedLineError(f"has {len(words)} words, too few for {count} beams")
    remissions = parse_count(words, 9 + count, minimum=0)
    first = 10 + count + remissions
    if len(words) != first + 14:
        raise MalformedLineError(f"has {len(words)} words, where {count} beams need {first + 14}")
    if increment <= 0.0 or range_max <= 0.0:
        raise MalformedLineError("the angle between beams and the longest range must be above 0")
    ranges = parse_ranges(words[9 : 9 + count], range_max)
    poses = parse_numbers(words[first : first + 6])
    (time,) = parse_numbers(words[first + 11 : first + 12])
    scan = Scan(time, ranges, start, increment, RANGE_MIN, range_max)
    collector.add_scan(scan, parse_pose(poses[3:]), parse_pose(poses[:3]))
    collector.scan_message = "ROBOTLASER1"


def _odom(collector: LogCollector, words: list[str]) -> None:
    """``ODOM x y θ tv rv accel time host logger_time``."""
    if len(words) != 10:
        raise MalformedLineError(f"has {len(words)} words, not 10")
    values = parse_numbers(words[1:8])
    collector.add_odometry(values[6], parse_pose(values[:3]))


def _param(collector: LogCollector, words: list[str]) -> None:
    """``PARAM name value …``, of which the lidar's offset and its longest range are used."""
    if len(words) >= 3 and words[1] in ("robot_frontlaser_offset", "robot_front_laser_max"):
        (value,) = parse_numbers(words[2:3])
        if words[1] == "robot_frontlaser_offset":
            collector.lidar_offset = value
        elif value > 0.0:
            collector.range_max = value


def ignore_message(_collector: LogCollector, words: list[str]) -> None:
    """Ignore a message of another type.

    Raises:
        MalformedLineError: The line cannot be a message.
    """
    if not MESSAGE_NAME.match(words[0]):
        raise MalformedLineError("is not a message of a CARMEN or Wean log")


CARMEN_PARSERS: Mapping[str, Callable[[LogCollector, list[str]], None]] = MappingProxyType(
    {"FLASER": _flaser, "ROBOTLASER1": _robotlaser, "ODOM": _odom, "PARAM": _param}
)
