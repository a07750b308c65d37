"""The dominant cluster of the particles; a multi-modal posterior must not be averaged to a pose between its modes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import fastmath_kernel, kernel
from wherry.localization.resampling import BIN_SIZE, HEADING_BINS, Integers, bin_slot, pack
from wherry.space.pose import Floats, Pose


@dataclass(frozen=True, slots=True)
class Cluster:
    """Particles in connected bins.

    Attributes:
        weight: Posterior weight of the cluster, 0 to 1.
        mean: Weighted mean pose of the cluster, map frame.
        covariance: [3, 3] m, m, rad, weighted covariance of the cluster.
    """

    weight: float
    mean: Pose
    covariance: Floats


def dominant_cluster(particles: Floats, weights: Floats, table: Integers) -> Cluster:
    """Find the cluster with the most weight, as amcl does: connected bins of 0.5 m and 10° form a cluster.

    Args:
        particles: [N, 3] m, m, rad.
        weights: [N] importance weights, summing to 1.
        table: Scratch memory from `resampling.hash_table` for at least N bins.
    """
    weight, mean, covariance = _heaviest_cluster(particles, weights, table, np.array(BIN_SIZE))
    return Cluster(weight, Pose.from_array(mean), covariance)


@kernel
def _heaviest_cluster(
    particles: Floats, weights: Floats, table: Integers, bin_size: Floats
) -> tuple[float, Floats, Floats]:
    """Posterior weight, mean pose [3] m, m, rad, and covariance [3, 3] of the cluster with the most weight."""
    members, bins = _bin_particles(particles, table, bin_size)
    root = _join_neighbours(table, bins)
    mass = np.zeros(len(bins))
    for i in range(len(particles)):
        members[i] = root[members[i]]
        mass[members[i]] += weights[i]
    best = int(np.argmax(mass))
    mean, covariance = moments(particles, weights, members == best)
    return mass[best], mean, covariance


@kernel
def _bin_particles(particles: Floats, table: Integers, bin_size: Floats) -> tuple[Integers, Integers]:
    """[N] index of every particle's bin, and [K, 3] the occupied bins."""
    table[:, 1] = 0
    count = len(particles)
    members = np.empty(count, np.int64)
    bins = np.empty((count, 3), np.int64)
    found = 0
    previous, previous_member = -1, 0  # after resampling, copies of a particle are adjacent and share its bin
    for i in range(count):
        x = math.floor(particles[i, 0] / bin_size[0])
        y = math.floor(particles[i, 1] / bin_size[1])
        theta = math.floor(particles[i, 2] / bin_size[2]) % HEADING_BINS
        packed = pack(x, y, theta)
        if packed == previous:
            members[i] = previous_member
            continue
        slot = bin_slot(table, packed)
        if table[slot, 1] == 0:
            bins[found, 0], bins[found, 1], bins[found, 2] = x, y, theta
            found += 1
            table[slot, 0], table[slot, 1] = packed, found
        previous, previous_member = packed, table[slot, 1] - 1
        members[i] = previous_member
    return members, bins[:found]


@kernel
def _join_neighbours(table: Integers, bins: Integers) -> Integers:
    """[K] index of the first bin in each bin's connected component, by breadth-first search."""
    root = np.full(len(bins), -1, np.int64)
    queue = np.empty(len(bins), np.int64)
    for first in range(len(bins)):
        if root[first] >= 0:
            continue
        root[first] = first
        queue[0] = first
        head, tail = 0, 1
        while head < tail:
            x, y, theta = bins[queue[head]]
            head += 1
            for step in range(27):
                near = pack(x + step // 9 - 1, y + step // 3 % 3 - 1, (theta + step % 3 - 1) % HEADING_BINS)
                other = table[bin_slot(table, near), 1] - 1
                if other >= 0 and root[other] < 0:
                    root[other] = first
                    queue[tail] = other
                    tail += 1
    return root


@fastmath_kernel
def moments(particles: Floats, weights: Floats, chosen: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Weighted mean [3] m, m, rad and covariance [3, 3] of the chosen particles, with circular mean of the headings."""
    total, x, y, cos, sin = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(len(particles)):
        if chosen[i]:
            weight = weights[i]
            total += weight
            x += weight * particles[i, 0]
            y += weight * particles[i, 1]
            cos += weight * math.cos(particles[i, 2])
            sin += weight * math.sin(particles[i, 2])
    x, y, theta = x / total, y / total, math.atan2(sin, cos)
    xx, xy, yy, xt, yt, tt = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(len(particles)):
        if chosen[i]:
            share = weights[i] / total
            dx, dy, turn = particles[i, 0] - x, particles[i, 1] - y, particles[i, 2] - theta
            turn -= math.tau * math.floor((turn + math.pi) / math.tau)
            xx += share * dx * dx
            xy += share * dx * dy
            yy += share * dy * dy
            xt += share * dx * turn
            yt += share * dy * turn
            tt += share * turn * turn
    return np.array([x, y, theta]), np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]])
