"""Matching a whole scan to the map: the pose that explains it best, near a pose that is already about right.

The particles' mean is as precise as their number allows; one Gauss–Newton search from there, over all beams at once,
makes centimetres of it. What the particles believe enters as a Gaussian prior, so that along a featureless corridor,
where the scan says nothing, the answer stays where the filter put it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import kernel
from wherry.space.distance_field import DistanceField
from wherry.space.pose import Pose, wrap

Floats = NDArray[np.float64]

ITERATIONS = 10
SETTLED = 1e-4  # m and rad; a smaller step is the last
RANDOM_SHARE = 0.05  # density of readings that mean nothing, relative to a perfect hit's: the robust weights' scale
LEAST_DEVIATION = (0.01, 0.01, 0.005)  # m, m, rad: a prior is never taken for surer than this
GATE = 11.34  # χ² with three degrees of freedom, 99 %: a match farther from the prior is not believed


@dataclass(frozen=True, slots=True)
class Match:
    """A scan matched to the map.

    Attributes:
        pose: base_link in the map frame.
        covariance: [3, 3] m, m, rad, of the pose given scan and prior.
        explained: Share of the beams that end on the map's obstacles.
        accepted: Whether the match agrees with the prior; otherwise ``pose`` is the prior's.
    """

    pose: Pose
    covariance: Floats
    explained: float
    accepted: bool


def match_scan(
    field: DistanceField, ends: Floats, prior: Pose, covariance: Floats, sigma: float, *, start: Pose | None = None
) -> Match:
    """Find the pose from which the beams end on the map's obstacles.

    Minimizes Σ d(pose ⊕ end)² / σ² + ‖pose − prior‖²_covariance, where a beam counts the less the farther from all
    obstacles it ends.

    Args:
        field: Distances to the map's obstacles.
        ends: [B, 2] m, beam ends in the base_link frame.
        prior: base_link in the map frame.
        covariance: [3, 3] m, m, rad, of the prior.
        sigma: σ, m, of the readings around the obstacles.
        start: Where the search begins; by default at the prior.
    """
    widened = covariance + np.diag(np.square(LEAST_DEVIATION))
    rotation = np.array([*_rotation_rows(-field.origin.theta), (0.0, 0.0, 1.0)])
    centre = field.origin.inverse @ prior
    begin = centre if start is None else field.origin.inverse @ start
    information = np.linalg.inv(rotation @ widened @ rotation.T)
    found, hessian, explained = _gauss_newton(
        field.distance, field.resolution, ends, begin.as_array(), centre.as_array(), information, sigma
    )
    pose = field.origin @ Pose.from_array(found)
    if not agrees(pose, prior, covariance):
        return Match(prior, widened, explained, accepted=False)
    return Match(pose, rotation.T @ np.linalg.inv(hessian) @ rotation, explained, accepted=True)


def agrees(pose: Pose, mean: Pose, covariance: Floats) -> bool:
    """Whether a pose is no outlier (99 %) of a Gaussian belief with [3, 3] covariance m, m, rad."""
    offset = np.array([pose.x - mean.x, pose.y - mean.y, wrap(pose.theta - mean.theta)])
    widened = covariance + np.diag(np.square(LEAST_DEVIATION))
    return bool(offset @ np.linalg.solve(widened, offset) < GATE)


def _rotation_rows(angle: float) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    cos, sin = math.cos(angle), math.sin(angle)
    return (cos, -sin, 0.0), (sin, cos, 0.0)


@kernel
def _gauss_newton(
    distance: NDArray[np.float32],
    resolution: float,
    ends: Floats,
    start: Floats,
    prior: Floats,
    information: Floats,
    sigma: float,
) -> tuple[Floats, Floats, float]:
    """[3] the pose in the grid's frame, [3, 3] the Hessian there, the share of the beams explained."""
    height, width = distance.shape
    precision, per_metre = 1.0 / (sigma * sigma), 1.0 / resolution
    pose = start.copy()
    hessian = information.copy()
    offset = np.empty(3)
    gradient = np.empty(3)
    explained = 0.0
    for _ in range(ITERATIONS):
        offset[:] = pose - prior
        offset[2] -= math.tau * math.floor((offset[2] + math.pi) / math.tau)
        explained = 0.0
        gx, gy, gt, xx, xy, yy, xt, yt, tt = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        for b in range(len(ends)):
            turned_x = cos * ends[b, 0] - sin * ends[b, 1]
            turned_y = sin * ends[b, 0] + cos * ends[b, 1]
            x = (pose[0] + turned_x) * per_metre - 0.5  # between the centres of cells
            y = (pose[1] + turned_y) * per_metre - 0.5
            if not (0.0 <= x < width - 1 and 0.0 <= y < height - 1):
                continue
            column, row = int(x), int(y)
            fx, fy = x - column, y - row
            d00, d01 = distance[row, column], distance[row, column + 1]
            d10, d11 = distance[row + 1, column], distance[row + 1, column + 1]
            d = (1.0 - fy) * ((1.0 - fx) * d00 + fx * d01) + fy * ((1.0 - fx) * d10 + fx * d11)
            slope_x = ((1.0 - fy) * (d01 - d00) + fy * (d11 - d10)) * per_metre
            slope_y = ((1.0 - fx) * (d10 - d00) + fx * (d11 - d01)) * per_metre
            slope_t = slope_y * turned_x - slope_x * turned_y
            hit = math.exp(-0.5 * precision * d * d)
            share = hit / (hit + RANDOM_SHARE)
            explained += share
            weight = share * precision
            gx, gy, gt = gx + weight * d * slope_x, gy + weight * d * slope_y, gt + weight * d * slope_t
            xx, xy, yy = xx + weight * slope_x**2, xy + weight * slope_x * slope_y, yy + weight * slope_y**2
            xt, yt, tt = xt + weight * slope_x * slope_t, yt + weight * slope_y * slope_t, tt + weight * slope_t**2
        gradient[:] = information @ offset + np.array([gx, gy, gt])
        hessian[:] = information + np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]])
        step = np.linalg.solve(hessian, gradient)
        pose -= step
        if np.abs(step).max() < SETTLED:
            break
    return pose, hessian, explained / max(len(ends), 1)
