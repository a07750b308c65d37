"""Agreement of a scan with the map at a pose: every beam is an inlier, blocked, passed through, or in unknown space.

An unmapped box and a wrong pose both leave few inliers, but differently: a box blocks beams before they reach the map's
walls, a wrong pose sends beams through walls. Beams that end in unknown space carry little
information, since maps have holes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import kernel
from wherry.localization.sensor import trace_ray
from wherry.space.distance_field import DistanceField
from wherry.space.pose import Floats, Pose

INDEPENDENT_DISTANCE, INDEPENDENT_ANGLE = 0.5, 0.5  # m, rad, motions from which scans count as independent
INLIER_MAX_DISTANCE = 0.15  # m, distance of an inlier's end from the nearest obstacle
PASS_MIN_CLEARANCE = 0.3  # m, distance from all obstacles beyond which a beam has left the obstacle that it entered
SIGMA = 0.1  # m, standard deviation of the beam ends around the obstacles
OUTLIER_LIKELIHOOD = 0.05  # likelihood of an outlier relative to a perfect inlier's
PASS_LIKELIHOOD = 0.01  # likelihood of a beam through an obstacle relative to a perfect inlier's


@dataclass(frozen=True, slots=True)
class ScanAgreement:
    """Agreement of a scan with the map; the four fractions of its beams sum to 1.

    Attributes:
        inlier_fraction: Fraction of the beams that end on the map's obstacles.
        blocked_fraction: Fraction of the beams that end in the map's free space, on something unmapped.
        passed_fraction: Fraction of the beams that went through one of the map's obstacles.
        unknown_fraction: Fraction of the beams that end in the map's unknown space.
        log_likelihood: Mean log likelihood per beam, relative to a beam that ends exactly on an obstacle: 0 at most.
        beam_count: Number of beams.
    """

    inlier_fraction: float
    blocked_fraction: float
    passed_fraction: float
    unknown_fraction: float
    log_likelihood: float
    beam_count: int


def scan_agreement(
    field: DistanceField, known: NDArray[np.bool_], ends: Floats, lidar: Pose, pose: Pose
) -> ScanAgreement:
    """Compare a scan with the map at a pose.

    Args:
        field: Distances to the map's obstacles.
        known: [H, W] whether each cell of the map is known to be free or occupied.
        ends: [B, 2] m, ends of the beams, base_link frame.
        lidar: Pose of the lidar, base_link frame.
        pose: Pose of base_link, map frame.
    """
    if not len(ends):
        return ScanAgreement(0.0, 0.0, 0.0, 0.0, 0.0, 0)
    in_grid = field.origin.inverse @ pose
    start = (in_grid @ lidar).as_array()[:2]
    counts, total = _classify_beams(field.distance, known, field.resolution, start, in_grid.transform(ends))
    inliers, blocked, passed, unknown = (counts / len(ends)).tolist()
    return ScanAgreement(inliers, blocked, passed, unknown, total / len(ends), len(ends))


class ScanComparison:
    """Compares scans with one map.

    Args:
        field: Distances to the map's obstacles.
        known: [H, W] whether each cell of the map is known to be free or occupied.
        lidar: Pose of the lidar, base_link frame.

    Attributes:
        field: Distances to the map's obstacles.
    """

    def __init__(self, field: DistanceField, known: NDArray[np.bool_], lidar: Pose) -> None:
        self.field = field
        self._known = known
        self._lidar = lidar

    def agreement(self, ends: Floats, pose: Pose) -> ScanAgreement:
        """As `scan_agreement` for the ends of the beams [B, 2] m, base_link frame, and a pose in the map frame."""
        return scan_agreement(self.field, self._known, ends, self._lidar, pose)


def mean_agreement(scans: Sequence[ScanAgreement]) -> ScanAgreement:
    """The unweighted mean of the agreement of one or more scans with the map."""
    return ScanAgreement(
        inlier_fraction=fmean(scan.inlier_fraction for scan in scans),
        blocked_fraction=fmean(scan.blocked_fraction for scan in scans),
        passed_fraction=fmean(scan.passed_fraction for scan in scans),
        unknown_fraction=fmean(scan.unknown_fraction for scan in scans),
        log_likelihood=fmean(scan.log_likelihood for scan in scans),
        beam_count=sum(scan.beam_count for scan in scans),
    )


@kernel
def _classify_beams(
    distance: NDArray[np.float32], known: NDArray[np.bool_], resolution: float, start: Floats, ends: Floats
) -> tuple[NDArray[np.int64], float]:
    """Classify the beams and compute their likelihoods.

    Args:
        distance: [H, W] m, distances to the nearest obstacle.
        known: [H, W] whether each cell of the map is known to be free or occupied.
        resolution: Side of a cell, m.
        start: [2] m, position of the lidar in the grid's frame.
        ends: [B, 2] m, ends of the beams in the grid's frame.

    Returns:
        [4] numbers of inliers and of blocked, passed and unknown beams, and the sum of the beams' log likelihoods.
    """
    height, width = distance.shape
    counts = np.zeros(4, np.int64)
    total = 0.0
    for b in range(len(ends)):
        dx, dy = ends[b, 0] - start[0], ends[b, 1] - start[1]
        length = max(math.hypot(dx, dy), 1e-9)
        column, row = ends[b, 0] / resolution, ends[b, 1] / resolution
        gap, is_known = np.inf, False
        if 0.0 <= column < width and 0.0 <= row < height:
            gap, is_known = distance[int(row), int(column)], known[int(row), int(column)]
        likelihood = math.exp(-0.5 * gap * gap / (SIGMA * SIGMA)) + OUTLIER_LIKELIHOOD
        if _passes_through(distance, resolution, start, dx / length, dy / length, length):
            counts[2] += 1
            likelihood = PASS_LIKELIHOOD
        elif gap <= INLIER_MAX_DISTANCE:
            counts[0] += 1
        elif is_known:
            counts[1] += 1
        else:
            counts[3] += 1
        total += math.log(likelihood / (1.0 + OUTLIER_LIKELIHOOD))
    return counts, total


@kernel
def _passes_through(
    distance: NDArray[np.float32], resolution: float, start: Floats, cos: float, sin: float, length: float
) -> bool:
    """Whether a beam of this length enters an obstacle and leaves it again.

    A beam that meets a wall at a small angle runs inside it for a while without passing through.
    """
    height, width = distance.shape
    x, y = start[0] / resolution, start[1] / resolution
    travelled = trace_ray(distance, resolution, x, y, cos, sin, length)
    while travelled < length:
        column, row = x + cos * travelled / resolution, y + sin * travelled / resolution
        if not (0.0 <= column < width and 0.0 <= row < height):
            return True
        gap = distance[int(row), int(column)]
        if gap > PASS_MIN_CLEARANCE:
            return True
        travelled += max(resolution, PASS_MIN_CLEARANCE - gap)
    return False
