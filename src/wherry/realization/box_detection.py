"""Detection of cylindrical boxes in a lidar scan: segmentation and a circle fit of known radius (paper, Fig. 3)."""

from __future__ import annotations

import math

import numpy as np

from wherry.robot import Scan
from wherry.space.pose import Floats

# Tuned for range noise of about 1 cm and to reject door jambs and wall ends, which are flat or part of a surface.
MAX_DETECTION_RANGE = 2.2  # m; at 1° per beam a box of radius 10 cm is hit by fewer than MIN_BEAMS beams beyond it
MIN_BEAMS = 5  # beams that must hit a cylinder
MIN_FOREGROUND_DEPTH = 0.12  # m from the cylinder's nearest point to the background on both sides
MAX_FIT_RESIDUAL = 0.02  # m, root mean square distance of a segment's points from the fitted circle
MIN_CHORD_RATIO = 1.2  # length of a segment's chord ÷ radius of the cylinder
FIT_ITERATIONS = 6  # Levenberg–Marquardt steps with constant damping
FIT_DAMPING = 1e-3  # added to the normal matrix, so that the centre of a nearly straight segment does not diverge


def detect_cylinders(scan: Scan, radius: float) -> Floats:
    """Find the cylinders of a known radius in a scan.

    The scan is split into segments at range discontinuities. A segment is a cylinder if it is in front of its
    background on both sides, has the width of a cylinder, and fits a circle of the radius.

    Args:
        scan: A scan of 360°.
        radius: Radius of the cylinders, m.

    Returns:
        [K, 2] centres, m, lidar frame.
    """
    ranges = np.where(scan.valid, scan.ranges, np.inf)
    fits = [_fit_segment(scan, ranges, start, end, radius) for start, end in _segments(ranges)]
    centres = [centre for centre in fits if centre is not None]
    return np.array(centres) if centres else np.empty((0, 2))


def _segments(ranges: Floats) -> list[tuple[int, int]]:
    """First and one-past-last beam of each segment with enough beams in range; the first index may be negative."""
    following = np.roll(ranges, -1)
    with np.errstate(invalid="ignore"):
        jumps = ~(np.abs(following - ranges) < MIN_FOREGROUND_DEPTH / 2)  # inf - inf is NaN and counts as a jump
    lasts = np.flatnonzero(jumps)
    if len(lasts) < 2:
        return []
    firsts = np.roll(lasts, 1) + 1
    firsts[0] -= len(ranges)  # the segment that wraps around beam 0 starts at a negative index
    is_candidate = (lasts - firsts + 1 >= MIN_BEAMS) & (ranges[firsts] < MAX_DETECTION_RANGE + MIN_FOREGROUND_DEPTH)
    return list(zip(firsts[is_candidate].tolist(), (lasts[is_candidate] + 1).tolist(), strict=True))


def _fit_segment(scan: Scan, ranges: Floats, start: int, end: int, radius: float) -> Floats | None:
    """[2] centre, m, lidar frame, of the cylinder in beams ``start`` to ``end`` − 1; None if there is none."""
    beams = np.arange(start, end)
    distances = ranges[beams]
    background = np.array([ranges[start - 1], ranges[end % len(ranges)]])
    if np.any(background < distances[[0, -1]] + MIN_FOREGROUND_DEPTH / 2):
        return None
    if np.any(background < distances.min() + MIN_FOREGROUND_DEPTH):
        return None
    angles = scan.angle_min + scan.angle_increment * beams
    points = np.column_stack([distances * np.cos(angles), distances * np.sin(angles)])
    chord = float(np.hypot(*(points[-1] - points[0])))
    if not MIN_CHORD_RATIO * radius <= chord <= 2 * radius + 2 * MAX_FIT_RESIDUAL:
        return None
    return _fit_circle(points, radius)


def _fit_circle(points: Floats, radius: float) -> Floats | None:
    """[2] centre, m, of the circle of known radius through points [N, 2], m; None if the residual is too large."""
    nearest = points[np.argmin(np.hypot(points[:, 0], points[:, 1]))]
    centre = nearest * (1 + radius / np.hypot(*nearest))  # the initial guess lies behind the nearest point
    residuals = np.empty(len(points))
    for _ in range(FIT_ITERATIONS):
        offsets = centre - points
        lengths = np.maximum(np.hypot(offsets[:, 0], offsets[:, 1]), 1e-9)
        residuals = lengths - radius
        jacobian = offsets / lengths[:, None]
        normal = jacobian.T @ jacobian + FIT_DAMPING * np.eye(2)
        centre = centre - np.linalg.solve(normal, jacobian.T @ residuals)
    return centre if math.sqrt(float(np.mean(residuals**2))) <= MAX_FIT_RESIDUAL else None
