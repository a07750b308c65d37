"""Reading of a recording in any format."""

from __future__ import annotations

from pathlib import Path

from wherry.errors import InputError
from wherry.logs.lidar_log import LidarLog
from wherry.logs.options import DEFAULT_READING, ReadingOptions
from wherry.logs.reading import read_log
from wherry.ros.bags.reading import is_bag, read_bag


def read_recording(path: Path, options: ReadingOptions = DEFAULT_READING) -> LidarLog:
    """Read a bag, or a text log as `wherry.logs.read_log`.

    Raises:
        InputError: The recording cannot be used, or a topic of odometry is chosen in a text log.
    """
    if is_bag(path):
        return read_bag(path, options)
    if options.odometry_topic is not None and path.exists():
        reason = f"is for bags only; {path} is a text log, whose odometry is in its lines"
        raise InputError("--odom-topic", options.odometry_topic, reason)
    return read_log(path, options)


def recording_name(path: Path) -> str:
    """The name of a recording without the suffixes of its format, to name its results by."""
    resolved = path.resolve()
    if resolved.is_dir():
        return resolved.name or "recording"
    return Path(resolved.name.removesuffix(".gz")).stem or "recording"
