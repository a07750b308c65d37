"""One plain sentence that says how a run over a log ended, before its numbers."""

from __future__ import annotations

from wherry.views.metrics_tables import duration, long_metres, size, square_metres
from wherry.wording import counted


def doubtful_map(doubt: str) -> str:
    """The verdict on a map that is probably wrong.

    Args:
        doubt: What speaks against it.
    """
    return f"The map is doubtful: {doubt}."


def finished_map(
    size_m: tuple[float, float], free_area: float, scans: int, distance: float, seconds: float, closures: int
) -> str:
    """The verdict on a map that nothing speaks against.

    Args:
        size_m: Width and height, m.
        free_area: Area of the free space, m².
        scans: Number of scans.
        distance: Length of the robot's way, m.
        seconds: Duration of the log, s.
        closures: Number of closed loops.
    """
    drive = f"the robot drove {long_metres(distance)} in {duration(seconds)}; {counted(closures, 'loop')} closed"
    return f"A map of {size(size_m)} ({square_metres(free_area)} free) from {counted(scans, 'scan')}: {drive}."
