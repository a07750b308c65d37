"""Reading of a recording in any format."""

from __future__ import annotations

from pathlib import Path

from wherry.logs.lidar_log import LidarLog
from wherry.logs.options import DEFAULT_READING, ReadingOptions
from wherry.logs.reading import read_log
from wherry.ros.bags.reading import is_bag, read_bag


def read_recording(path: Path, options: ReadingOptions = DEFAULT_READING) -> LidarLog:
    """Read a bag, or a text log as `wherry.logs.read_log`.

    Raises:
        InputError: The recording cannot be used.
    """
    return read_bag(path, options) if is_bag(path) else read_log(path, options)
