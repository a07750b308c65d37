"""Reading of lidar logs in the formats of CARMEN and of Wean Hall, plain or gzipped."""

from __future__ import annotations

from pathlib import Path

from wherry.logs.carmen import CARMEN_PARSERS, ignore_message
from wherry.logs.collector import LogCollector
from wherry.logs.lidar_log import LidarLog
from wherry.logs.log_lines import MalformedLineError
from wherry.logs.options import DEFAULT_READING, ReadingOptions
from wherry.logs.text_files import is_comment, numbered_lines
from wherry.logs.wean_hall import WEAN_HALL_PARSERS

PARSERS = {**CARMEN_PARSERS, **WEAN_HALL_PARSERS}


def read_log(path: str | Path, options: ReadingOptions = DEFAULT_READING) -> LidarLog:
    """Read a log of CARMEN messages (scans of all types, ODOM, PARAM) or of Wean Hall's O and L lines.

    Args:
        path: The file, plain or gzipped.
        options: How to read; the topic of scans is the type of their messages, such as ``FLASER``.

    Raises:
        InputError: The file cannot be read, is too large, has no scans or does not state where the lidar sits, or
            (unless lenient) has a malformed line, which the error names.
    """
    collector = LogCollector(str(path), options)
    for number, line in numbered_lines(Path(path)):
        collector.line = number
        if is_comment(line):
            continue
        words = line.split()
        try:
            PARSERS.get(words[0], ignore_message)(collector, words)
        except MalformedLineError as error:
            collector.skip_line(str(error))
    return collector.log()
