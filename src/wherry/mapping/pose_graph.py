"""Optimization of pose graphs: the poses that agree best with the constraints between them (Grisetti et al. 2010).

Sparse Gauss–Newton with Levenberg–Marquardt damping, and a robust loss on the constraints that may be outliers.
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

MAX_ITERATIONS = 20  # Gauss–Newton steps at each scale of the robust loss
CONVERGENCE_TOLERANCE = 1e-4  # m and rad, largest change of a pose below which the iteration ends
MIN_RELATIVE_GAIN = 1e-4  # relative decrease of the cost below which the iteration ends
ROBUST_SCALE = 2.0  # standard deviations; an error of this size has half the weight under Cauchy's loss
MAX_INITIAL_ERROR = 4.0  # multiple of `ROBUST_SCALE`; with larger initial errors the loss begins with a wider scale
SCALE_REDUCTION = 4.0  # factor by which the scale of the loss is reduced from stage to stage
INITIAL_DAMPING = 1e-6  # share of the Hessian's diagonal that is added to it in the first step
MAX_DAMPING = 1e6  # share of the diagonal above which no step decreases the cost, and the iteration ends


@dataclass(frozen=True)
class PoseGraph:
    """Poses and the constraints between them.

    Attributes:
        poses: Poses of the nodes, [N, 3] m, m, rad; the first one is fixed.
        ends: The two nodes i and j of each constraint, [C, 2].
        measured: Pose of j in the frame of i, [C, 3] m, m, rad.
        information: Inverse covariance of ``measured`` in the frame of j, [C, 3, 3] m, m, rad.
        robust: Which constraints have a robust loss, since they may be outliers, [C].
    """

    poses: Floats
    ends: NDArray[np.int64]
    measured: Floats
    information: Floats
    robust: NDArray[np.bool_]


def optimized(graph: PoseGraph) -> PoseGraph:
    """The graph with the poses of least cost.

    Where a robust constraint has a large error at first, the scale of the loss is reduced stage by stage (graduated
    non-convexity, Yang et al. 2020). With the final scale at once, a true loop closure after a long drift would be
    treated as an outlier.

    Args:
        graph: A pose graph whose poses are the initial estimate.
    """
    if len(graph.ends) == 0 or len(graph.poses) < 2:
        return graph
    poses = graph.poses
    scale = float(constraint_errors(graph)[graph.robust].max(initial=0.0))
    while scale > MAX_INITIAL_ERROR * ROBUST_SCALE:
        poses = _minimized(graph, poses, scale)
        scale /= SCALE_REDUCTION
    poses = _minimized(graph, poses, ROBUST_SCALE).copy()
    poses[:, 2] -= math.tau * np.round(poses[:, 2] / math.tau)
    return replace(graph, poses=poses)


def constraint_errors(graph: PoseGraph) -> Floats:
    """Mahalanobis norms of the constraints' errors, [C] standard deviations."""
    return _errors(graph.poses, graph.ends, graph.measured, graph.information)


def _minimized(graph: PoseGraph, poses: Floats, scale: float) -> Floats:
    """Poses [N, 3] of least cost near the given ones, with a robust loss of one scale."""
    damping = INITIAL_DAMPING
    values, rows, columns, gradient, cost = _linearized(graph, poses, scale)
    for _ in range(MAX_ITERATIONS):
        # The first pose is fixed, so the system has neither rows nor columns for it.
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
            is_converged = cost - linearized[4] < MIN_RELATIVE_GAIN * cost or np.abs(step).max() < CONVERGENCE_TOLERANCE
            poses, damping = moved, damping / 10.0
            values, rows, columns, gradient, cost = linearized
            if is_converged:
                break
        else:
            damping *= 100.0
            if damping > MAX_DAMPING:
                break
    return poses


