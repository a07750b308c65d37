"""Low variance resampling, and KLD sampling of the number of particles (Fox, 2001)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import kernel
from wherry.space.pose import Floats

Integers = NDArray[np.int64]

BIN_SIZE = (0.5, 0.5, math.radians(10.0))  # m, m, rad, bins of the posterior's histogram, as in amcl
HEADING_BINS = 36  # bins of the heading in a full turn
GOLDEN_RATIO_STEP = (math.sqrt(5.0) - 1.0) / 2.0  # step modulo 1 whose multiples cover [0, 1) evenly at any number


def log_sum(logarithms: Floats) -> float:
    """The logarithm of a sum of exponentials, log Σ exp(x) of [N], without overflow."""
    peak = float(logarithms.max())
    return peak + math.log(float(np.exp(logarithms - peak).sum()))


def normalize(log_weights: Floats, weights: Floats) -> float:
    """Normalize log weights of any scale to weights that sum to 1.

    Args:
        log_weights: [N] shifted in place to the logarithms of ``weights``.
        weights: [N] output.

    Returns:
        The logarithm of the normalizer.
    """
    peak = float(log_weights.max())
    np.exp(np.subtract(log_weights, peak, out=weights), out=weights)
    total = peak + math.log(float(weights.sum()))
    np.subtract(log_weights, total, out=log_weights)
    np.exp(log_weights, out=weights)
    return total


def kld_sample_size(occupied_bins: int, error: float, quantile: float, min_count: int, max_count: int) -> int:
    """Number of samples that keeps the sampled distribution within ``error`` of the true one (Fox 2001, equation 7).

    Args:
        occupied_bins: Number k of histogram bins with support.
        error: Bound ε on the Kullback-Leibler distance.
        quantile: Upper standard normal quantile z_{1−δ} of the probability that the bound holds.
        min_count: Lower limit of the result.
        max_count: Upper limit of the result.
    """
    return int(_kld_sample_size(occupied_bins, error, quantile, min_count, max_count))


@kernel
def tempering_exponent(log_weights: Floats, log_likelihood: Floats, min_effective: float) -> float:
    """The largest exponent, 0 to 1, of a likelihood that keeps the effective sample size at ``min_effective``.

    Args:
        log_weights: [N] logarithms of the weights before the scan.
        log_likelihood: [N] logarithms of the scan's likelihood.
        min_effective: Effective sample size; where the weights alone are below it, the exponent is 0.
    """
    if _effective_size(log_weights, log_likelihood, 1.0) >= min_effective:
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(10):
        middle = 0.5 * (low + high)
        if _effective_size(log_weights, log_likelihood, middle) >= min_effective:
            low = middle
        else:
            high = middle
    return low


@kernel
def _effective_size(log_weights: Floats, log_likelihood: Floats, exponent: float) -> float:
    """N_eff = (Σw)² / Σw² with log w = log_weights + exponent·log_likelihood."""
    peak = -np.inf
    for i in range(len(log_weights)):
        peak = max(peak, log_weights[i] + exponent * log_likelihood[i])
    total, squares = 0.0, 0.0
    for i in range(len(log_weights)):
        weight = math.exp(log_weights[i] + exponent * log_likelihood[i] - peak)
        total += weight
        squares += weight * weight
    return total * total / squares


@kernel
def _kld_sample_size(occupied_bins: int, error: float, quantile: float, min_count: int, max_count: int) -> int:
    if occupied_bins <= 1:
        return min_count
    freedom = occupied_bins - 1
    a = 2.0 / (9.0 * freedom)
    needed = math.ceil(freedom / (2.0 * error) * (1.0 - a + math.sqrt(a) * quantile) ** 3)
    return int(min(max(needed, min_count), max_count))


@kernel
def adaptive_sample_size(
    particles: Floats,
    weights: Floats,
    table: Integers,
    bin_size: Floats,
    error: float,
    quantile: float,
    min_count: int,
    max_count: int,
    start: float,
) -> int:
    """Number of particles by KLD sampling: draw by weight until the drawn ones suffice for the bins that they occupy.

    Args:
        particles: [N, 3] m, m, rad.
        weights: [N] summing to 1.
        table: Scratch memory from `hash_table`.
        bin_size: [3] m, m, rad.
        error: Bound ε on the Kullback-Leibler distance, see `kld_sample_size`.
        quantile: Upper standard normal quantile z_{1−δ} of the probability that the bound holds.
        min_count: Lower limit of the result.
        max_count: Upper limit of the result.
        start: A uniform random number in [0, 1).
    """
    if min_count == max_count:
        return max_count
    table[:, 1] = 0
    cumulative = np.cumsum(weights)
    guide = _guide(cumulative)
    bins, drawn, needed = 0, 0, min_count
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
            needed = _kld_sample_size(bins, error, quantile, min_count, max_count)
        drawn += 1
        position += GOLDEN_RATIO_STEP
        position -= math.floor(position)
    return needed


@kernel
def _guide(cumulative: Floats) -> Integers:
    """[N] guide table: index of the particle at which the search for each 1/N of the total weight starts."""
    count = len(cumulative)
    guide = np.empty(count, np.int64)
    i = 0
    for part in range(count):
        while i < count - 1 and cumulative[i] <= part * cumulative[-1] / count:
            i += 1
        guide[part] = i
    return guide


@kernel
def low_variance_resample(particles: Floats, weights: Floats, start: float, resampled: Floats) -> None:
    """Systematic resampling with one random number (Probabilistic Robotics, table 4.4).

    Args:
        particles: [N, 3].
        weights: [N] importance weights, summing to 1.
        start: A uniform random number in [0, 1).
        resampled: [M, 3] output; particle i is copied M·weights[i] times, rounded up or down.
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
    """The packed index of the histogram bin of a pose [3] m, m, rad with θ in [−π, π)."""
    x = math.floor(pose[0] / bin_size[0])
    y = math.floor(pose[1] / bin_size[1])
    return pack(x, y, math.floor(pose[2] / bin_size[2]) % HEADING_BINS)


@kernel
def pack(x: int, y: int, theta: int) -> int:
    """Pack a bin's three indices into one; x and y within ±2²⁶, θ in 0 … 63."""
    return ((x + 67108864) * 134217728 + y + 67108864) * 64 + theta


@kernel
def bin_slot(table: Integers, packed: int) -> int:
    """The slot of a bin in a hash table with linear probing, or the empty slot where it belongs.

    Args:
        table: [2^b, 2] packed bin and its number from 1; number 0 marks an empty slot.
        packed: The packed bin.
    """
    mask = len(table) - 1
    slot = ((packed * -7046029254386353131) >> 20) & mask  # Fibonacci hashing
    while table[slot, 1] != 0 and table[slot, 0] != packed:
        slot = (slot + 1) & mask
    return slot


def hash_table(max_bins: int) -> Integers:
    """An empty hash table for at most ``max_bins`` bins, at most half full."""
    return np.zeros((1 << math.ceil(math.log2(2 * max_bins + 2)), 2), np.int64)
