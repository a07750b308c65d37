"""Correlative scan matching: the best of all poses in a window (Olson 2009), found by branch and bound (Hess 2016)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import kernel
from wherry.mapping.submap import FULL, LEVELS, RESOLUTION, Submap
from wherry.space.pose import Floats, Pose, wrap

ANGLE_QUANTILE = 0.8  # a step in angle moves a point that far out (of all points' distances) by one cell
EDGE = 0.9  # share of a window beyond which its best pose is not known to be a peak
COARSEST_STEP = math.radians(2.0)
APART = 0.5  # m and, below, rad: poses closer together than this are one peak
APART_ANGLE = math.radians(10.0)
PRIOR_WEIGHT = 0.03  # how much of the response a pose one σ off the expected one loses


@dataclass(frozen=True, slots=True)
class Window:
    """Where to look for a pose: around an expected one.

    Attributes:
        centre: The expected pose.
        distance: m, to either side, in x and in y.
        angle: rad, to either side.
    """

    centre: Pose
    distance: float
    angle: float

    def on_edge(self, pose: Pose) -> bool:
        """Whether a pose lies so near the window's edge that a better one may lie beyond."""
        aside = max(abs(pose.x - self.centre.x), abs(pose.y - self.centre.y))
        return aside > EDGE * self.distance or abs(wrap(pose.theta - self.centre.theta)) > EDGE * self.angle


@dataclass(frozen=True, slots=True)
class Correlation:
    """The best pose of a window.

    Attributes:
        pose: To the nearest cell and angle step.
        response: 0 to 1, the mean likelihood of the points there.
        rival: 0 to 1, the response of the best pose that is another peak (`APART`); exact where it comes within the
            rivalry asked for, otherwise an underestimate.
    """

    pose: Pose
    response: float
    rival: float


def correlate(submap: Submap, points: Floats, window: Window, *, rivalry: float = 1.0) -> Correlation:
    """Find where points fit a submap best.

    Args:
        submap: What to match to.
        points: [N, 2] m, in the frame of the pose that is sought, N ≥ 1.
        window: Where to look, in the submap's frame. Poses lose response with their distance from its centre, by
            `PRIOR_WEIGHT` at a third of the window, so that what the points leave open is answered as expected.
        rivalry: Share of the best response from which other peaks are to be told; 1 for none.
    """
    reach = float(np.sort(np.hypot(points[:, 0], points[:, 1]))[int(ANGLE_QUANTILE * (len(points) - 1))])
    step = min(math.atan2(RESOLUTION, max(reach, RESOLUTION)), COARSEST_STEP)
    steps = math.ceil(window.angle / step)
    angles = window.centre.theta + step * np.arange(-steps, steps + 1, dtype=np.float64)
    cells = math.ceil(window.distance / RESOLUTION)
    best, response, rival = _search(
        submap.likelihood,
        submap.corner,
        points,
        np.array([window.centre.x, window.centre.y]),
        angles,
        cells,
        rivalry,
        np.array([APART / RESOLUTION, APART_ANGLE / step]),
    )
    x, y = window.centre.x + best[1] * RESOLUTION, window.centre.y + best[2] * RESOLUTION
    return Correlation(Pose.from_array(np.array([x, y, angles[best[0]]])), response, rival)


def response_at(submap: Submap, points: Floats, pose: Pose) -> float:
    """0 to 1: the mean likelihood of points, [N, 2] m, at a pose in the submap's frame."""
    angles = np.array([pose.theta])
    cells = _rotated_cells(points, np.array([pose.x, pose.y]), angles, submap.corner)
    return _score(submap.likelihood[0], cells[0], 0, 0) / (len(points) * FULL)


