"""Detection of the reading that a lidar gives for beams without a return, where its log does not state it.

Many lidars answer with their longest range, or a code near it. In a building, readings become fewer and fewer towards
the longest; where more of them lie next to the longest one than in the whole metre below, they are no walls.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wherry.robot import Scan

MIN_COUNT = 50  # readings without a return that a log must have for them to be detected
MIN_SHARE, MAX_SHARE = 0.002, 0.5  # share of all readings that they must have
WIDTH = 0.1  # m below the longest reading in which they lie
COMPARED_WIDTH = 1.0  # m below those in which readings must be fewer


def mark_beams_without_return(scans: Sequence[Scan]) -> tuple[Scan, ...]:
    """The scans with infinite ranges for beams without a return; taken for walls, they would be a ring on the map."""
    ranges = np.concatenate([scan.ranges for scan in scans])
    readings = ranges[np.isfinite(ranges)]
    if len(readings) == 0:
        return tuple(scans)
    longest = float(readings.max()) - WIDTH
    count = int((readings >= longest).sum())
    compared = int((readings >= longest - COMPARED_WIDTH).sum()) - count
    share = count / len(readings)
    if count < max(MIN_COUNT, compared) or not MIN_SHARE <= share <= MAX_SHARE:
        return tuple(scans)
    return tuple(
        replace(scan, ranges=np.where(scan.ranges >= longest, np.inf, scan.ranges), range_max=longest) for scan in scans
    )
