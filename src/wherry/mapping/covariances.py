"""Covariances of poses: change of frame, and propagation along a pose graph (Olson 2008, 2009)."""

from __future__ import annotations

import heapq
import math

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import kernel
from wherry.space.pose import Floats, Pose


def relative_covariances(
    source: int, count: int, ends: NDArray[np.int64], measured: Floats, covariances: Floats
) -> Floats:
    """Covariances of all nodes relative to one, along each node's path of least uncertainty (Dijkstra 1959).

    A single path overestimates the covariance that all paths together give, which is conservative.

    Args:
        source: Index of the node that the others are relative to.
        count: Number of nodes N.
        ends: The two nodes of each constraint, [C, 2].
        measured: Poses of the second nodes in the frames of the first, [C, 3] m, m, rad.
        covariances: Covariances of ``measured`` in the frames of the second nodes, [C, 3, 3] m, m, rad.

    Returns:
        Covariances in the frame of each node, [N, 3, 3]; infinite for nodes that no path reaches.
    """
    heads = np.concatenate([ends[:, 0], ends[:, 1]])
    order = np.argsort(heads, kind="stable")
    begins = np.searchsorted(heads[order], np.arange(count + 1))
    return _shortest_paths(source, count, ends, measured, covariances, order, begins)


def transform_covariance(covariance: Floats, pose: Pose) -> Floats:
    """Change of frame, Ad Σ Adᵀ.

    Args:
        covariance: Covariance in the frame that has ``pose``, [3, 3] m, m, rad.
        pose: Pose of that frame.

    Returns:
        The covariance in the frame that ``pose`` is given in, [3, 3].
    """
    adjoint = _adjoint(pose.x, pose.y, pose.theta)
    return adjoint @ covariance @ adjoint.T


def transform_covariances(covariances: Floats, poses: Floats) -> Floats:
    """`transform_covariance` of covariances [N, 3, 3] with poses [N, 3] m, m, rad."""
    adjoints = np.zeros((len(poses), 3, 3))
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    adjoints[:, 0, 0], adjoints[:, 0, 1], adjoints[:, 0, 2] = cos, -sin, poses[:, 1]
    adjoints[:, 1, 0], adjoints[:, 1, 1], adjoints[:, 1, 2] = sin, cos, -poses[:, 0]
    adjoints[:, 2, 2] = 1.0
    transformed: Floats = adjoints @ covariances @ adjoints.transpose(0, 2, 1)
    return transformed


def rotate_covariance(matrix: Floats, angle: float) -> Floats:
    """A covariance or information matrix [3, 3] whose axes are rotated by an angle, rad."""
    return transform_covariance(matrix, Pose(theta=angle))


def invert(matrices: Floats) -> Floats:
    """Inverses of covariance or information matrices, [3, 3] or [N, 3, 3]."""
    inverses: Floats = np.linalg.inv(matrices).astype(np.float64)
    return inverses


def regularized_inverse(information: Floats) -> Floats:
    """Covariance of an information matrix [3, 3] that may be singular: 1 m or 1 rad where it determines nothing."""
    return invert(information + np.eye(3))


@kernel
def _shortest_paths(
    source: int,
    count: int,
    ends: NDArray[np.int64],
    measured: Floats,
    covariances: Floats,
    order: NDArray[np.int64],
    begins: NDArray[np.int64],
) -> Floats:
    """As `relative_covariances`; node n has the constraints ``order[begins[n]:begins[n + 1]]``, reversed from C on."""
    known = np.full((count, 3, 3), np.inf)
    known[source] = 0.0
    cost = np.full(count, np.inf)
    cost[source] = 0.0
    expanded = np.zeros(count, np.bool_)
    queue = [(0.0, source)]
    while len(queue) > 0:
        _, node = heapq.heappop(queue)
        if expanded[node]:
            continue
        expanded[node] = True
        for at in range(begins[node], begins[node + 1]):
            edge = order[at]
            is_reversed = edge >= len(ends)
            edge = edge - len(ends) if is_reversed else edge
            other = ends[edge, 0] if is_reversed else ends[edge, 1]
            if expanded[other]:
                continue
            reached = _propagated(known[node], measured[edge], covariances[edge], is_reversed)
            trace = reached[0, 0] + reached[1, 1] + reached[2, 2]
            if trace < cost[other]:
                cost[other] = trace
                known[other] = reached
                heapq.heappush(queue, (trace, other))
    return known


@kernel
def _propagated(covariance: Floats, measured: Floats, added: Floats, is_reversed: bool) -> Floats:
    """Covariance at the end of a path that is extended by one constraint.

    Args:
        covariance: Covariance at the end of the path so far, in that node's frame, [3, 3].
        measured: Measured pose z of the constraint, [3] m, m, rad.
        added: Covariance Σ of ``measured`` in the frame of the constraint's second node, [3, 3].
        is_reversed: Whether the path runs from the constraint's second node to its first.

    Returns:
        Covariance in the frame of the node that is reached, [3, 3].
    """
    x, y, theta = measured[0], measured[1], measured[2]
    if is_reversed:
        # Inverse of z, and its covariance in the first node's frame: Ad(z) Σ Ad(z)ᵀ.
        adjoint = _adjoint(x, y, theta)
        added = adjoint @ added @ adjoint.T
        cos, sin = math.cos(theta), math.sin(theta)
        x, y, theta = -cos * x - sin * y, sin * x - cos * y, -theta
    cos, sin = math.cos(theta), math.sin(theta)
    inverse_adjoint = _adjoint(-cos * x - sin * y, sin * x - cos * y, -theta)
    return inverse_adjoint @ covariance @ inverse_adjoint.T + added


@kernel
def _adjoint(x: float, y: float, theta: float) -> Floats:
    """Adjoint of a pose, [3, 3]: maps a small motion in the posed frame to the frame that the pose is given in."""
    cos, sin = math.cos(theta), math.sin(theta)
    return np.array([[cos, -sin, y], [sin, cos, -x], [0.0, 0.0, 1.0]])
