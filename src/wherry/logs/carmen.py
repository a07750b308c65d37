"""Messages of CARMEN logs: scans of the types FLASER, ROBOTLASER and RAWLASER, ODOM and PARAM.

Source: http://carmen.sourceforge.net/logger_playback.html, the header that CARMEN's logger writes into every log.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType

from wherry.logs.carmen_angles import stated_angles, unstated_angles
from wherry.logs.collector import RANGE_PARAMETER, LogCollector
from wherry.logs.log_lines import (
    RANGE_MIN,
    MalformedLineError,
    check_range_max,
    parse_count,
    parse_numbers,
    parse_pose,
    parse_ranges,
    parse_stamp,
)
from wherry.robot import Scan
from wherry.wording import counted

MESSAGE_NAME = re.compile(r"[A-Z][A-Z0-9_]*$")
LASER_NUMBERS = range(10)


def _old_laser(collector: LogCollector, words: list[str]) -> None:
    """``FLASER n r₁…rₙ x y θ odom_x odom_y odom_θ time host logger_time``: m and rad, of the lidar and of the robot."""
    count = parse_count(words, 1)
    if len(words) != count + 11:
        raise MalformedLineError(f"has {len(words)} words, where {count} beams need {count + 11}")
    ranges = parse_ranges(words[2 : 2 + count], collector.range_max)
    poses = parse_numbers(words[2 + count : 8 + count])
    time = parse_stamp(words[8 + count])
    angles = unstated_angles(count, collector.front_field_of_view, collector.front_resolution)
    collector.note_of(words[0], angles.note)
    scan = Scan(time, ranges, angles.start, angles.increment, RANGE_MIN, collector.range_max)
    collector.add_scan(words[0], scan, parse_pose(poses[3:]), parse_pose(poses[:3]), _logger_time(words))


def _robot_laser(collector: LogCollector, words: list[str]) -> None:
    """``ROBOTLASER1 type start fov step range_max accuracy mode n r₁…rₙ m e₁…eₘ lidar(x y θ) robot(x y θ) …``.

    Older logs have no remissions, and not their number m either.
    """
    scan, first = _laser(collector, words)
    if len(words) != first + 14:
        raise MalformedLineError(f"has {len(words)} words, where {len(scan.ranges)} beams need {first + 14}")
    poses = parse_numbers(words[first : first + 6])
    time = parse_stamp(words[first + 11])
    robot, lidar = parse_pose(poses[3:]), parse_pose(poses[:3])
    collector.add_scan(words[0], replace(scan, time=time), robot, lidar, _logger_time(words))


def _raw_laser(collector: LogCollector, words: list[str]) -> None:
    """``RAWLASER1 type start fov step range_max accuracy mode n r₁…rₙ m e₁…eₘ time host logger_time``."""
    scan, first = _laser(collector, words)
    if len(words) != first + 3:
        raise MalformedLineError(f"has {len(words)} words, where {len(scan.ranges)} beams need {first + 3}")
    time = parse_stamp(words[first])
    collector.add_scan(words[0], replace(scan, time=time), None, None, _logger_time(words))


def _laser(collector: LogCollector, words: list[str]) -> tuple[Scan, int]:
    """The scan of a message without its time, and the index of the first word after its readings."""
    if len(words) < 10:
        raise MalformedLineError(f"has only {counted(len(words), 'word')}")
    start, field_of_view, resolution, range_max = parse_numbers(words[2:6])
    count = parse_count(words, 8)
    if len(words) <= 9 + count:
        raise MalformedLineError(f"has {len(words)} words, too few for {count} beams")
    check_range_max(range_max)
    angles = stated_angles(count, start, field_of_view, resolution)
    collector.note_of(words[0], angles.note)
    ranges = parse_ranges(words[9 : 9 + count], range_max)
    without_remissions = 9 + count + (14 if words[0].startswith("ROBOT") else 3)
    if len(words) == without_remissions:
        return Scan(0.0, ranges, angles.start, angles.increment, RANGE_MIN, range_max), 9 + count
    remissions = parse_count(words, 9 + count, minimum=0)
    return Scan(0.0, ranges, angles.start, angles.increment, RANGE_MIN, range_max), 10 + count + remissions


def _logger_time(words: list[str]) -> float | None:
    """Time at which the logger received a message, s since it began, its last word; None if that is no number."""
    try:
        return parse_stamp(words[-1])
    except MalformedLineError:
        return None


def _odom(collector: LogCollector, words: list[str]) -> None:
    """``ODOM x y θ tv rv accel time host logger_time``."""
    if len(words) != 10:
        raise MalformedLineError(f"has {len(words)} words, not 10")
    values = parse_numbers(words[1:7])
    collector.add_odometry(parse_stamp(words[7]), parse_pose(values[:3]), _logger_time(words))


def _param(collector: LogCollector, words: list[str]) -> None:
    """``PARAM name value …``, of which those of the lidars are used."""
    if len(words) >= 3 and words[1] in collector.parameters:
        (value,) = parse_numbers(words[2:3])
        if words[1] == RANGE_PARAMETER and value > 0.0:
            check_range_max(value)
        collector.parameters[words[1]] = value


def ignore_message(collector: LogCollector, words: list[str]) -> None:
    """Ignore a message of another type.

    Raises:
        MalformedLineError: The line cannot be a message.
    """
    if not MESSAGE_NAME.match(words[0]):
        raise MalformedLineError("is not a message of a CARMEN or Wean log")
    if "LASER" in words[0]:
        collector.unread_lasers[words[0]] += 1


CARMEN_PARSERS: Mapping[str, Callable[[LogCollector, list[str]], None]] = MappingProxyType(
    {"FLASER": _old_laser, "RLASER": _old_laser, "ODOM": _odom, "PARAM": _param}
    | {f"LASER{number}": _old_laser for number in LASER_NUMBERS}
    | {f"ROBOTLASER{number}": _robot_laser for number in LASER_NUMBERS}
    | {f"RAWLASER{number}": _raw_laser for number in LASER_NUMBERS}
)
