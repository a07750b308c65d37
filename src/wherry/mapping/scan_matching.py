"""One scan placed on a submap: found by correlation, made exact by Gauss–Newton, held by what odometry expects."""

from __future__ import annotations

import math

import numpy as np

from wherry.mapping.cloud import Cloud
from wherry.mapping.correlative import Window, correlate, response_at
from wherry.mapping.motion_prior import MotionNoise
from wherry.mapping.refinement import Refinement, refine
from wherry.mapping.submap import Submap
from wherry.mapping.uncertainty import inverse
from wherry.space.pose import Floats, Pose, wrap

LEAST_POINTS = 20  # fewer tell nothing
LEAST_RESPONSE = 0.2  # of a search; below, odometry is believed; a scan taken 2 m on may be mostly new
LEAST_MATCHED = 0.5  # of surfaces, where a scan is tracked from odometry alone
SEARCHED = 3.0  # σ of odometry that are searched
# Where less than this fits, it is searched farther, in m and rad: wheels slip. The place found there must fit clearly
# better, for in a corridor some place farther on fits as well.
FITTING, CLEARLY = 0.45, 0.1  # of a search's response
SLIP, SLIP_ANGLE = 0.5, math.radians(20.0)
POINTS = 180  # of a scan, for finding its place
REFINED_ANGLE = math.radians(1.5)  # rad; turning a match by more must not make it worse
MOST_LOSS = 0.02  # of response that it may cost
SEARCH_COVARIANCE = np.diag([0.05**2, 0.05**2, math.radians(0.7) ** 2])  # m, m, rad, of a match that was not refined


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
    points = cloud.thinned(POINTS).points
    found = correlate(submap, points, window)
    if found.response < FITTING:
        wider = Window(expected, max(window.distance, SLIP), max(window.angle, SLIP_ANGLE))
        farther = correlate(submap, points, wider)
        found = farther if farther.response > found.response + CLEARLY else found
    if found.response < LEAST_RESPONSE:
        return None
    prior = noise.information(movement)
    match = refine(submap, cloud, found.pose, expected=expected, prior=prior)
    if abs(match.pose.relative_to(found.pose).theta) < REFINED_ANGLE:
        return match
    loss = response_at(submap, cloud.points, found.pose) - response_at(submap, cloud.points, match.pose)
    return match if loss <= MOST_LOSS else _held(found.pose, match, expected, prior)


def _held(found: Pose, match: Refinement, expected: Pose, prior: Floats) -> Refinement:
    """The place that the search found, held by odometry where the points do not hold it.

    Where surfaces are few they may lead the refinement astray; how well they hold a pose they tell all the same.
    """
    covariance = SEARCH_COVARIANCE + inverse(match.information + np.eye(3))
    information = inverse(covariance)
    off = expected.as_array() - found.as_array()
    off[2] = wrap(off[2])
    pose = found.as_array() + inverse(information + prior) @ prior @ off
    return Refinement(Pose.from_array(pose), information, match.matched, match.residual)


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
