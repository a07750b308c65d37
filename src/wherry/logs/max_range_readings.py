"""Detection of the reading that a lidar gives for beams without a return, where its log does not state it.

Many lidars report a missing return as their longest range, or as a code near it. In a building, long readings become
rarer with the range. If more readings lie next to the longest one than in the whole metre below, they are not walls.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wherry.robot import Scan
from wherry.space.trajectory import Trajectory

MIN_COUNT = 50  # readings near the longest one below which they count as walls
MIN_SHARE, MAX_SHARE = 0.002, 0.5  # share of the readings near the longest one outside of which they count as walls
PEAK_WIDTH = 0.1  # m below the longest reading that count as near it
COMPARED_WIDTH = 1.0  # m below the peak, width of the band whose readings are compared with those of the peak


def mark_beams_without_return(scans: Sequence[Scan], odometry: Trajectory) -> tuple[tuple[Scan, ...], str]:
    """The scans with infinite ranges for beams without a return, which would otherwise appear as a wall on the map.

    Args:
        scans: The scans.
        odometry: All odometry.

    Returns:
        The scans, and a note on the reading that was taken as no return; empty if there is none.
    """
    ranges = np.concatenate([scan.ranges for scan in scans])
    readings = ranges[np.isfinite(ranges)]
    if len(readings) == 0:
        return tuple(scans), ""
    longest = float(readings.max()) - PEAK_WIDTH
    count = int((readings >= longest).sum())
    compared = int((readings >= longest - COMPARED_WIDTH).sum()) - count
    share = count / len(readings)
    if count < max(MIN_COUNT, compared) or not MIN_SHARE <= share <= MAX_SHARE:
        return tuple(scans), ""
    marked = tuple(
        replace(scan, ranges=np.where(scan.ranges >= longest, np.inf, scan.ranges), range_max=longest) for scan in scans
    )
    return marked, f"{share:.1%} of the readings are about {float(readings.max()):.2f} m, and are taken as no return"
