"""How well poses of a graph are known relative to each other: covariances along the surest way (Olson 2008, 2009)."""

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
    """Covariances of all nodes' poses relative to one, along each one's way of least uncertainty (Dijkstra 1959).

    Following only one way overestimates what several ways together would tell, which is the safe side.

    Args:
        source: The node that the others are seen from.
        count: N, the number of nodes.
        ends: [E, 2] the nodes of each edge.
        measured: [E, 3] m, m, rad: pose of the second in the frame of the first.
        covariances: [E, 3, 3] of that, in the frame of the second.

    Returns:
        [N, 3, 3] in the frame of each node; infinite where no way leads.
    """
    heads = np.concatenate([ends[:, 0], ends[:, 1]])
    order = np.argsort(heads, kind="stable")
    begins = np.searchsorted(heads[order], np.arange(count + 1))
    return _spread(source, count, ends, measured, covariances, order, begins)


def carried(covariance: Floats, pose: Pose) -> Floats:
    """A covariance [3, 3] in the frame that has a pose, as the frame that the pose is given in shows it: Ad Σ Adᵀ."""
    adjoint = _adjoint(pose.x, pose.y, pose.theta)
    return adjoint @ covariance @ adjoint.T


def carried_each(covariances: Floats, poses: Floats) -> Floats:
    """`carried` of many: covariances [N, 3, 3], poses [N, 3] m, m, rad."""
    adjoints = np.zeros((len(poses), 3, 3))
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    adjoints[:, 0, 0], adjoints[:, 0, 1], adjoints[:, 0, 2] = cos, -sin, poses[:, 1]
    adjoints[:, 1, 0], adjoints[:, 1, 1], adjoints[:, 1, 2] = sin, cos, -poses[:, 0]
    adjoints[:, 2, 2] = 1.0
    seen: Floats = adjoints @ covariances @ adjoints.transpose(0, 2, 1)
    return seen


def inverse(matrix: Floats) -> Floats:
    """The inverse of a covariance or an information [3, 3], or of many, [N, 3, 3]."""
    inverted: Floats = np.linalg.inv(matrix).astype(np.float64)
    return inverted


def turned(matrix: Floats, angle: float) -> Floats:
    """A covariance or information [3, 3] with its axes turned: as seen in axes that are turned back by ``angle``."""
    return carried(matrix, Pose(theta=angle))


@kernel
def _spread(
    source: int,
    count: int,
    ends: NDArray[np.int64],
    measured: Floats,
    covariances: Floats,
    order: NDArray[np.int64],
    begins: NDArray[np.int64],
) -> Floats:
    """As `relative_covariances`; edges out of node n are ``order[begins[n]:begins[n + 1]]``, from E on backwards."""
    known = np.full((count, 3, 3), np.inf)
    known[source] = 0.0
    size = np.full(count, np.inf)
    size[source] = 0.0
    done = np.zeros(count, np.bool_)
    queue = [(0.0, source)]
    while len(queue) > 0:
        _, node = heapq.heappop(queue)
        if done[node]:
            continue
        done[node] = True
        for at in range(begins[node], begins[node + 1]):
            edge = order[at]
            backwards = edge >= len(ends)
            edge = edge - len(ends) if backwards else edge
            other = ends[edge, 0] if backwards else ends[edge, 1]
            if done[other]:
                continue
            x, y, theta = measured[edge, 0], measured[edge, 1], measured[edge, 2]
            added = covariances[edge]
            if backwards:
                # The inverse transform, and the error as the first node's frame shows it: Ad(z) Σ Ad(z)ᵀ.
                turned = _adjoint(x, y, theta)
                added = turned @ added @ turned.T
                cos, sin = math.cos(theta), math.sin(theta)
                x, y, theta = -cos * x - sin * y, sin * x - cos * y, -theta
            cos, sin = math.cos(theta), math.sin(theta)
            carry = _adjoint(-cos * x - sin * y, sin * x - cos * y, -theta)
            reached = carry @ known[node] @ carry.T + added
            extent = reached[0, 0] + reached[1, 1] + reached[2, 2]
            if extent < size[other]:
                size[other] = extent
                known[other] = reached
                heapq.heappush(queue, (extent, other))
    return known


@kernel
def _adjoint(x: float, y: float, theta: float) -> Floats:
    """[3, 3] how a small movement in a frame looks from the frame in which that frame has a pose."""
    cos, sin = math.cos(theta), math.sin(theta)
    return np.array([[cos, -sin, y], [sin, cos, -x], [0.0, 0.0, 1.0]])