def _linearized(
    graph: PoseGraph, poses: Floats, scale: float
) -> tuple[Floats, NDArray[np.int64], NDArray[np.int64], Floats, float]:
    """Values, rows and columns of the sparse Hessian, the gradient, and the cost at the poses [N, 3]."""
    return _linearize(poses, graph.ends, graph.measured, graph.information, graph.robust, scale)


@kernel
def _errors(poses: Floats, ends: NDArray[np.int64], measured: Floats, information: Floats) -> Floats:
    """As `constraint_errors`."""
    errors = np.empty(len(ends))
    for c in range(len(ends)):
        error = _error(poses[ends[c, 0]], poses[ends[c, 1]], measured[c])
        errors[c] = math.sqrt(error @ information[c] @ error)
    return errors


@kernel
def _error(first: Floats, second: Floats, measured: Floats) -> Floats:
    """Error z⁻¹ (xᵢ⁻¹ xⱼ) of a constraint with poses xᵢ, xⱼ [3] and measurement z [3], [3] m, m, rad."""
    cos, sin = math.cos(first[2]), math.sin(first[2])
    dx, dy = second[0] - first[0], second[1] - first[1]
    off_x, off_y = cos * dx + sin * dy - measured[0], -sin * dx + cos * dy - measured[1]
    cos, sin = math.cos(measured[2]), math.sin(measured[2])
    turn = second[2] - first[2] - measured[2]
    turn -= math.tau * np.round(turn / math.tau)
    return np.array([cos * off_x + sin * off_y, -sin * off_x + cos * off_y, turn])


@kernel
def _jacobian(first: Floats, second: Floats, measured: Floats) -> Floats:
    """Jacobian of `_error` by the first and the second pose, [3, 6]."""
    angle = first[2] + measured[2]
    cos, sin = math.cos(angle), math.sin(angle)
    dx, dy = second[0] - first[0], second[1] - first[1]
    jacobian = np.zeros((3, 6))
    jacobian[0, 0], jacobian[0, 1], jacobian[0, 2] = -cos, -sin, -sin * dx + cos * dy
    jacobian[1, 0], jacobian[1, 1], jacobian[1, 2] = sin, -cos, -cos * dx - sin * dy
    jacobian[2, 2] = -1.0
    jacobian[0, 3], jacobian[0, 4], jacobian[1, 3], jacobian[1, 4] = cos, sin, -sin, cos
    jacobian[2, 5] = 1.0
    return jacobian


@kernel
def _linearize(
    poses: Floats,
    ends: NDArray[np.int64],
    measured: Floats,
    information: Floats,
    robust: NDArray[np.bool_],
    scale: float,
) -> tuple[Floats, NDArray[np.int64], NDArray[np.int64], Floats, float]:
    """As `_linearized`; the unknowns are all poses except the first."""
    count = len(ends)
    values = np.zeros(count * 36)
    rows, columns = np.zeros(count * 36, np.int64), np.zeros(count * 36, np.int64)
    gradient = np.zeros(3 * len(poses) - 3)
    cost, entry = 0.0, 0
    for c in range(count):
        i, j = ends[c, 0], ends[c, 1]
        error = _error(poses[i], poses[j], measured[c])
        squared = error @ information[c] @ error
        weight = 1.0
        if robust[c]:
            weight = 1.0 / (1.0 + squared / (scale * scale))
            cost += scale * scale * math.log1p(squared / (scale * scale))
        else:
            cost += squared
        jacobian = _jacobian(poses[i], poses[j], measured[c])
        weighted = weight * (jacobian.T @ information[c])
        block, block_gradient = weighted @ jacobian, weighted @ error
        for a in range(6):
            row = 3 * (i - 1) + a if a < 3 else 3 * (j - 1) + a - 3
            if row < 0:
                continue
            gradient[row] += block_gradient[a]
            for b in range(6):
                column = 3 * (i - 1) + b if b < 3 else 3 * (j - 1) + b - 3
                if column >= 0:
                    values[entry], rows[entry], columns[entry] = block[a, b], row, column
                    entry += 1
    return values[:entry], rows[:entry], columns[:entry], gradient, cost
