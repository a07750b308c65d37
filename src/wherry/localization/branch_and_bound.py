"""Branch and bound over all poses on a map (Olson 2009; Hess et al. 2016, section V-B).

The score of all poses in a window is bounded from above by looking every beam up in a map of windowed maxima, so that
few lookups prune most of the map without missing a pose. The search continues past the best pose to all other modes.

`wherry.mapping.correlative` bounds windows in the same way, but searches only a small window of a growing grid for the
best pose, with neither a check of free space nor other modes.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import kernel

Bytes = NDArray[np.uint8]
Integers = NDArray[np.int32]

MAX_LIKELIHOOD = 255  # score of a beam that ends on an obstacle
MAX_MODES = 64  # modes after which the search ends incomplete
MAX_EXPANSIONS = 250_000  # expanded windows after which the search ends incomplete


def window_maxima(values: Bytes, levels: int) -> Bytes:
    """Maxima over windows that begin at each cell.

    Args:
        values: Values of the cells, [H, W].
        levels: Number of levels L.

    Returns:
        Maxima, [L, H + P, W + P], at level h over 2^h × 2^h cells; the first P = 2^(L−1) rows and columns are for
        windows that begin outside of the map.
    """
    pad = 1 << (levels - 1)
    current = np.pad(values, ((pad, 0), (pad, 0)))
    maxima = [current]
    for level in range(levels - 1):
        step = 1 << level
        wider = np.pad(current, ((0, step), (0, step)))
        rows = np.maximum(wider[:-step], wider[step:])
        current = np.maximum(rows[:, :-step], rows[:, step:])
        maxima.append(current)
    return np.stack(maxima)


def with_border(levels: Bytes, offsets: Integers) -> tuple[Bytes, Integers]:
    """Add a border of zeros as wide as the longest beam, so that lookups need no bounds check.

    Args:
        levels: Maxima from `window_maxima`, [L, H + P, W + P].
        offsets: Rows and columns from the robot to the ends of the beams at each heading, [A, B, 2].

    Returns:
        The levels with the map's first cell at [R, R], [L, H + 2R, W + 2R], and the offsets in a flattened level,
        [A, B].
    """
    pad = 1 << (len(levels) - 1)
    beyond = max(levels.shape[1:])  # an offset of this length leads off the map from every cell
    offsets = offsets.clip(-beyond, beyond)
    border = max(int(np.abs(offsets).max()) + pad, 2 * pad)
    before, after = border - pad, border
    bordered = np.pad(levels, ((0, 0), (before, after), (before, after)))
    flat: Integers = offsets[:, :, 0] * np.int32(bordered.shape[2]) + offsets[:, :, 1]
    return bordered, flat


@kernel
def branch_and_bound(
    levels: Bytes, free: Bytes, offsets: Integers, min_fraction: float, mode_radius: float, mode_turn: float
) -> tuple[Integers, bool]:
    """Best-first search for the best pose of every mode whose score is close to the overall best score.

    Args:
        levels: Maxima of the likelihoods with a border of R cells, [L, H + 2R, W + 2R], see `with_border`.
        free: Whether each window has a free cell, [L, H, W].
        offsets: Offsets of the beams' ends in a flattened level at each heading, [A, B].
        min_fraction: Fraction of the best score that a pose must reach, 0 to 1.
        mode_radius: Distance from a mode's best pose within which poses belong to the mode, cells.
        mode_turn: Difference from its heading within which poses belong to the mode, in steps of the headings.

    Returns:
        Heading, row and column of each pose, best first, [K, 3], and whether the search was exhaustive.
    """
    top = len(levels) - 1
    border, width = (levels.shape[1] - free.shape[1]) // 2, levels.shape[2]
    found = np.empty((MAX_MODES, 3), np.int32)
    count = 0
    bounds = _window_bounds(levels[top], free[top], offsets, 1 << top)
    best = _descend(levels, free, offsets, bounds)
    heads, windows, used = _open_list(bounds, math.ceil(min_fraction * best), top, MAX_LIKELIHOOD * offsets.shape[1])
    expansions = 0
    for score in range(len(heads) - 1, -1, -1):  # a quarter never scores more than its window, so scores only fall
        while heads[score] >= 0 and score >= min_fraction * best:
            if count == MAX_MODES or expansions == MAX_EXPANSIONS:
                return found[:count], False
            heads[score], level, heading, row, column = windows[heads[score]]
            if _is_covered(found[:count], mode_radius, mode_turn, len(offsets), heading, row, column, 1 << level):
                continue
            if level == 0:
                found[count, 0], found[count, 1], found[count, 2] = heading, row, column
                count += 1
                best = max(best, score)
                continue
            expansions += 1
            half = 1 << (level - 1)
            origin = (border + row) * width + border + column
            scores = _quarter_scores(levels[level - 1].ravel(), offsets[heading], origin, half, half * width)
            for quarter in range(4):
                y, x = row + half * (quarter // 2), column + half * (quarter % 2)
                is_good = scores[quarter] >= min_fraction * best
                if is_good and y < free.shape[1] and x < free.shape[2] and free[level - 1, y, x]:
                    _push(heads, windows, used, scores[quarter], (level - 1, heading, y, x))
                    used += 1
    return found[:count], True


@kernel
def _open_list(bounds: Integers, min_score: int, top: int, max_score: int) -> tuple[Integers, Integers, int]:
    """The open list of the top level's windows whose bounds reach a score.

    Scores are whole numbers, so the list is one stack of windows per score.

    Returns:
        First window of each score's stack, or −1, [max_score + 1]; of each window the next one in the stack, level,
        heading, row and column, [M, 5]; and the number of windows in use.
    """
    heads = np.full(max_score + 1, -1, np.int32)
    promising = np.argwhere(bounds >= min_score)
    windows = np.empty((len(promising) + 4 * MAX_EXPANSIONS, 5), np.int32)
    for used in range(len(promising)):
        heading, y, x = promising[used]
        _push(heads, windows, used, bounds[heading, y, x], (top, heading, y << top, x << top))
    return heads, windows, len(promising)


@kernel
def _push(heads: Integers, windows: Integers, used: int, score: int, window: tuple[int, int, int, int]) -> None:
    """Push a window on the stack of its score."""
    windows[used, 0] = heads[score]
    windows[used, 1], windows[used, 2], windows[used, 3], windows[used, 4] = window
    heads[score] = used


@kernel
def _window_bounds(level: Bytes, free: Bytes, offsets: Integers, step: int) -> Integers:
    """Upper bounds of the score within windows of step × step cells, [A, Y, X]; −1 without a free cell."""
    rows, columns = (free.shape[0] - 1) // step + 1, (free.shape[1] - 1) // step + 1
    border, width = (level.shape[0] - free.shape[0]) // 2, level.shape[1]
    bounds = np.full((len(offsets), rows, columns), -1, np.int32)
    for heading in range(len(offsets)):
        for y in range(rows):
            for x in range(columns):
                if free[y * step, x * step]:
                    origin = (border + y * step) * width + border + x * step
                    bounds[heading, y, x] = beam_score(level.ravel(), offsets[heading], origin)
    return bounds


@kernel
def beam_score(level: Bytes, offsets: Integers, origin: int) -> int:
    """Sum of the values of a flattened level at the offsets of the beams' ends [B] from an index in it."""
    total = 0
    for b in range(len(offsets)):
        total += level[np.uint64(origin + offsets[b])]  # unsigned, so that numba does not check for negative indices
    return total


