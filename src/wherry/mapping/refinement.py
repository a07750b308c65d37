"""Scan refinement: Gauss–Newton on the distances from points to surfaces (Chen & Medioni 1991).

A surface is the moving average of the surfels around a point (implicit moving least squares, as in Deschaud 2018),
which averages out the noise that the nearest surfel alone would follow.

`wherry.localization.refinement` takes the same steps, but its residuals come from the distance field of a finished map;
a grid that grows with every scan has none.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import kernel
from wherry.mapping.matching_grid import MIN_NORMAL_COSINE, RESOLUTION, MatchingGrid
from wherry.mapping.point_cloud import PointCloud
from wherry.space.gauss_newton import gauss_newton_step
from wherry.space.pose import Floats, Pose

POINT_SIGMA = 0.03  # m, standard deviation of a point's distance from its surface
CAUCHY_SCALE = 0.05  # m, residual whose weight is halved by the Cauchy loss
MAX_ITERATIONS = 12  # Gauss–Newton steps
CONVERGENCE_TOLERANCE = 1e-5  # m and rad, step below which the iteration ends
SURFACE_RADIUS = 0.15  # m, radius within which surfels make up the surface at a point; nearer ones weigh more
SURFACE_CELLS = math.ceil(SURFACE_RADIUS / RESOLUTION)  # cells to either side that are searched for surfels
DAMPING = 1.0  # 1/m² and 1/rad², keeps the system regular where points and prior leave the pose undetermined
NO_PRIOR = np.zeros((3, 3))
# In a bare corridor, errors of the normals give false information about the position along it (Zhang et al. 2016).
# Ratios of the least to the greatest information: below the first the least is discarded, above the second it is kept,
# in between it is scaled.
MIN_INFORMATION_RATIO, FULL_INFORMATION_RATIO = 0.01, 0.04


@dataclass(frozen=True)
class Refinement:
    """A refined pose with its information.

    Attributes:
        pose: Pose in the grid's frame.
        information: Information of the pose from the points alone, in the grid's frame, [3, 3] m, m, rad.
        overlap: Share of inliers, points on a surface of the grid, among the points with a normal, 0 to 1.
        residual: Root mean square distance of the inliers from their surfaces, m.
    """

    pose: Pose
    information: Floats
    overlap: float
    residual: float


def refine(
    grid: MatchingGrid,
    cloud: PointCloud,
    start: Pose,
    *,
    prior: Pose | None = None,
    prior_information: Floats = NO_PRIOR,
) -> Refinement:
    """Move a cloud so that its points lie on the grid's surfaces.

    Args:
        grid: The grid to match to.
        cloud: Points in the frame whose pose is sought.
        start: Initial pose in the grid's frame, within about `SURFACE_RADIUS` of the solution.
        prior: Mean of the prior; None for ``start``.
        prior_information: Information of the prior, [3, 3].
    """
    mean = (prior or start).as_array()
    pose, information, overlap, residual = _refine(
        grid.surfel_at,
        grid.surfels,
        grid.corner,
        cloud.points,
        cloud.normals,
        start.as_array(),
        mean,
        prior_information,
    )
    return Refinement(Pose.from_array(pose), information, overlap, residual)


@kernel
def _refine(
    surfel_at: NDArray[np.int32],
    surfels: Floats,
    corner: NDArray[np.int64],
    points: Floats,
    normals: Floats,
    start: Floats,
    prior: Floats,
    prior_information: Floats,
) -> tuple[Floats, Floats, float, float]:
    """As `refine`, with the grid's arrays, points and normals [N, 2], and poses [3]."""
    pose = start.copy()
    information, gradient = np.zeros((3, 3)), np.zeros(3)
    overlap, residual = 0.0, 0.0
    for _ in range(MAX_ITERATIONS):
        overlap, residual = _linearize(surfel_at, surfels, corner, points, normals, pose, information, gradient)
        _discard_false_information(information, gradient)
        step = gauss_newton_step(pose, gradient, information, prior, prior_information, DAMPING)
        pose += step
        if (
            abs(step[0]) < CONVERGENCE_TOLERANCE
            and abs(step[1]) < CONVERGENCE_TOLERANCE
            and abs(step[2]) < CONVERGENCE_TOLERANCE
        ):
            break
    return pose, information, overlap, residual


