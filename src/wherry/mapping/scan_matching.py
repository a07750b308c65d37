"""Matching of one scan to a grid: correlative search, then refinement, with the predicted motion as prior."""

from __future__ import annotations

import math

import numpy as np

from wherry.mapping.correlative import Correlation, SearchWindow, correlate, score_at
from wherry.mapping.covariances import invert, regularized_inverse
from wherry.mapping.matching_grid import MatchingGrid
from wherry.mapping.motion_noise import MotionNoise
from wherry.mapping.point_cloud import PointCloud
from wherry.mapping.refinement import Refinement, refine
from wherry.space.pose import Floats, Pose, wrap

MIN_POINTS = 20  # points that a scan must have to be matched
MIN_SCORE = 0.2  # score below which a match is rejected; low, since most of a scan may show unmapped space
MIN_OVERLAP = 0.5  # share of the points that must be inliers of a refinement without a search
SEARCH_SIGMAS = 3.0  # standard deviations of the predicted motion to either side of the search window
SEARCH_POINTS = 180  # points of a scan that are used in the search
SLIP_SCORE = 0.45  # score below which wheel slip is assumed and a wider window is searched
SLIP_DISTANCE, SLIP_ANGLE = 0.5, math.radians(20.0)  # m and rad, extent of the wider window to either side
SLIP_MIN_GAIN = 0.1  # gain of the score that the wider window must bring, since corridors look alike along their length
MAX_UNCHECKED_TURN = math.radians(1.5)  # rad by which a refinement may turn a pose before its score is checked
MAX_SCORE_LOSS = 0.02  # score that a refinement with a larger turn may lose
# Error of a match by its distance from the submap's origin. It is added to the covariance from the points, which is too
# small because surfaces are rough and the robot moves during a scan.
MATCH_SIGMA, MATCH_SIGMA_PER_DISTANCE = 0.01, 0.005  # m, m/m
MATCH_ANGLE_SIGMA, MATCH_ANGLE_SIGMA_PER_DISTANCE = math.radians(0.2), math.radians(0.03)  # rad, rad/m
SEARCH_COVARIANCE = np.diag([0.05**2, 0.05**2, math.radians(0.7) ** 2])  # m, m, rad, of a pose found by search alone


def find_scan(
    grid: MatchingGrid, cloud: PointCloud, expected: Pose, motion: Pose, noise: MotionNoise
) -> Refinement | None:
    """Search for the pose of a scan around the expected one, and refine it.

    Args:
        grid: The grid to match to.
        cloud: Points of the scan in the base_link frame.
        expected: Expected pose of base_link in the grid's frame.
        motion: Motion since the last matched pose.
        noise: Noise of that motion.

    Returns:
        The pose with its information; None if the scan fits at no pose of the search window.
    """
    if len(cloud.points) < MIN_POINTS or grid.is_empty:
        return None
    found = _search(grid, cloud, expected, motion, noise)
    if found.score < MIN_SCORE:
        return None
    prior_information = noise.information(motion)
    match = refine(grid, cloud, found.pose, prior=expected, prior_information=prior_information)
    if abs(match.pose.relative_to(found.pose).theta) < MAX_UNCHECKED_TURN:
        return match
    loss = score_at(grid, cloud.points, found.pose) - score_at(grid, cloud.points, match.pose)
    return match if loss <= MAX_SCORE_LOSS else _fused_with_prior(found.pose, match, expected, prior_information)


def track_scan(
    grid: MatchingGrid, cloud: PointCloud, expected: Pose, motion: Pose, noise: MotionNoise
) -> Refinement | None:
    """Refine the expected pose of a scan without a search; arguments as in `find_scan`.

    Returns:
        The pose with its information; None if the scan does not fit at the expected pose.
    """
    if len(cloud.points) < MIN_POINTS:
        return None
    match = refine(grid, cloud, expected, prior=expected, prior_information=noise.information(motion))
    distance, _ = noise.deviations(motion)
    is_consistent = match.pose.distance_to(expected) <= SEARCH_SIGMAS * distance
    return match if match.overlap >= MIN_OVERLAP and is_consistent else None


def match_covariance(pose: Pose) -> Floats:
    """Covariance to add to that of the points, [3, 3] m, m, rad, of a match at a pose on a submap."""
    distance = math.hypot(pose.x, pose.y)
    sigma = MATCH_SIGMA + MATCH_SIGMA_PER_DISTANCE * distance
    angle_sigma = MATCH_ANGLE_SIGMA + MATCH_ANGLE_SIGMA_PER_DISTANCE * distance
    return np.diag([sigma**2, sigma**2, angle_sigma**2])


def _search(grid: MatchingGrid, cloud: PointCloud, expected: Pose, motion: Pose, noise: MotionNoise) -> Correlation:
    """The best pose in the window that the motion's noise allows, or in a wider one if the wheels have slipped."""
    distance, angle = noise.deviations(motion)
    window = SearchWindow(expected, SEARCH_SIGMAS * distance, SEARCH_SIGMAS * angle)
    points = cloud.subsampled(SEARCH_POINTS).points
    found = correlate(grid, points, window)
    if found.score >= SLIP_SCORE:
        return found
    wider = SearchWindow(expected, max(window.distance, SLIP_DISTANCE), max(window.angle, SLIP_ANGLE))
    farther = correlate(grid, points, wider)
    return farther if farther.score > found.score + SLIP_MIN_GAIN else found


def _fused_with_prior(found: Pose, match: Refinement, expected: Pose, prior_information: Floats) -> Refinement:
    """The pose of the search fused with the prior, for scans with too few surfaces to refine the pose.

    The information of the refinement is still valid: it shows in which directions the points determine the pose.
    """
    covariance = SEARCH_COVARIANCE + regularized_inverse(match.information)
    information = invert(covariance)
    offset = expected.as_array() - found.as_array()
    offset[2] = wrap(offset[2])
    pose = found.as_array() + invert(information + prior_information) @ prior_information @ offset
    return Refinement(Pose.from_array(pose), information, match.overlap, match.residual)
