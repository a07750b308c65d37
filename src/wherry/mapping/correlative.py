"""Correlative scan matching (Olson 2009): the best pose of a search window, by branch and bound (Hess et al. 2016).

`wherry.localization.relocalization` also uses branch and bound, but on a whole finished map and for all modes. Here the
grid grows with every scan and windows are small, so two levels of bounds above an exhaustive search are faster.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import kernel
from wherry.mapping.matching_grid import MAX_LIKELIHOOD, RESOLUTION, WINDOW_SIZES, MatchingGrid
from wherry.space.pose import Floats, Pose, wrap

ANGLE_STEP_QUANTILE = 0.8  # share of the points that move by at most one cell per angle step
MAX_ANGLE_STEP = math.radians(2.0)  # rad, upper bound of the angle step, for clouds of near points
EDGE_SHARE = 0.9  # share of a window's extent from which a pose counts as on the edge
PEAK_DISTANCE, PEAK_ANGLE = 0.5, math.radians(10.0)  # m and rad, poses closer than both belong to the same peak
PRIOR_WEIGHT = 0.03  # share of the score that is deducted at one standard deviation from the window's centre
WINDOW_SIGMAS = 3.0  # standard deviations from the window's centre to its edge


@dataclass(frozen=True, slots=True)
class SearchWindow:
    """A window of poses to search, around an expected pose.

    Attributes:
        centre: The expected pose.
        distance: Extent to either side in x and in y, m.
        angle: Extent to either side in heading, rad.
    """

    centre: Pose
    distance: float
    angle: float

    def is_on_edge(self, pose: Pose) -> bool:
        """Whether a pose is so close to the edge that a better one may lie outside of the window."""
        offset = max(abs(pose.x - self.centre.x), abs(pose.y - self.centre.y))
        turn = abs(wrap(pose.theta - self.centre.theta))
        return offset > EDGE_SHARE * self.distance or turn > EDGE_SHARE * self.angle


@dataclass(frozen=True, slots=True)
class Correlation:
    """The best pose of a search window.

    Attributes:
        pose: The best pose, to the nearest cell and angle step.
        score: Mean likelihood of the points at that pose, 0 to 1.
        second_best_score: Score of the best pose on another peak, 0 to 1; only a lower bound where it is below
            ``second_best_share`` of the best score, see `correlate`.
    """

    pose: Pose
    score: float
    second_best_score: float


def correlate(
    grid: MatchingGrid, points: Floats, window: SearchWindow, *, second_best_share: float = 1.0
) -> Correlation:
    """Find the pose of a window at which points fit a grid best.

    Args:
        grid: The grid to match to.
        points: Points in the frame whose pose is sought, [N, 2] m, N ≥ 1.
        window: Poses to search, in the grid's frame. Where the points do not determine the pose, a weak Gaussian prior
            around the window's centre does, see `PRIOR_WEIGHT`.
        second_best_share: Peaks that reach this share of the best score are certain to be found; with 1 only the best
            one is, which is fastest.
    """
    radii = np.sort(np.hypot(points[:, 0], points[:, 1]))
    radius = float(radii[int(ANGLE_STEP_QUANTILE * (len(points) - 1))])
    step = min(math.atan2(RESOLUTION, max(radius, RESOLUTION)), MAX_ANGLE_STEP)
    steps = math.ceil(window.angle / step)
    angles = window.centre.theta + step * np.arange(-steps, steps + 1, dtype=np.float64)
    cells = math.ceil(window.distance / RESOLUTION)
    best, score, second_best_score = _search(
        grid.likelihood,
        grid.corner,
        points,
        np.array([window.centre.x, window.centre.y]),
        angles,
        cells,
        second_best_share,
        np.array([PEAK_DISTANCE / RESOLUTION, PEAK_ANGLE / step]),
    )
    x, y = window.centre.x + best[1] * RESOLUTION, window.centre.y + best[2] * RESOLUTION
    return Correlation(Pose.from_array(np.array([x, y, angles[best[0]]])), score, second_best_score)


def score_at(grid: MatchingGrid, points: Floats, pose: Pose) -> float:
    """Mean likelihood, 0 to 1, of points [N, 2] m at a pose in the grid's frame."""
    angles = np.array([pose.theta])
    cells = _rotated_cells(points, np.array([pose.x, pose.y]), angles, grid.corner)
    return _score(grid.likelihood[0], cells[0], 0, 0) / (len(points) * MAX_LIKELIHOOD)


