"""Pose graphs: poses that agree best with what was measured between them (Grisetti et al. 2010).

Gauss–Newton on a sparse system, damped when a step would make things worse (Levenberg–Marquardt), with a robust loss on
the edges that might be wrong.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, diags_array
from scipy.sparse.linalg import splu

from wherry.kernels import kernel
from wherry.space.pose import Floats

ITERATIONS = 20  # at most, at each width of the robust loss
CONVERGED = 1e-4  # m and rad, largest change of a pose
LEAST_GAIN = 1e-4  # relative change of the cost that still is one
ROBUST_SCALE = 2.0  # σ, an error that large counts half (Cauchy's loss)
FAR_OFF, NARROWING = 4.0, 4.0  # times that scale; by how much it is narrowed from step to step
FIRST_DAMPING = 1e-6


@dataclass(frozen=True)
class PoseGraph:
    """Poses and what was measured between them.

    Attributes:
        poses: [N, 3] x m, y m, θ rad; the first one is held.
        ends: [E, 2] the two nodes of each edge, i and j.
        measured: [E, 3] pose of j in the frame of i: m, m, rad.
        information: [E, 3, 3] inverse covariance of the error, in the frame of j.
        robust: [E] whether the edge might be wrong.
    """

    poses: Floats
    ends: NDArray[np.int64]
    measured: Floats
    information: Floats
    robust: NDArray[np.bool_]


def optimized(graph: PoseGraph) -> PoseGraph:
    """The same graph with the poses of least cost.

    Where an edge that might be wrong is far off at first, the robust loss is narrowed step by step (graduated
    non-convexity, as in Yang et al. 2020): each such edge is believed first, and then only if the others bear it out.
    With the narrow loss at once, a true closure after a long drift would never be listened to.

    Args:
        graph: Its poses are the starting point.
    """
    if len(graph.ends) == 0 or len(graph.poses) < 2:
        return graph
    poses = graph.poses
    width = float(edge_errors(graph)[graph.robust].max(initial=0.0))
    while width > FAR_OFF * ROBUST_SCALE:
        poses = _solved(graph, poses, width)
        width /= NARROWING
    poses = _solved(graph, poses, ROBUST_SCALE).copy()
    poses[:, 2] -= math.tau * np.round(poses[:, 2] / math.tau)
    return replace(graph, poses=poses)


def _solved(graph: PoseGraph, poses: Floats, scale: float) -> Floats:
    """[N, 3] the poses of least cost near given ones, with a robust loss of one width, σ."""
    damping = FIRST_DAMPING
    values, rows, columns, gradient, cost = _linearized(graph, poses, scale)
    for _ in range(ITERATIONS):
        # The first pose is held: its rows and columns are left out.
        size = 3 * len(poses) - 3
        hessian = coo_array((values, (rows, columns)), shape=(size, size)).tocsc()
        diagonal = diags_array(damping * hessian.diagonal() + 1e-9).tocsc()
        factor = splu(
            hessian + diagonal, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
        step = np.vstack([np.zeros((1, 3)), factor.solve(-gradient).reshape(-1, 3)])
        moved = poses + step
        linearized = _linearized(graph, moved, scale)
        if linearized[4] <= cost:
            done = cost - linearized[4] < LEAST_GAIN * cost or np.abs(step).max() < CONVERGED
            poses, damping = moved, damping / 10.0
            values, rows, columns, gradient, cost = linearized
            if done:
                break
        else:
            damping *= 100.0
            if damping > 1e6:
                break
    return poses


def edge_errors(graph: PoseGraph) -> Floats:
    """[E] Mahalanobis lengths of the edges' errors, in σ."""
    return _errors(graph.poses, graph.ends, graph.measured, graph.information)


def _linearized(
    graph: PoseGraph, poses: Floats, scale: float
) -> tuple[Floats, NDArray[np.int64], NDArray[np.int64], Floats, float]:
    """The system's values with their rows and columns, its gradient, and the cost."""
    return _linearize(poses, graph.ends, graph.measured, graph.information, graph.robust, scale)


@kernel
def _errors(poses: Floats, ends: NDArray[np.int64], measured: Floats, information: Floats) -> Floats:
    """As `edge_errors`."""
    errors = np.empty(len(ends))
    for e in range(len(ends)):
        error = _error(poses[ends[e, 0]], poses[ends[e, 1]], measured[e])
        errors[e] = math.sqrt(error @ information[e] @ error)
    return errors


@kernel
def _error(first: Floats, second: Floats, measured: Floats) -> Floats:
    """[3] z⁻¹ (x_i⁻¹ x_j)."""
    cos, sin = math.cos(first[2]), math.sin(first[2])
    dx, dy = second[0] - first[0], second[1] - first[1]
    off_x, off_y = cos * dx + sin * dy - measured[0], -sin * dx + cos * dy - measured[1]
    cos, sin = math.cos(measured[2]), math.sin(measured[2])
    turn = second[2] - first[2] - measured[2]
    turn -= math.tau * np.round(turn / math.tau)
    return np.array([cos * off_x + sin * off_y, -sin * off_x + cos * off_y, turn])


@kernel
def _linearize(
    poses: Floats,
    ends: NDArray[np.int64],
    measured: Floats,
    information: Floats,
    robust: NDArray[np.bool_],
    scale: float,
) -> tuple[Floats, NDArray[np.int64], NDArray[np.int64], Floats, float]:
    """Gauss–Newton's system at the poses, without the first one; as `_linearized`."""
    count = len(ends)
    values = np.zeros(count * 36)
    rows, columns = np.zeros(count * 36, np.int64), np.zeros(count * 36, np.int64)
    gradient = np.zeros(3 * len(poses) - 3)
    cost, entry = 0.0, 0
    for e in range(count):
        i, j = ends[e, 0], ends[e, 1]
        error = _error(poses[i], poses[j], measured[e])
        squared = error @ information[e] @ error
        weight = 1.0
        if robust[e]:
            weight = 1.0 / (1.0 + squared / (scale * scale))
            cost += scale * scale * math.log1p(squared / (scale * scale))
        else:
            cost += squared
        # Derivatives by x_i and x_j; R is the rotation from the world to the frame that was measured.
        angle = poses[i, 2] + measured[e, 2]
        cos, sin = math.cos(angle), math.sin(angle)
        dx, dy = poses[j, 0] - poses[i, 0], poses[j, 1] - poses[i, 1]
        jacobian = np.zeros((3, 6))
        jacobian[0, 0], jacobian[0, 1], jacobian[0, 2] = -cos, -sin, -sin * dx + cos * dy
        jacobian[1, 0], jacobian[1, 1], jacobian[1, 2] = sin, -cos, -cos * dx - sin * dy
        jacobian[2, 2] = -1.0
        jacobian[0, 3], jacobian[0, 4], jacobian[1, 3], jacobian[1, 4] = cos, sin, -sin, cos
        jacobian[2, 5] = 1.0
        weighed = weight * (jacobian.T @ information[e])
        block, push = weighed @ jacobian, weighed @ error
        for a in range(6):
            row = 3 * (i - 1) + a if a < 3 else 3 * (j - 1) + a - 3
            if row < 0:
                continue
            gradient[row] += push[a]
            for b in range(6):
                column = 3 * (i - 1) + b if b < 3 else 3 * (j - 1) + b - 3
                if column >= 0:
                    values[entry], rows[entry], columns[entry] = block[a, b], row, column
                    entry += 1
    return values[:entry], rows[:entry], columns[:entry], gradient, cost
