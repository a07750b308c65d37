"""How well a scan agrees with the map at a pose: beam by beam, what the map explains and what it contradicts.

An unmapped box and a wrong pose both leave beams unexplained. They differ in the way: a box stops beams short of the
map's walls, a wrong pose sends beams through them. Beams that end where the map knows nothing tell hardly anything:
maps have holes.
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
from wherry.space.pose import Pose

Floats = NDArray[np.float64]

TOLERANCE = 0.15  # m; a beam that ends so near to an obstacle is explained
CLEARANCE = 0.3  # m; a beam that hit an obstacle and then gets so far away from all has passed through it
SIGMA = 0.1  # m, of explained beams
STRAY = 0.05  # likelihood of a beam that the map does not explain, relative to a perfect one
FORBIDDEN = 0.01  # likewise of one that passed through an obstacle


@dataclass(frozen=True, slots=True)
class Agreement:
    """Shares of a scan's beams, which sum to 1, and what they amount to.

    Attributes:
        explained: Share that ends on the map's obstacles.
        blocked: Share that ends where the map is free, on something that is not on it.
        passed: Share that went through one of the map's obstacles.
        uncharted: Share that ends where the map knows nothing.
        log_likelihood: Mean over the beams of the logarithm of their likelihood, 0 for a perfect scan.
        beams: How many there were.
    """

    explained: float
    blocked: float
    passed: float
    uncharted: float
    log_likelihood: float
    beams: int


def compare(field: DistanceField, charted: NDArray[np.bool_], ends: Floats, lidar: Pose, pose: Pose) -> Agreement:
    """Compare a scan with the map.

    Args:
        field: Distances to the map's obstacles.
        charted: [H, W] which of its cells are known to be free or occupied.
        ends: [B, 2] m, where the beams ended, base_link frame.
        lidar: The lidar's pose, base_link frame.
        pose: base_link in the map frame.
    """
    if not len(ends):
        return Agreement(0.0, 0.0, 0.0, 0.0, 0.0, 0)
    placed = field.origin.inverse @ pose
    start = (placed @ lidar).as_array()[:2]
    counts, total = _compare(field.distance, charted, field.resolution, start, placed.transform(ends))
    explained, blocked, passed, uncharted = (counts / len(ends)).tolist()
    return Agreement(explained, blocked, passed, uncharted, total / len(ends), len(ends))


def mean_agreement(scans: Sequence[Agreement]) -> Agreement:
    """The agreement of several scans with the map, each weighing the same; there must be one."""
    return Agreement(
        explained=fmean(a.explained for a in scans),
        blocked=fmean(a.blocked for a in scans),
        passed=fmean(a.passed for a in scans),
        uncharted=fmean(a.uncharted for a in scans),
        log_likelihood=fmean(a.log_likelihood for a in scans),
        beams=sum(a.beams for a in scans),
    )


@kernel
def _compare(
    distance: NDArray[np.float32], charted: NDArray[np.bool_], resolution: float, start: Floats, ends: Floats
) -> tuple[NDArray[np.int64], float]:
    """[4] how many beams are explained, blocked, passed and uncharted, and the sum of the log likelihoods.

    Args:
        distance: [H, W] m.
        charted: [H, W].
        resolution: m.
        start: [2] m, the lidar in the grid's frame.
        ends: [B, 2] m, likewise.
    """
    height, width = distance.shape
    counts = np.zeros(4, np.int64)
    total = 0.0
    for b in range(len(ends)):
        dx, dy = ends[b, 0] - start[0], ends[b, 1] - start[1]
        length = max(math.hypot(dx, dy), 1e-9)
        column, row = ends[b, 0] / resolution, ends[b, 1] / resolution
        gap, known = np.inf, False
        if 0.0 <= column < width and 0.0 <= row < height:
            gap, known = distance[int(row), int(column)], charted[int(row), int(column)]
        likelihood = math.exp(-0.5 * gap * gap / (SIGMA * SIGMA)) + STRAY
        if _passes_through(distance, resolution, start, dx / length, dy / length, length):
            counts[2] += 1
            likelihood = FORBIDDEN
        elif gap <= TOLERANCE:
            counts[0] += 1
        elif known:
            counts[1] += 1
        else:
            counts[3] += 1
        total += math.log(likelihood / (1.0 + STRAY))
    return counts, total


@kernel
def _passes_through(
    distance: NDArray[np.float32], resolution: float, start: Floats, cos: float, sin: float, length: float
) -> bool:
    """Whether a beam of this length goes through an obstacle and comes out behind it.

    A beam that meets a wall at a small angle runs inside it for a while, which is no contradiction.
    """
    height, width = distance.shape
    x, y = start[0] / resolution, start[1] / resolution
    travelled = trace_ray(distance, resolution, x, y, cos, sin, length)
    while travelled < length:
        column, row = x + cos * travelled / resolution, y + sin * travelled / resolution
        if not (0.0 <= column < width and 0.0 <= row < height):
            return True
        gap = distance[int(row), int(column)]
        if gap > CLEARANCE:
            return True
        travelled += max(resolution, CLEARANCE - gap)
    return False