@kernel
def _linearize(
    surfel_at: NDArray[np.int32],
    surfels: Floats,
    corner: NDArray[np.int64],
    points: Floats,
    normals: Floats,
    pose: Floats,
    information: Floats,
    gradient: Floats,
) -> tuple[float, float]:
    """Write Jᵀ W J [3, 3] and Jᵀ W r [3] at a pose [3]; return the overlap and the root mean square residual, m."""
    information[:] = 0.0
    gradient[:] = 0.0
    matched, squared, with_normal = 0, 0.0, 0
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    for n in range(len(points)):
        if normals[n, 0] == 0.0 and normals[n, 1] == 0.0:
            continue
        with_normal += 1
        turned_x, turned_y = cos * points[n, 0] - sin * points[n, 1], sin * points[n, 0] + cos * points[n, 1]
        facing_x, facing_y = cos * normals[n, 0] - sin * normals[n, 1], sin * normals[n, 0] + cos * normals[n, 1]
        x, y = pose[0] + turned_x, pose[1] + turned_y
        found, residual, normal_x, normal_y = _surface(surfel_at, surfels, corner, x, y, facing_x, facing_y)
        if not found:
            continue
        matched += 1
        squared += residual * residual
        lever = normal_y * turned_x - normal_x * turned_y
        weight = 1.0 / ((1.0 + (residual / CAUCHY_SCALE) ** 2) * POINT_SIGMA * POINT_SIGMA)
        information[0, 0] += weight * normal_x * normal_x
        information[0, 1] += weight * normal_x * normal_y
        information[0, 2] += weight * normal_x * lever
        information[1, 1] += weight * normal_y * normal_y
        information[1, 2] += weight * normal_y * lever
        information[2, 2] += weight * lever * lever
        gradient[0] += weight * normal_x * residual
        gradient[1] += weight * normal_y * residual
        gradient[2] += weight * lever * residual
    information[1, 0], information[2, 0], information[2, 1] = (
        information[0, 1],
        information[0, 2],
        information[1, 2],
    )
    return matched / max(with_normal, 1), math.sqrt(squared / max(matched, 1))


@kernel
def _surface(
    surfel_at: NDArray[np.int32],
    surfels: Floats,
    corner: NDArray[np.int64],
    x: float,
    y: float,
    facing_x: float,
    facing_y: float,
) -> tuple[bool, float, float, float]:
    """Find the surface at a point (m) whose normal points roughly along (facing_x, facing_y).

    Returns:
        Whether there is one, the point's signed distance from it, m, and its unit normal.
    """
    column, row = math.floor(x / RESOLUTION) - corner[0], math.floor(y / RESOLUTION) - corner[1]
    total, along, normal_x, normal_y = 0.0, 0.0, 0.0, 0.0
    for i in range(max(row - SURFACE_CELLS, 0), min(row + SURFACE_CELLS + 1, surfel_at.shape[0])):
        for j in range(max(column - SURFACE_CELLS, 0), min(column + SURFACE_CELLS + 1, surfel_at.shape[1])):
            surfel = surfel_at[i, j]
            if surfel < 0:
                continue
            count, sum_x, sum_y = surfels[surfel, 4], surfels[surfel, 2], surfels[surfel, 3]
            gap_x, gap_y = x - surfels[surfel, 0] / count, y - surfels[surfel, 1] / count
            weight = 1.0 - (gap_x * gap_x + gap_y * gap_y) / (SURFACE_RADIUS * SURFACE_RADIUS)
            length = math.sqrt(sum_x * sum_x + sum_y * sum_y)
            if weight <= 0.0 or facing_x * sum_x + facing_y * sum_y < MIN_NORMAL_COSINE * length:
                continue
            # The distance is Σ wᵢ nᵢ·(x − pᵢ) / Σ wᵢ.
            weight *= weight * count / length
            total += weight * length
            along += weight * (sum_x * gap_x + sum_y * gap_y)
            normal_x += weight * sum_x
            normal_y += weight * sum_y
    if total == 0.0:
        return False, 0.0, 0.0, 0.0
    length = math.sqrt(normal_x * normal_x + normal_y * normal_y)
    return True, along / total, normal_x / length, normal_y / length


@kernel
def _discard_false_information(information: Floats, gradient: Floats) -> None:
    """Scale down information [3, 3] and gradient [3] in the direction in which the position is determined least."""
    mean, half = (information[0, 0] + information[1, 1]) / 2.0, (information[0, 0] - information[1, 1]) / 2.0
    spread = math.sqrt(half * half + information[0, 1] * information[0, 1])
    if mean <= 0.0:
        return
    ratio = (mean - spread) / (mean + spread)
    kept_share = (ratio - MIN_INFORMATION_RATIO) / (FULL_INFORMATION_RATIO - MIN_INFORMATION_RATIO)
    if kept_share >= 1.0:
        return
    scale = math.sqrt(max(kept_share, 0.0))
    angle = 0.5 * math.atan2(2.0 * information[0, 1], 2.0 * half) + math.pi / 2.0
    vx, vy = math.cos(angle), math.sin(angle)
    projection = np.eye(3)
    projection[0, 0] -= (1.0 - scale) * vx * vx
    projection[0, 1] -= (1.0 - scale) * vx * vy
    projection[1, 0] = projection[0, 1]
    projection[1, 1] -= (1.0 - scale) * vy * vy
    information[:] = projection @ information @ projection
    gradient[:] = projection @ gradient
