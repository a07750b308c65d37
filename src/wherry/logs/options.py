"""Options of reading a recording, which state what the recording leaves open."""

from __future__ import annotations

from dataclasses import dataclass

from wherry.space.pose import Pose

LIDAR_HINT = "--lidar x,y,theta states it (m, m, degrees)"  # end of a message on a pose of the lidar that is not known


@dataclass(frozen=True, slots=True)
class ReadingOptions:
    """How to read a log or a bag.

    Attributes:
        lenient: Whether to leave malformed lines or messages out; otherwise the first one raises an error.
        lidar: Pose of the lidar in the base_link frame; None to take that of the recording.
        scan_topic: Topic of the scans in a bag, or type of their messages in a text log, as FLASER; None to choose.
        odometry_topic: Topic of odometry in a bag; None to choose.
    """

    lenient: bool = False
    lidar: Pose | None = None
    scan_topic: str | None = None
    odometry_topic: str | None = None


DEFAULT_READING = ReadingOptions()
