"""Exact scan matching: Gauss–Newton on the distances from points to surfaces (Chen & Medioni 1991).

A surface is the moving average of the surfels around a point (implicit moving least squares, as in Deschaud 2018):
noise cancels in it, where the nearest surfel alone would always lie conveniently near.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import kernel
from wherry.mapping.cloud import Cloud
from wherry.mapping.submap import RESOLUTION, SAME_SURFACE, Submap
from wherry.space.pose import Floats, Pose

POINT_NOISE = 0.03  # m, σ of a point's distance from the surface it belongs to
OUTLIER = 0.05  # m, a residual that large counts half (Cauchy's loss)
ITERATIONS = 12
CONVERGED = 1e-5  # m and rad
WIDTH = 0.15  # m; surfels so far around a point make up its surface, near ones more than far ones
SEARCH = math.ceil(WIDTH / RESOLUTION)  # cells
NO_PRIOR = np.zeros((3, 3))
# Along a bare corridor nothing holds a scan, but normals are off by some degrees, and so seem to. Below the first ratio
# of what holds it along to what holds it across, nothing is believed of it; above the second, all (Zhang et al. 2016).
BARE, HELD = 0.01, 0.04


@dataclass(frozen=True)
class Refinement:
    """A pose, and how well the points determine it.

    Attributes:
        pose: In the submap's frame.
        information: [3, 3] of x m, y m, θ rad in the submap's frame, from the points alone.
        matched: 0 to 1, share of the points with a normal that found their surface.
        residual: m, root mean square of the matched points' distances.
    """

    pose: Pose
    information: Floats
    matched: float
    residual: float


def refine(
    submap: Submap, cloud: Cloud, start: Pose, *, expected: Pose | None = None, prior: Floats = NO_PRIOR
) -> Refinement:
    """Move a cloud so that its points lie on the submap's surfaces.

    Args:
        submap: What to match to.
        cloud: In the frame of the pose that is sought.
        start: The pose to start from, in the submap's frame: within about `SEARCH` cells of the truth.
        expected: What else is believed about the pose, if anything.
        prior: [3, 3] the information of ``expected``.
    """
    wanted = (expected or start).as_array()
    pose, information, matched, residual = _refine(
        submap.surfel_at, submap.surfels, submap.corner, cloud.points, cloud.normals, start.as_array(), wanted, prior
    )
    return Refinement(Pose.from_array(pose), information, matched, residual)


@kernel
def _refine(
    surfel_at: NDArray[np.int32],
    surfels: Floats,
    corner: NDArray[np.int64],
    points: Floats,
    normals: Floats,
    pose: Floats,
    expected: Floats,
    prior: Floats,
) -> tuple[Floats, Floats, float, float]:
    """As `refine`; the submap's arrays, [N, 2] points and normals, [3] poses, [3, 3] prior."""
    pose = pose.copy()
    information = np.zeros((3, 3))
    matched, squared, surfaces = 0, 0.0, 0
    for _ in range(ITERATIONS):
        information[:] = 0.0
        gradient = np.zeros(3)
        matched, squared, surfaces = 0, 0.0, 0
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        for n in range(len(points)):
            if normals[n, 0] == 0.0 and normals[n, 1] == 0.0:
                continue
            surfaces += 1
            turned_x, turned_y = cos * points[n, 0] - sin * points[n, 1], sin * points[n, 0] + cos * points[n, 1]
            facing_x, facing_y = cos * normals[n, 0] - sin * normals[n, 1], sin * normals[n, 0] + cos * normals[n, 1]
            x, y = pose[0] + turned_x, pose[1] + turned_y
            found, residual, normal_x, normal_y = _surface(surfel_at, surfels, corner, x, y, facing_x, facing_y)
            if not found:
                continue
            matched += 1
            squared += residual * residual
            lever = normal_y * turned_x - normal_x * turned_y
            weight = 1.0 / ((1.0 + (residual / OUTLIER) ** 2) * POINT_NOISE * POINT_NOISE)
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
        _release(information, gradient)
        off = pose - expected
        off[2] -= math.tau * np.round(off[2] / math.tau)
        # The added 1s hold what neither the points nor the prior say anything about.
        step = np.linalg.solve(information + prior + np.eye(3), -(gradient + prior @ off))
        pose += step
        if abs(step[0]) < CONVERGED and abs(step[1]) < CONVERGED and abs(step[2]) < CONVERGED:
            break
    return pose, information, matched / max(surfaces, 1), math.sqrt(squared / max(matched, 1))


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
    """Whether there is a surface around a point that faces its way; how far before it the point lies, m; its normal."""
    column, row = math.floor(x / RESOLUTION) - corner[0], math.floor(y / RESOLUTION) - corner[1]
    total, along, normal_x, normal_y = 0.0, 0.0, 0.0, 0.0
    for i in range(max(row - SEARCH, 0), min(row + SEARCH + 1, surfel_at.shape[0])):
        for j in range(max(column - SEARCH, 0), min(column + SEARCH + 1, surfel_at.shape[1])):
            surfel = surfel_at[i, j]
            if surfel < 0:
                continue
            number, sum_x, sum_y = surfels[surfel, 4], surfels[surfel, 2], surfels[surfel, 3]
            gap_x, gap_y = x - surfels[surfel, 0] / number, y - surfels[surfel, 1] / number
            near = 1.0 - (gap_x * gap_x + gap_y * gap_y) / (WIDTH * WIDTH)
            length = math.sqrt(sum_x * sum_x + sum_y * sum_y)
            if near <= 0.0 or facing_x * sum_x + facing_y * sum_y < SAME_SURFACE * length:
                continue
            # Σ wᵢ nᵢ·(x − pᵢ) / Σ wᵢ is the distance from the surface that the surfels have in common.
            near *= near * number / length
            total += near * length
            along += near * (sum_x * gap_x + sum_y * gap_y)
            normal_x += near * sum_x
            normal_y += near * sum_y
    if total == 0.0:
        return False, 0.0, 0.0, 0.0
    length = math.sqrt(normal_x * normal_x + normal_y * normal_y)
    return True, along / total, normal_x / length, normal_y / length


@kernel
def _release(information: Floats, gradient: Floats) -> None:
    """Take out of a system [3, 3], [3] what it falsely says about the direction in which positions are held least."""
    middle, half = (information[0, 0] + information[1, 1]) / 2.0, (information[0, 0] - information[1, 1]) / 2.0
    spread = math.sqrt(half * half + information[0, 1] * information[0, 1])
    if middle <= 0.0:
        return
    believed = ((middle - spread) / (middle + spread) - BARE) / (HELD - BARE)
    if believed >= 1.0:
        return
    kept = math.sqrt(max(believed, 0.0))
    angle = 0.5 * math.atan2(2.0 * information[0, 1], 2.0 * half) + math.pi / 2.0
    vx, vy = math.cos(angle), math.sin(angle)
    keep = np.eye(3)
    keep[0, 0] -= (1.0 - kept) * vx * vx
    keep[0, 1] -= (1.0 - kept) * vx * vy
    keep[1, 0] = keep[0, 1]
    keep[1, 1] -= (1.0 - kept) * vy * vy
    information[:] = keep @ information @ keep
    gradient[:] = keep @ gradient
