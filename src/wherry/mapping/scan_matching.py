"""One scan placed on a submap: found by correlation, made exact by Gauss–Newton, held by what odometry expects."""

from __future__ import annotations

import math

import numpy as np

from wherry.mapping.cloud import Cloud
from wherry.mapping.correlative import Window, correlate, response_at
from wherry.mapping.motion_prior import MotionNoise
from wherry.mapping.refinement import Refinement, refine
from wherry.mapping.submap import Submap
from wherry.space.pose import Pose

LEAST_POINTS = 20  # fewer tell nothing
LEAST_RESPONSE = 0.2  # of a search; below, odometry is believed; a scan taken 2 m on may be mostly new
LEAST_MATCHED = 0.5  # of surfaces, where a scan is tracked from odometry alone
SEARCHED = 3.0  # σ of odometry that are searched
POINTS = 180  # of a scan, for finding its place
REFINED, REFINED_ANGLE = 0.06, math.radians(1.5)  # m and rad; refining a match by more must not make it worse
MOST_LOSS = 0.02  # of response that it may cost
SEARCH_NOISE, SEARCH_NOISE_ANGLE = 0.05, math.radians(0.7)  # m and rad, σ of a match that was not refined


def find_scan(submap: Submap, cloud: Cloud, expected: Pose, movement: Pose, noise: MotionNoise) -> Refinement | None:
    """Search for a scan all around where it is expected.

    Args:
        submap: What to match to.
        cloud: The scan, in the base_link frame.
        expected: Pose of base_link in the submap's frame.
        movement: What led there since the last pose that was matched.
        noise: How sure the movement is.

    Returns:
        Its pose; None if it fits nowhere.
    """
    if len(cloud.points) < LEAST_POINTS:
        return None
    distance, angle = noise.deviations(movement)
    window = Window(expected, SEARCHED * distance, SEARCHED * angle)
    found = correlate(submap, cloud.thinned(POINTS).points, window)
    if found.response < LEAST_RESPONSE:
        return None
    match = refine(submap, cloud, found.pose, expected=expected, prior=noise.information(movement))
    moved = match.pose.relative_to(found.pose)
    if math.hypot(moved.x, moved.y) < REFINED and abs(moved.theta) < REFINED_ANGLE:
        return match
    loss = response_at(submap, cloud.points, found.pose) - response_at(submap, cloud.points, match.pose)
    if loss <= MOST_LOSS:
        return match
    # The surfaces lead astray, as they may where there are few: what fits the points as a whole is believed.
    known = np.diag([SEARCH_NOISE**-2, SEARCH_NOISE**-2, SEARCH_NOISE_ANGLE**-2])
    return Refinement(found.pose, known, match.matched, match.residual)


def track_scan(submap: Submap, cloud: Cloud, expected: Pose, movement: Pose, noise: MotionNoise) -> Refinement | None:
    """Refine where a scan is expected, without a search; arguments as in `find_scan`.

    Returns:
        Its pose; None if it does not fit there.
    """
    if len(cloud.points) < LEAST_POINTS:
        return None
    match = refine(submap, cloud, expected, expected=expected, prior=noise.information(movement))
    distance, _ = noise.deviations(movement)
    fits = match.matched >= LEAST_MATCHED and match.pose.distance_to(expected) <= SEARCHED * distance
    return match if fits else None