@kernel
def _quarter_scores(level: Bytes, offsets: Integers, origin: int, right: int, up: int) -> tuple[int, int, int, int]:
    """`beam_score` of the four quarters of a window: at the origin, to the right, above, and diagonally."""
    first, beside, above, diagonal = 0, 0, 0, 0
    for b in range(len(offsets)):
        cell = origin + offsets[b]
        first += level[np.uint64(cell)]
        beside += level[np.uint64(cell + right)]
        above += level[np.uint64(cell + up)]
        diagonal += level[np.uint64(cell + up + right)]
    return first, beside, above, diagonal


@kernel
def _descend(levels: Bytes, free: Bytes, offsets: Integers, bounds: Integers) -> int:
    """Score of the pose found by greedy descent into the best quarters, a lower bound of the best score."""
    top = len(levels) - 1
    border, width = (levels.shape[1] - free.shape[1]) // 2, levels.shape[2]
    best_window = int(np.argmax(bounds))
    heading = best_window // (bounds.shape[1] * bounds.shape[2])
    row = (best_window // bounds.shape[2] % bounds.shape[1]) << top
    column = (best_window % bounds.shape[2]) << top
    best = 0
    for level in range(top - 1, -1, -1):
        best = -1
        half = 1 << level
        origin = (border + row) * width + border + column
        scores = _quarter_scores(levels[level].ravel(), offsets[heading], origin, half, half * width)
        first_row, first_column = row, column
        for quarter in range(4):
            y, x = first_row + half * (quarter // 2), first_column + half * (quarter % 2)
            if y < free.shape[1] and x < free.shape[2] and free[level, y, x] and scores[quarter] > best:
                best, row, column = scores[quarter], y, x
    return best


@kernel
def _is_covered(
    found: Integers, radius: float, max_turn: float, headings: int, heading: int, row: int, column: int, size: int
) -> bool:
    """Whether a whole window belongs to a mode that has been found."""
    for k in range(len(found)):
        turn = abs(heading - found[k, 0])
        if min(turn, headings - turn) > max_turn:
            continue
        dy = max(abs(row - found[k, 1]), abs(row + size - 1 - found[k, 1]))
        dx = max(abs(column - found[k, 2]), abs(column + size - 1 - found[k, 2]))
        if dy * dy + dx * dx <= radius * radius:
            return True
    return False
