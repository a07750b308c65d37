"""Global relocalization: where on the whole map one scan can have been taken.

Branch and bound over positions and headings (Olson, 2009; Hess et al., 2016): a window of positions is bounded from
above by looking every beam up in a map of windowed maxima, so that nearly all of the map is ruled out by a few
look-ups, and what is left is exact. The search goes on past the best pose, to every other place that explains the scan
about as well: in a building with two equal rooms a single answer would be a guess, and says so.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import kernel
from wherry.localization.agreement import ScanAgreement, mean_agreement, scan_agreement
from wherry.localization.parameters import AmclParameters
from wherry.localization.refinement import match_scan
from wherry.localization.sensor import Beams, valid_beams
from wherry.robot import Scan
from wherry.space.distance_field import DistanceField
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose

Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Integers = NDArray[np.int32]

SEARCH_CELL = 0.1  # m, the search's grid; refinement does the rest
SEARCH_SIGMA = 0.15  # m, how far a beam may end from an obstacle and still count for the search
FULL = 255  # score of a beam that ends on an obstacle
LEVELS = 5  # windows of 1, 2, 4, 8 and 16 search cells
FEWEST_HEADINGS, MOST_HEADINGS = 120, 480
MOST_BEAMS = 360  # are compared with the map; of these
SEARCH_BEAMS = 100  # are searched with
CONSIDERED = 0.8  # poses with a smaller share of the best score are no hypotheses
MOST_HYPOTHESES = 64
MOST_EXPANSIONS = 250_000
APART = 0.5  # m: nearer than this two poses are one hypothesis
APART_HEADING = math.radians(20.0)
SEARCH_COVARIANCE = np.diag([0.15**2, 0.15**2, math.radians(3.0) ** 2])  # m, m, rad, of a pose on the search grid
MATCH_SIGMA = 0.05  # m
DRIFT = np.diag([0.05**2, 0.05**2, math.radians(2.0) ** 2])  # m, m, rad, of the odometry from one scan to another
DRIFT_SHARE = 0.1  # m/m, rad/m and rad/rad: how much more it is after a long way
SHARPNESS = 25.0  # how many independent readings a scan is worth; between the best values for two real buildings
AMBIGUOUS_BELOW = 0.9  # probability of the best hypothesis
POOR = -1.0  # mean log likelihood of a beam below which a place explains the scan poorly


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """A pose that explains the scan.

    Attributes:
        pose: base_link in the map frame.
        covariance: [3, 3] m, m, rad.
        probability: That it is the true one, among all hypotheses.
        agreement: How the scan's beams agree with the map there.
    """

    pose: Pose
    covariance: Floats
    probability: float
    agreement: ScanAgreement


@dataclass(frozen=True, slots=True)
class Relocalization:
    """All that one scan says about where the robot is.

    Attributes:
        hypotheses: The most probable first; empty if the scan fits nowhere.
        complete: Whether all of the map was ruled in or out; otherwise the search hit its limit.
    """

    hypotheses: tuple[Hypothesis, ...]
    complete: bool

    @property
    def ambiguity(self) -> float:
        """Probability that the best hypothesis is not the true one, 0 to 1."""
        return 1.0 - self.hypotheses[0].probability if self.hypotheses else 1.0

    @property
    def ambiguous(self) -> bool:
        """Whether the best hypothesis should not be relied upon.

        The search keeps the best places it finds. Where there are too many for it, another one may be right only if
        the best one explains the scan poorly.
        """
        if not self.hypotheses or self.ambiguity > 1.0 - AMBIGUOUS_BELOW:
            return True
        return not self.complete and self.hypotheses[0].agreement.log_likelihood < POOR


class Relocalizer:
    """Finds a robot on a map from one scan.

    Args:
        grid: The map.
        lidar: The lidar's pose, base_link frame.
        parameters: Its range limits and the robot's radius count.
    """

    def __init__(self, grid: OccupancyGrid, lidar: Pose, parameters: AmclParameters | None = None) -> None:
        self._lidar = lidar
        self._parameters = parameters or AmclParameters()
        self._field = DistanceField.of(grid, 1.0)
        self._charted = ~grid.unknown
        factor = max(1, round(SEARCH_CELL / grid.resolution))
        self._cell = grid.resolution * factor
        nearness = np.exp(-0.5 * np.square(_pool(self._field.distance, factor, np.min) / SEARCH_SIGMA))
        self._levels = _window_maxima(np.rint(nearness * FULL).astype(np.uint8), LEVELS)
        pad = 1 << (LEVELS - 1)
        free = _window_maxima(_pool(grid.free, factor, np.max).astype(np.uint8), LEVELS)
        self._free = np.ascontiguousarray(free[:, pad:, pad:])

    def search(self, scan: Scan) -> Relocalization:
        """Find every place on the map where the scan can have been taken.

        Args:
            scan: The scan; where its beams ended counts, and what they passed through.
        """
        return self.search_beams(valid_beams(scan, self._lidar, self._parameters))

    def search_beams(self, beams: Beams) -> Relocalization:
        """Find every place on the map where the scan with these valid beams can have been taken; see `search`."""
        ends = beams.evenly_spaced(MOST_BEAMS).ends
        if not len(ends):
            return Relocalization((), complete=True)
        poses, complete = self._candidates(_thinned(ends, self._cell))
        judged = [self._judge(pose, ends) for pose in poses]
        return Relocalization(_distinct(judged), complete)

    def confirm(
        self, hypotheses: Sequence[Hypothesis], earlier: Sequence[tuple[Pose, Floats]]
    ) -> tuple[Hypothesis, ...]:
        """Judge hypotheses by other scans too, taken shortly before on the way to where they say that the robot is.

        Args:
            hypotheses: From `search`.
            earlier: base_link at each of the other scans as seen from where it is now, by odometry, and where its beams
                ended, [B, 2] m, base_link frame.

        Returns:
            The same hypotheses, with the agreement averaged over all scans, the most probable first.
        """
        return _distinct([self._confirmed(found, earlier) for found in hypotheses])

    def _confirmed(self, found: Hypothesis, earlier: Sequence[tuple[Pose, Floats]]) -> Hypothesis:
        scans = [found.agreement]
        for seen_from, ends in earlier:
            covariance = found.covariance + _drift(seen_from)
            match = match_scan(self._field, ends, found.pose @ seen_from, covariance, MATCH_SIGMA)
            scans.append(scan_agreement(self._field, self._charted, ends, self._lidar, match.pose))
        return replace(found, agreement=mean_agreement(scans))

    def _candidates(self, ends: Floats) -> tuple[list[Pose], bool]:
        """Poses on the search grid, none within APART of a better one, and whether these are all there are."""
        headings = _headings(ends, self._cell)
        cos, sin = np.cos(headings)[:, None], np.sin(headings)[:, None]
        offsets = np.stack([sin * ends[:, 0] + cos * ends[:, 1], cos * ends[:, 0] - sin * ends[:, 1]], axis=2)
        levels, flat_offsets = _bordered(self._levels, np.floor(offsets / self._cell + 0.5).astype(np.int32))
        found, complete = _branch_and_bound(
            levels,
            self._free,
            flat_offsets,
            np.array([CONSIDERED, APART / self._cell, APART_HEADING / math.tau * len(headings)]),
        )
        poses = [
            self._field.origin @ Pose((column + 0.5) * self._cell, (row + 0.5) * self._cell, headings[heading])
            for heading, row, column in found
        ]
        return poses, complete

    def _judge(self, pose: Pose, ends: Floats) -> Hypothesis:
        """A pose of the search, matched to the map and compared with it; its probability is not known yet."""
        coarse = match_scan(self._field, ends, pose, SEARCH_COVARIANCE, SEARCH_SIGMA)
        fine = match_scan(self._field, ends, coarse.pose, SEARCH_COVARIANCE, MATCH_SIGMA)
        return Hypothesis(
            fine.pose, fine.covariance, 0.0, scan_agreement(self._field, self._charted, ends, self._lidar, fine.pose)
        )


def _drift(moved: Pose) -> Floats:
    """[3, 3] m, m, rad: covariance of what the wheels say of a way that led so far."""
    distance, turn = math.hypot(moved.x, moved.y), abs(moved.theta)
    along, turned = DRIFT_SHARE * distance, DRIFT_SHARE * (distance + turn)
    covariance: Floats = DRIFT + np.diag([along**2, along**2, turned**2])
    return covariance


def _distinct(judged: list[Hypothesis]) -> tuple[Hypothesis, ...]:
    """The hypotheses without those that came to the same pose, with their probabilities, the best first."""
    judged = sorted(judged, key=lambda found: -found.agreement.log_likelihood)
    kept: list[Hypothesis] = []
    for found in judged:
        if not any(found.pose.is_near(better.pose, APART, APART_HEADING) for better in kept):
            kept.append(found)
    logits = np.array([SHARPNESS * found.agreement.log_likelihood for found in kept])
    odds = np.exp(logits - logits.max()) if kept else logits
    return tuple(replace(found, probability=float(p)) for found, p in zip(kept, odds / odds.sum(), strict=True))


def _headings(ends: Floats, cell: float) -> Floats:
    """[A] rad, so fine that from one to the next most beam ends move by less than two cells."""
    reach = float(np.quantile(np.hypot(ends[:, 0], ends[:, 1]), 0.8))
    count = int(np.clip(math.tau * reach / (2.0 * cell), FEWEST_HEADINGS, MOST_HEADINGS))
    headings: Floats = np.linspace(-math.pi, math.pi, count, endpoint=False)
    return headings


def _thinned(ends: Floats, cell: float) -> Floats:
    """[≤ SEARCH_BEAMS, 2] one beam end for each cell, so that a wall close by does not outweigh all the others."""
    _, first = np.unique(np.floor(ends / cell).astype(np.int64), axis=0, return_index=True)
    first.sort()
    chosen = first[np.linspace(0, len(first) - 1, min(len(first), SEARCH_BEAMS)).astype(np.int64)]
    thinned: Floats = ends[chosen]
    return thinned


def _pool(values: NDArray[Any], factor: int, reduce: Callable[..., NDArray[Any]]) -> NDArray[Any]:
    """[⌈H / factor⌉, ⌈W / factor⌉] the least or the greatest of every block."""
    height, width = values.shape
    padded = np.pad(values, ((0, -height % factor), (0, -width % factor)), mode="edge")
    return reduce(padded.reshape(padded.shape[0] // factor, factor, -1, factor), axis=(1, 3))


def _window_maxima(values: Bytes, levels: int) -> Bytes:
    """[levels, H + P, W + P] at level h the greatest of the 2^h × 2^h values that begin there; P = 2^(levels−1).

    The rows and columns before the first, P of them, are for windows that begin outside.
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


