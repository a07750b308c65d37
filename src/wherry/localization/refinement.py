"""Matching of a whole scan to a finished map: Gauss–Newton on the distance field, with a Gaussian prior.

The precision of the particles' mean is limited by their number; an optimization over all beams that starts there is
precise to a centimetre. The particles are the prior, so that along a featureless corridor, where the scan determines
only the position across it, the result stays at their mean.

`wherry.mapping.refinement` takes the same steps, but measures distances to surfels, since a distance field would have
to be recomputed with every scan that is added to a growing map.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import kernel
from wherry.space.distance_field import DistanceField
from wherry.space.gauss_newton import gauss_newton_step
from wherry.space.pose import Floats, Pose, wrap

MAX_MATCHED_BEAMS = 360  # beams of a scan that are matched; more do not improve the match
MAX_ITERATIONS = 10  # Gauss–Newton steps
CONVERGENCE_TOLERANCE = 1e-4  # m and rad, step below which the iteration ends
OUTLIER_DENSITY = 0.05  # density of outliers relative to that of a perfect hit, the scale of the robust weights
PRIOR_MARGIN = np.diag([0.01**2, 0.01**2, 0.005**2])  # m², m², rad², added to the prior's covariance
GATE = 11.34  # squared Mahalanobis distance, 99 % of χ² with three degrees of freedom
NO_DAMPING = 0.0  # Levenberg–Marquardt damping factor of a plain Gauss–Newton step


@dataclass(frozen=True, slots=True)
class ScanMatch:
    """A scan matched to the map.

    Attributes:
        pose: Pose of base_link, map frame; the prior's mean if the match is not accepted.
        covariance: [3, 3] m, m, rad, posterior covariance of the pose; the prior's if the match is not accepted.
        inlier_fraction: Fraction of the beams that end on the map's obstacles, 0 to 1.
        is_accepted: Whether the match is within the gate around the prior.
    """

    pose: Pose
    covariance: Floats
    inlier_fraction: float
    is_accepted: bool


def match_scan(
    field: DistanceField, ends: Floats, prior: Pose, covariance: Floats, sigma: float, *, start: Pose | None = None
) -> ScanMatch:
    """Find the pose at which the beams end on the map's obstacles.

    Minimizes Σ w d(pose ⊕ end)² / σ² + ‖pose − prior‖²_covariance with robust weights w.

    Args:
        field: Distances to the map's obstacles.
        ends: [B, 2] m, ends of the beams, base_link frame.
        prior: Mean of the prior, pose of base_link in the map frame.
        covariance: [3, 3] m, m, rad, covariance of the prior.
        sigma: Standard deviation σ of the distances of beams from obstacles, m.
        start: Pose from which the optimization starts, map frame; None for the prior's mean.
    """
    widened = covariance + PRIOR_MARGIN
    rotation = np.array([*_rotation_rows(-field.origin.theta), (0.0, 0.0, 1.0)])
    mean = field.origin.inverse @ prior
    begin = mean if start is None else field.origin.inverse @ start
    information = np.linalg.inv(rotation @ widened @ rotation.T)
    found, hessian, inlier_fraction = _gauss_newton(
        field.distance, field.resolution, ends, begin.as_array(), mean.as_array(), information, sigma
    )
    pose = field.origin @ Pose.from_array(found)
    if not is_within_gate(pose, prior, covariance):
        return ScanMatch(prior, widened, inlier_fraction, is_accepted=False)
    return ScanMatch(pose, rotation.T @ np.linalg.inv(hessian) @ rotation, inlier_fraction, is_accepted=True)


def is_within_gate(pose: Pose, mean: Pose, covariance: Floats) -> bool:
    """Whether a pose is within the 99 % gate of a Gaussian with this mean and covariance [3, 3] m, m, rad."""
    offset = np.array([pose.x - mean.x, pose.y - mean.y, wrap(pose.theta - mean.theta)])
    widened = covariance + PRIOR_MARGIN
    return bool(offset @ np.linalg.solve(widened, offset) < GATE)


def _rotation_rows(angle: float) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """The first two rows of the rotation about the vertical axis by an angle, rad."""
    cos, sin = math.cos(angle), math.sin(angle)
    return (cos, -sin, 0.0), (sin, cos, 0.0)


@kernel
def _gauss_newton(
    distance: NDArray[np.float32],
    resolution: float,
    ends: Floats,
    start: Floats,
    prior: Floats,
    prior_information: Floats,
    sigma: float,
) -> tuple[Floats, Floats, float]:
    """Minimize the cost of `match_scan` in the grid's frame; return pose [3], Hessian [3, 3] and inlier fraction."""
    pose = start.copy()
    information, gradient = np.zeros((3, 3)), np.zeros(3)
    inlier_fraction = 0.0
    for _ in range(MAX_ITERATIONS):
        inlier_fraction = _linearize(distance, resolution, ends, pose, sigma, information, gradient)
        step = gauss_newton_step(pose, gradient, information, prior, prior_information, NO_DAMPING)
        pose += step
        if np.abs(step).max() < CONVERGENCE_TOLERANCE:
            break
    return pose, information + prior_information, inlier_fraction


@kernel
def _linearize(
    distance: NDArray[np.float32],
    resolution: float,
    ends: Floats,
    pose: Floats,
    sigma: float,
    information: Floats,
    gradient: Floats,
) -> float:
    """Write Jᵀ W J [3, 3] and Jᵀ W r [3] at a pose [3] in the grid's frame; return the inlier fraction."""
    height, width = distance.shape
    precision, per_metre = 1.0 / (sigma * sigma), 1.0 / resolution
    inliers = 0.0
    gx, gy, gt, xx, xy, yy, xt, yt, tt = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    for b in range(len(ends)):
        turned_x = cos * ends[b, 0] - sin * ends[b, 1]
        turned_y = sin * ends[b, 0] + cos * ends[b, 1]
        x = (pose[0] + turned_x) * per_metre - 0.5  # distances hold at the centres of cells
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
        inlier = hit / (hit + OUTLIER_DENSITY)
        inliers += inlier
        weight = inlier * precision
        gx, gy, gt = gx + weight * d * slope_x, gy + weight * d * slope_y, gt + weight * d * slope_t
        xx, xy, yy = xx + weight * slope_x**2, xy + weight * slope_x * slope_y, yy + weight * slope_y**2
        xt, yt, tt = xt + weight * slope_x * slope_t, yt + weight * slope_y * slope_t, tt + weight * slope_t**2
    gradient[:] = np.array([gx, gy, gt])
    information[:] = np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]])
    return inliers / max(len(ends), 1)
