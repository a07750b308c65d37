"""Resampling: low variance, and as many particles as the belief's spread asks for (KLD sampling; Fox, 2001)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import kernel

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

BIN_SIZE = (0.5, 0.5, math.radians(10.0))  # m, m, rad: amcl's histogram of the belief
TURN_BINS = 36  # of BIN_SIZE[2] in a whole turn
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0  # multiples of it, modulo 1, cover [0, 1) evenly however many there are


def log_sum(logarithms: Floats) -> float:
    """The logarithm of the sum of numbers that are given by their logarithms [N]."""
    peak = float(logarithms.max())
    return peak + math.log(float(np.exp(logarithms - peak).sum()))


def normalize(log_weights: Floats, weights: Floats) -> float:
    """Turn log weights into weights that sum to 1, whatever their scale.

    Args:
        log_weights: [N] shifted in place so that they are the logarithms of ``weights``.
        weights: [N] written.

    Returns:
        The logarithm of the sum that was divided out.
    """
    peak = float(log_weights.max())
    np.exp(np.subtract(log_weights, peak, out=weights), out=weights)
    total = peak + math.log(float(weights.sum()))
    np.subtract(log_weights, total, out=log_weights)
    np.exp(log_weights, out=weights)
    return total


def kld_count(occupied_bins: int, error: float, quantile: float, fewest: int, most: int) -> int:
    """How many samples keep the sampled distribution within ``error`` of the true one (Fox 2001, equation 7).

    Args:
        occupied_bins: k, histogram bins with support.
        error: ε, the bound on the Kullback-Leibler distance.
        quantile: z_{1−δ}, upper standard normal quantile of the probability that the bound holds.
        fewest: Lower limit of the answer.
        most: Upper limit.
    """
    return int(_kld_count(occupied_bins, error, quantile, fewest, most))


@kernel
def tempering(log_weights: Floats, increments: Floats, least: float) -> float:
    """The exponent, 0 to 1, of a likelihood that leaves an effective sample size of at least ``least`` particles.

    Args:
        log_weights: [N] before.
        increments: [N] logarithms of the likelihood.
        least: Where the particles before are fewer in effect, 0 is the best that can be done.
    """
    if _effective_size(log_weights, increments, 1.0) >= least:
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(10):
        middle = 0.5 * (low + high)
        if _effective_size(log_weights, increments, middle) >= least:
            low = middle
        else:
            high = middle
    return low


@kernel
def _effective_size(log_weights: Floats, increments: Floats, exponent: float) -> float:
    """N_eff = (Σw)² / Σw² with log w = log_weights + exponent·increments."""
    peak = -np.inf
    for i in range(len(log_weights)):
        peak = max(peak, log_weights[i] + exponent * increments[i])
    total, squares = 0.0, 0.0
    for i in range(len(log_weights)):
        weight = math.exp(log_weights[i] + exponent * increments[i] - peak)
        total += weight
        squares += weight * weight
    return total * total / squares


@kernel
def _kld_count(occupied_bins: int, error: float, quantile: float, fewest: int, most: int) -> int:
    if occupied_bins <= 1:
        return fewest
    freedom = occupied_bins - 1
    a = 2.0 / (9.0 * freedom)
    needed = math.ceil(freedom / (2.0 * error) * (1.0 - a + math.sqrt(a) * quantile) ** 3)
    return int(min(max(needed, fewest), most))


@kernel
def adaptive_count(
    particles: Floats, weights: Floats, table: Integers, bin_size: Floats, limits: Floats, start: float
) -> int:
    """Draw particles by weight until the histogram of those drawn says that there are enough.

    Args:
        particles: [N, 3] m, m, rad.
        weights: [N] summing to 1.
        table: Scratch from `hash_table`.
        bin_size: [3] m, m, rad.
        limits: [4] ε, z, fewest, most.
        start: Uniform in [0, 1).

    Returns:
        How many particles to keep.
    """
    fewest, most = int(limits[2]), int(limits[3])
    if fewest == most:
        return most
    table[:, 1] = 0
    cumulative = np.cumsum(weights)
    guide = _guide(cumulative)
    bins, drawn, needed = 0, 0, fewest
    position = start
    while drawn < needed:
        mark = position * cumulative[-1]
        i = guide[int(position * len(guide))]
        while i < len(weights) - 1 and cumulative[i] <= mark:
            i += 1
        slot = bin_slot(table, pack_bin(particles[i], bin_size))
        if table[slot, 1] == 0:
            bins += 1
            table[slot, 0], table[slot, 1] = pack_bin(particles[i], bin_size), bins
            needed = _kld_count(bins, limits[0], limits[1], fewest, most)
        drawn += 1
        position += GOLDEN
        position -= math.floor(position)
    return needed


@kernel
def _guide(cumulative: Floats) -> Integers:
    """[N] where to begin the search for every Nth part of the weight, which saves searching from the beginning."""
    count = len(cumulative)
    guide = np.empty(count, np.int64)
    i = 0
    for part in range(count):
        while i < count - 1 and cumulative[i] <= part * cumulative[-1] / count:
            i += 1
        guide[part] = i
    return guide


@kernel
def low_variance(particles: Floats, weights: Floats, start: float, resampled: Floats) -> None:
    """Draw particles with one random number (Probabilistic Robotics, table 4.4).

    Args:
        particles: [N, 3].
        weights: [N] summing to 1.
        start: Uniform in [0, 1).
        resampled: [M, 3] written; particle i is copied M·weights[i] times, rounded up or down.
    """
    count = len(resampled)
    i = 0
    reached = weights[0]
    for m in range(count):
        position = (m + start) / count
        while position >= reached and i < len(weights) - 1:
            i += 1
            reached += weights[i]
        resampled[m, 0] = particles[i, 0]
        resampled[m, 1] = particles[i, 1]
        resampled[m, 2] = particles[i, 2]


@kernel
def pack_bin(pose: Floats, bin_size: Floats) -> int:
    """The number of the histogram bin that holds a pose [3] m, m, rad with θ in [−π, π)."""
    x = math.floor(pose[0] / bin_size[0])
    y = math.floor(pose[1] / bin_size[1])
    return pack(x, y, math.floor(pose[2] / bin_size[2]) % TURN_BINS)


@kernel
def pack(x: int, y: int, theta: int) -> int:
    """One number for a bin's three; x and y within ±2²⁶, θ in 0 … 63."""
    return ((x + 67108864) * 134217728 + y + 67108864) * 64 + theta


@kernel
def bin_slot(table: Integers, packed: int) -> int:
    """The row of a hash table that holds a bin, or the empty one where it is to be put.

    Args:
        table: [2^b, 2] packed bin, and its number from 1; number 0 is an empty row.
        packed: The bin.
    """
    mask = len(table) - 1
    slot = ((packed * -7046029254386353131) >> 20) & mask  # Fibonacci hashing
    while table[slot, 1] != 0 and table[slot, 0] != packed:
        slot = (slot + 1) & mask
    return slot


def hash_table(most: int) -> Integers:
    """An empty hash table for at most ``most`` bins, at most half full."""
    return np.zeros((1 << math.ceil(math.log2(2 * most + 2)), 2), np.int64)