def _bordered(levels: Bytes, offsets: Integers) -> tuple[Bytes, Integers]:
    """Surround the levels by so much nothing that no beam from a cell of the map leaves them: no look-up need ask.

    Args:
        levels: [L, H + P, W + P] from `_window_maxima`.
        offsets: [A, B, 2] rows and columns from the robot to the beams' ends, for every heading.

    Returns:
        [L, H + 2R, W + 2R] the levels, with the map's first cell at [R, R]; and [A, B] the offsets in a flattened one.
    """
    pad = 1 << (len(levels) - 1)
    beyond = max(levels.shape[1:])  # whatever is farther than this off is off the map from everywhere
    offsets = offsets.clip(-beyond, beyond)
    reach = max(int(np.abs(offsets).max()) + pad, 2 * pad)
    before, after = reach - pad, reach
    surrounded = np.pad(levels, ((0, 0), (before, after), (before, after)))
    flat: Integers = offsets[:, :, 0] * np.int32(surrounded.shape[2]) + offsets[:, :, 1]
    return surrounded, flat


@kernel
def _branch_and_bound(levels: Bytes, free: Bytes, offsets: Integers, limits: Floats) -> tuple[Integers, bool]:
    """Best-first search for all distinct poses whose score is near the best one's.

    Args:
        levels: [L, H + 2R, W + 2R] windowed maxima of the nearness to obstacles; R are the rows and columns that the
            farthest beam needs.
        free: [L, H, W] whether a window has a free cell.
        offsets: [A, B] for every heading, how far the beams' ends are from the robot in a flattened level.
        limits: [3] the share of the best score that counts, and how far apart in cells and in headings poses must be.

    Returns:
        [K, 3] heading, row, column of each, best first; and whether these are all that there are.
    """
    top = len(levels) - 1
    border, width = (levels.shape[1] - free.shape[1]) // 2, levels.shape[2]
    found = np.empty((MOST_HYPOTHESES, 3), np.int32)
    count = 0
    bounds = _window_scores(levels[top], free[top], offsets, 1 << top)
    best = _descend(levels, free, offsets, bounds)
    heads, windows, used = _queue_of(bounds, math.ceil(limits[0] * best), top, FULL * offsets.shape[1])
    expansions = 0
    for score in range(len(heads) - 1, -1, -1):  # no window has a higher score than the one that it is a part of
        while heads[score] >= 0 and score >= limits[0] * best:
            if count == MOST_HYPOTHESES or expansions == MOST_EXPANSIONS:
                return found[:count], False
            heads[score], level, heading, row, column = windows[heads[score]]
            if _covered(found[:count], limits, len(offsets), heading, row, column, 1 << level):
                continue
            if level == 0:
                found[count, 0], found[count, 1], found[count, 2] = heading, row, column
                count += 1
                best = max(best, score)
                continue
            expansions += 1
            half = 1 << (level - 1)
            place = (border + row) * width + border + column
            scores = _quarter_scores(levels[level - 1].ravel(), offsets[heading], place, half, half * width)
            for quarter in range(4):
                y, x = row + half * (quarter // 2), column + half * (quarter % 2)
                enough = scores[quarter] >= limits[0] * best
                if enough and y < free.shape[1] and x < free.shape[2] and free[level - 1, y, x]:
                    _put(heads, windows, used, scores[quarter], (level - 1, heading, y, x))
                    used += 1
    return found[:count], True


@kernel
def _queue_of(bounds: Integers, least: int, top: int, most: int) -> tuple[Integers, Integers, int]:
    """A queue with the windows of the top level that may hold a pose with at least this score.

    Scores are whole numbers, so that the queue is a pile of windows for every score.

    Returns:
        [most + 1] the uppermost window of each pile, −1 where there is none; [M, 5] of every window the one below it,
        level, heading, row and column; and how many of the M are used.
    """
    heads = np.full(most + 1, -1, np.int32)
    waiting = np.argwhere(bounds >= least)
    windows = np.empty((len(waiting) + 4 * MOST_EXPANSIONS, 5), np.int32)
    for used in range(len(waiting)):
        heading, y, x = waiting[used]
        _put(heads, windows, used, bounds[heading, y, x], (top, heading, y << top, x << top))
    return heads, windows, len(waiting)


@kernel
def _put(heads: Integers, windows: Integers, used: int, score: int, window: tuple[int, int, int, int]) -> None:
    """Lay a window on its score's pile."""
    windows[used, 0] = heads[score]
    windows[used, 1], windows[used, 2], windows[used, 3], windows[used, 4] = window
    heads[score] = used


@kernel
def _window_scores(level: Bytes, free: Bytes, offsets: Integers, step: int) -> Integers:
    """[A, Y, X] upper bounds of the score within every window of step × step cells; −1 where nothing is free."""
    rows, columns = (free.shape[0] - 1) // step + 1, (free.shape[1] - 1) // step + 1
    border, width = (level.shape[0] - free.shape[0]) // 2, level.shape[1]
    bounds = np.full((len(offsets), rows, columns), -1, np.int32)
    for heading in range(len(offsets)):
        for y in range(rows):
            for x in range(columns):
                if free[y * step, x * step]:
                    place = (border + y * step) * width + border + x * step
                    bounds[heading, y, x] = _score(level.ravel(), offsets[heading], place)
    return bounds


@kernel
def _score(level: Bytes, offsets: Integers, place: int) -> int:
    """Sum of the values of a flattened level that the beams [B] hit from a place in it."""
    total = 0
    for b in range(len(offsets)):
        total += level[np.uint64(place + offsets[b])]  # unsigned: numba need not look for negative indices
    return total


@kernel
def _quarter_scores(level: Bytes, offsets: Integers, place: int, right: int, up: int) -> tuple[int, int, int, int]:
    """`_score` for the four quarters of a window, which share the beams: at place, to the right, above, and both."""
    here, beside, above, across = 0, 0, 0, 0
    for b in range(len(offsets)):
        cell = place + offsets[b]
        here += level[np.uint64(cell)]
        beside += level[np.uint64(cell + right)]
        above += level[np.uint64(cell + up)]
        across += level[np.uint64(cell + up + right)]
    return here, beside, above, across


@kernel
def _descend(levels: Bytes, free: Bytes, offsets: Integers, bounds: Integers) -> int:
    """The score of a good pose, found by always taking the best quarter: what is worse than it need not be searched."""
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
        place = (border + row) * width + border + column
        scores = _quarter_scores(levels[level].ravel(), offsets[heading], place, half, half * width)
        first_row, first_column = row, column
        for quarter in range(4):
            y, x = first_row + half * (quarter // 2), first_column + half * (quarter % 2)
            if y < free.shape[1] and x < free.shape[2] and free[level, y, x] and scores[quarter] > best:
                best, row, column = scores[quarter], y, x
    return best


@kernel
def _covered(found: Integers, limits: Floats, headings: int, heading: int, row: int, column: int, size: int) -> bool:
    """Whether all of a window lies near a pose that has been found already."""
    for k in range(len(found)):
        turned = abs(heading - found[k, 0])
        if min(turned, headings - turned) > limits[2]:
            continue
        dy = max(abs(row - found[k, 1]), abs(row + size - 1 - found[k, 1]))
        dx = max(abs(column - found[k, 2]), abs(column + size - 1 - found[k, 2]))
        if dy * dy + dx * dx <= limits[1] * limits[1]:
            return True
    return False
