"""Detection of the reading that a lidar gives for beams without a return, where its recording does not state it.

Many lidars report a missing return as one longest range, or as a few codes near it. In a building, long readings become
rarer with the range. Readings are no walls if more of them lie next to the longest one than in the whole metre below,
or if one value is far more frequent than any other there; if they have only a few different values, if beams of many
directions have them, and if they are the same elsewhere.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wherry.robot import Odometry, Scan
from wherry.space.pose import Floats, wrap_angles

MIN_LONGEST = 1.0  # m, longest reading of a lidar that reaches anywhere
MIN_COUNT = 50  # readings near the longest one below which they count as walls
MIN_SHARE, MAX_SHARE = 0.002, 0.98  # share of the readings near the longest one outside of which they count as walls
PEAK_WIDTHS = (0.1, 0.01)  # m below the longest reading that count as near it; the wider one where it has codes only
COMPARED_WIDTH = 1.0  # m below the peak, width of the band whose readings are compared with those of the peak
MAX_CODES = 3  # different values, to the millimetre, that a lidar reports without a return
MIN_FREQUENCY_RATIO = 5.0  # frequency of the most frequent value of the peak ÷ that of the metre below
MIN_CODES_SHARE = 0.9  # share of the readings of the peak that have these values
MIN_DIRECTIONS = 5  # beams of different directions that had these readings, so that they are not one distant wall
MIN_DISTANCE = 0.5  # m between places from which walls have other ranges
MIN_TURN = 0.1  # rad, of a robot that turns
MIN_CHANGE = 0.1  # m by which the other readings change while the robot drives
QUANTILES = np.linspace(0.1, 0.9, 9)  # of the other readings of a scan
MAX_COUNTED = 2_000_000  # readings that are counted, of evenly spaced scans, so that memory stays small
COMPARED_SCANS = 500  # scans whose readings are compared


def mark_beams_without_return(
    scans: Sequence[Scan], odometry: Sequence[Odometry | None]
) -> tuple[tuple[Scan, ...], str]:
    """The scans with infinite ranges for beams without a return, which would otherwise appear as a wall on the map.

    Args:
        scans: The scans.
        odometry: Odometry at each scan; None where there is none.

    Returns:
        The scans, and a note on the reading that was taken as no return; empty if there is none.
    """
    longest = max((_longest_reading(scan) for scan in scans), default=0.0)
    counted = scans[:: 1 + sum(len(scan.ranges) for scan in scans) // MAX_COUNTED]
    total = sum(int(np.isfinite(scan.ranges).sum()) for scan in counted)
    found = (_readings_of_peak(counted, longest, longest - width, total) for width in PEAK_WIDTHS)
    peak, near = next((peak for peak in found if peak is not None), (longest, np.zeros(0)))
    if not len(near):
        return tuple(scans), ""
    members = [index for index, scan in enumerate(scans) if len(_between(scan, peak, longest))]
    if _directions([scans[index] for index in members], peak) < MIN_DIRECTIONS:
        return tuple(scans), ""
    readings = f"{len(near) / total:.1%} of the readings are {np.median(near):.2f} m, the longest of all"
    if len(near) > MAX_SHARE * total:
        return tuple(scans), f"{readings}; since there are hardly any others, they are kept as walls"
    if not _from_different_places([scans[index] for index in members], [odometry[index] for index in members], peak):
        return tuple(scans), f"{readings}; since the robot stays in its place, they are kept as walls"
    marked = tuple(
        replace(scan, ranges=np.where(scan.ranges >= peak, np.inf, scan.ranges), range_max=peak) for scan in scans
    )
    return marked, f"{readings}: they are taken as no return"


def _longest_reading(scan: Scan) -> float:
    """The longest finite reading of a scan, m, or 0 if it has none."""
    return float(np.max(scan.ranges, initial=0.0, where=np.isfinite(scan.ranges)))


def _readings_of_peak(scans: Sequence[Scan], longest: float, peak: float, total: int) -> tuple[float, Floats] | None:
    """A lower limit, m, with the readings from it to the longest one, if many of all have one of a few values there."""
    near = np.concatenate([_between(scan, peak, longest) for scan in scans])
    if longest < MIN_LONGEST or len(near) < max(MIN_COUNT, MIN_SHARE * total) or not _is_code(near):
        return None
    below = np.concatenate([_between(scan, peak - COMPARED_WIDTH, np.nextafter(peak, 0.0)) for scan in scans])
    return (peak, near) if _stands_out(near, below) else None


def _between(scan: Scan, lower: float, upper: float) -> Floats:
    """The readings of a scan from a lower to an upper range, m."""
    return scan.ranges[(scan.ranges >= lower) & (scan.ranges <= upper)]


def _is_code(readings: Floats) -> bool:
    """Whether readings, m, have only a few different values."""
    _, counts = np.unique(np.round(readings, 3), return_counts=True)
    return bool(np.sort(counts)[-MAX_CODES:].sum() >= MIN_CODES_SHARE * len(readings))


def _stands_out(readings: Floats, below: Floats) -> bool:
    """Whether readings, m, are more than those of the metre below, or have a value that is far more frequent."""
    return len(readings) >= len(below) or _frequency(readings) >= MIN_FREQUENCY_RATIO * _frequency(below)


def _frequency(readings: Floats) -> int:
    """Number of the readings, m, that have the most frequent value, to the millimetre."""
    _, counts = np.unique(np.round(readings, 3), return_counts=True)
    return int(counts.max())


def _directions(scans: Sequence[Scan], peak: float) -> int:
    """Number of beams that had a reading at or above the peak, m, in any of the scans."""
    beams = np.zeros(max(len(scan.ranges) for scan in scans), np.bool_)
    for scan in scans:
        beams[: len(scan.ranges)] |= (scan.ranges >= peak) & np.isfinite(scan.ranges)
    return int(beams.sum())


def _from_different_places(scans: Sequence[Scan], odometry: Sequence[Odometry | None], peak: float) -> bool:
    """Whether scans are from different places: by odometry, or else by the change of the readings below the peak."""
    poses = np.array([reading.pose.as_array() for reading in odometry if reading is not None]).reshape(-1, 3)
    if len(poses) and math.hypot(*np.ptp(poses[:, :2], axis=0)) >= MIN_DISTANCE:
        return True
    if len(poses) and np.ptp(wrap_angles(poses[:, 2] - poses[0, 2])) >= MIN_TURN:
        return False
    chosen = scans[:: max(1, len(scans) // COMPARED_SCANS)]
    below = [_between(scan, scan.range_min, np.nextafter(peak, 0.0)) for scan in chosen]
    quantiles = np.array([np.quantile(readings, QUANTILES) for readings in below if len(readings) >= len(QUANTILES)])
    return len(quantiles) > 1 and bool(np.median(np.ptp(quantiles, axis=0)) >= MIN_CHANGE)