@kernel
def _search(
    likelihood: NDArray[np.uint8],
    corner: NDArray[np.int64],
    points: Floats,
    centre: Floats,
    angles: Floats,
    cells: int,
    second_best_share: float,
    peak_extent: Floats,
) -> tuple[NDArray[np.int64], float, float]:
    """Best-first search over squares of the window.

    Args:
        likelihood: The grid's levels, [L, H, W].
        corner: The grid's corner, [2].
        points: Points, [N, 2] m.
        centre: Position of the window's centre, [2] m.
        angles: Headings, [A] rad.
        cells: Extent of the window to either side, cells.
        second_best_share: As in `correlate`.
        peak_extent: Extent of a peak, [2] cells and angle steps.

    Returns:
        Index of the heading and columns and rows from the centre, [3]; the score; the second-best score.
    """
    top = len(WINDOW_SIZES) - 1
    rotated = _rotated_cells(points, centre, angles, corner)
    side = 2 * cells // WINDOW_SIZES[top] + 1
    bounds = _upper_bounds(likelihood[top], rotated, side, cells)
    best, best_weighted, best_score = np.zeros(3, np.int64), -1.0, 0.0
    peaks = np.empty(
        (len(bounds), 4)
    )  # heading's index, columns, rows and score of the best leaf of each expanded node
    expanded = 0
    leaf = np.empty(4)
    for node in np.argsort(-bounds, kind="mergesort"):
        if bounds[node] < second_best_share * best_weighted:
            break
        a, row, column = node // (side * side), (node // side) % side, node % side
        turn = (a - len(angles) // 2) / max(len(angles) // 2, 1)
        _expand(
            likelihood,
            rotated[a],
            column * WINDOW_SIZES[top] - cells,
            row * WINDOW_SIZES[top] - cells,
            cells,
            turn,
            second_best_share * best_weighted,
            leaf,
        )
        if leaf[3] < 0.0:
            continue
        peaks[expanded, 0], peaks[expanded, 1:] = a, leaf[:3]
        expanded += 1
        if leaf[3] > best_weighted:
            best[0], best[1], best[2] = a, int(leaf[0]), int(leaf[1])
            best_weighted, best_score = leaf[3], leaf[2]
    return best, best_score, _second_best_score(peaks[:expanded], best, peak_extent)


@kernel
def _upper_bounds(layer: NDArray[np.uint8], rotated: NDArray[np.int32], side: int, cells: int) -> Floats:
    """Upper bounds of the scores in all squares of the window, [A * side * side].

    Args:
        layer: Coarsest level of the grid, [H, W].
        rotated: Columns and rows of the points at each heading, [A, N, 2].
        side: Number of squares along each side of the window.
        cells: Extent of the window to either side, cells.
    """
    size = WINDOW_SIZES[len(WINDOW_SIZES) - 1]
    bounds = np.empty(len(rotated) * side * side)
    for node in range(len(bounds)):
        a, row, column = node // (side * side), (node // side) % side, node % side
        score = _score(layer, rotated[a], column * size - cells, row * size - cells)
        bounds[node] = score / (rotated.shape[1] * MAX_LIKELIHOOD)
    return bounds


@kernel
def _second_best_score(peaks: Floats, best: NDArray[np.int64], peak_extent: Floats) -> float:
    """Highest score of the peaks [P, 4] outside of the extent [2] of the best one [3]; 0 without another peak."""
    second_best_score = 0.0
    for n in range(len(peaks)):
        distance = math.hypot(peaks[n, 1] - best[1], peaks[n, 2] - best[2])
        is_other_peak = distance > peak_extent[0] or abs(peaks[n, 0] - best[0]) > peak_extent[1]
        if is_other_peak and peaks[n, 3] > second_best_score:
            second_best_score = peaks[n, 3]
    return second_best_score


@kernel
def _expand(
    likelihood: NDArray[np.uint8],
    rotated: NDArray[np.int32],
    column: int,
    row: int,
    cells: int,
    turn: float,
    threshold: float,
    leaf: Floats,
) -> None:
    """Find the best pose of a square of the coarsest level.

    Args:
        likelihood: The grid's levels, [L, H, W].
        rotated: Columns and rows of the points at the square's heading, [N, 2].
        column: First column of the square, from the window's centre.
        row: First row of the square, from the window's centre.
        cells: Extent of the window to either side, cells.
        turn: The square's heading from the window's centre, as a share of the window's extent.
        threshold: Weighted score below which poses are skipped.
        leaf: Result, [4]: columns, rows, score, and score weighted by the prior, which is negative if all were skipped.
    """
    scale = 1.0 / (len(rotated) * MAX_LIKELIHOOD)
    top = WINDOW_SIZES[len(WINDOW_SIZES) - 1]
    middle = WINDOW_SIZES[1]
    leaf[3] = -1.0
    for row_1 in range(row, min(row + top, cells + 1), middle):
        for column_1 in range(column, min(column + top, cells + 1), middle):
            bound = _score(likelihood[1], rotated, column_1, row_1) * scale
            if bound < threshold or bound <= leaf[3]:
                continue
            for row_0 in range(row_1, min(row_1 + middle, cells + 1)):
                for column_0 in range(column_1, min(column_1 + middle, cells + 1)):
                    score = _score(likelihood[0], rotated, column_0, row_0) * scale
                    squared = (column_0 * column_0 + row_0 * row_0) / max(cells * cells, 1) + turn * turn
                    weighted = score * (1.0 - PRIOR_WEIGHT * (0.5 * WINDOW_SIGMAS * WINDOW_SIGMAS) * squared)
                    if weighted >= threshold and weighted > leaf[3]:
                        leaf[0], leaf[1], leaf[2], leaf[3] = column_0, row_0, score, weighted


@kernel
def _rotated_cells(points: Floats, centre: Floats, angles: Floats, corner: NDArray[np.int64]) -> NDArray[np.int32]:
    """Column and row of each point [N, 2] m at each heading [A] rad with the robot at the centre [2] m, [A, N, 2]."""
    cells = np.empty((len(angles), len(points), 2), np.int32)
    for a in range(len(angles)):
        cos, sin = math.cos(angles[a]), math.sin(angles[a])
        for n in range(len(points)):
            x = centre[0] + cos * points[n, 0] - sin * points[n, 1]
            y = centre[1] + sin * points[n, 0] + cos * points[n, 1]
            cells[a, n, 0] = math.floor(x / RESOLUTION) - corner[0]
            cells[a, n, 1] = math.floor(y / RESOLUTION) - corner[1]
    return cells


@kernel
def _score(layer: NDArray[np.uint8], cells: NDArray[np.int32], columns: int, rows: int) -> int:
    """Sum of the likelihoods at cells [N, 2] shifted by columns and rows; cells outside of the layer count 0."""
    height, width = layer.shape
    total = 0
    for n in range(len(cells)):
        column, row = cells[n, 0] + columns, cells[n, 1] + rows
        if 0 <= column < width and 0 <= row < height:
            total += layer[row, column]
    return total