@kernel
def _search(
    likelihood: NDArray[np.uint8],
    corner: NDArray[np.int64],
    points: Floats,
    centre: Floats,
    angles: Floats,
    cells: int,
    rivalry: float,
    apart: Floats,
) -> tuple[NDArray[np.int64], float, float]:
    """Best-first search over squares of the window.

    Args:
        likelihood: [L, H, W], a submap's levels.
        corner: [2], a submap's.
        points: [N, 2] m.
        centre: [2] m, the window's.
        angles: [A] rad.
        cells: The window, to either side.
        rivalry: As in `correlate`.
        apart: [2] cells and angle steps between peaks.

    Returns:
        [3] angle's index, columns and rows from the centre; response; rival's response.
    """
    count, top = len(points), len(LEVELS) - 1
    rotated = _rotated_cells(points, centre, angles, corner)
    side = 2 * cells // LEVELS[top] + 1
    nodes = len(angles) * side * side
    bounds = np.empty(nodes)
    for node in range(nodes):
        a, row, column = node // (side * side), (node // side) % side, node % side
        bounds[node] = _score(likelihood[top], rotated[a], column * LEVELS[top] - cells, row * LEVELS[top] - cells) / (
            count * FULL
        )
    best, best_weighed, best_response = np.zeros(3, np.int64), -1.0, 0.0
    peaks = np.empty((nodes, 4))  # angle's index, columns, rows, response: the best leaf of each node that was opened
    opened = 0
    leaf = np.empty(4)
    for node in np.argsort(-bounds, kind="mergesort"):
        if bounds[node] < rivalry * best_weighed:
            break
        a, row, column = node // (side * side), (node // side) % side, node % side
        turned = (a - len(angles) // 2) / max(len(angles) // 2, 1)
        _open(
            likelihood,
            rotated[a],
            column * LEVELS[top] - cells,
            row * LEVELS[top] - cells,
            cells,
            turned,
            rivalry * best_weighed,
            leaf,
        )
        if leaf[3] < 0.0:
            continue
        peaks[opened, 0], peaks[opened, 1:] = a, leaf[:3]
        opened += 1
        if leaf[3] > best_weighed:
            best[0], best[1], best[2] = a, int(leaf[0]), int(leaf[1])
            best_weighed, best_response = leaf[3], leaf[2]
    rival = 0.0
    for n in range(opened):
        moved = math.hypot(peaks[n, 1] - best[1], peaks[n, 2] - best[2])
        if (moved > apart[0] or abs(peaks[n, 0] - best[0]) > apart[1]) and peaks[n, 3] > rival:
            rival = peaks[n, 3]
    return best, best_response, rival


@kernel
def _open(
    likelihood: NDArray[np.uint8],
    rotated: NDArray[np.int32],
    column: int,
    row: int,
    cells: int,
    turned: float,
    threshold: float,
    leaf: Floats,
) -> None:
    """Write the best pose of a square of the coarsest level into ``leaf``: columns, rows, response, and response
    weighed by the prior; the last is negative if none is above the threshold.
    """
    scale = 1.0 / (len(rotated) * FULL)
    top = LEVELS[len(LEVELS) - 1]
    middle = LEVELS[1]
    leaf[3] = -1.0
    for row_1 in range(row, min(row + top, cells + 1), middle):
        for column_1 in range(column, min(column + top, cells + 1), middle):
            bound = _score(likelihood[1], rotated, column_1, row_1) * scale
            if bound < threshold or bound <= leaf[3]:
                continue
            for row_0 in range(row_1, min(row_1 + middle, cells + 1)):
                for column_0 in range(column_1, min(column_1 + middle, cells + 1)):
                    response = _score(likelihood[0], rotated, column_0, row_0) * scale
                    off = (column_0 * column_0 + row_0 * row_0) / max(cells * cells, 1) + turned * turned
                    weighed = response * (1.0 - PRIOR_WEIGHT * 4.5 * off)  # the window's edge is three σ away
                    if weighed >= threshold and weighed > leaf[3]:
                        leaf[0], leaf[1], leaf[2], leaf[3] = column_0, row_0, response, weighed


@kernel
def _rotated_cells(points: Floats, centre: Floats, angles: Floats, corner: NDArray[np.int64]) -> NDArray[np.int32]:
    """[A, N, 2] column and row of each point, turned by each angle and moved to the centre."""
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
    """Sum of the likelihoods of cells [N, 2] moved by whole columns and rows; 0 outside."""
    height, width = layer.shape
    total = 0
    for n in range(len(cells)):
        column, row = cells[n, 0] + columns, cells[n, 1] + rows
        if 0 <= column < width and 0 <= row < height:
            total += layer[row, column]
    return total
