"""Wheel slip: a robot that is not where odometry predicts, but close by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wherry.localization.agreement import ScanAgreement, ScanComparison
from wherry.localization.estimation import PoseEstimate
from wherry.localization.refinement import ScanMatch, match_scan
from wherry.space.pose import Floats, Pose

SLIP_MIN_Z_SCORE = 3.0  # standard deviations of a scan's evidence above the baseline from which it is an outlier
SLIP_MIN_GAIN = 0.5  # gain of mean log likelihood per beam over the estimate
SLIP_COVARIANCE = np.diag([0.2**2, 0.2**2, 0.15**2])  # m², m², rad², of the error that slip adds between two scans
SLIP_STARTS = tuple(  # start poses of the scan matching, relative to the estimate; m, m, rad
    Pose(*offset)
    for offset in ((0.0, 0.0), (0.3, 0.0), (-0.3, 0.0), (0.0, 0.3), (0.0, -0.3), (0.0, 0.0, 0.2), (0.0, 0.0, -0.2))
)


@dataclass(frozen=True, slots=True)
class SlipMatch:
    """The best match of a scan near an estimate.

    Attributes:
        match: The match.
        agreement: Agreement of the scan with the map at its pose.
    """

    match: ScanMatch
    agreement: ScanAgreement


def match_after_slip(estimate: PoseEstimate, ends: Floats, comparison: ScanComparison, sigma: float) -> SlipMatch:
    """Match a scan to the map from several starts around an estimate, and return the match that agrees best.

    Args:
        estimate: Estimate of the particle filter.
        ends: [B, 2] m, ends of the beams, base_link frame.
        comparison: Compares scans with the map.
        sigma: Standard deviation of the beam ends around the obstacles, m.
    """
    covariance = estimate.covariance + SLIP_COVARIANCE
    found = []
    for offset in SLIP_STARTS:
        start = estimate.pose @ offset
        match = match_scan(comparison.field, ends, estimate.pose, covariance, sigma, start=start)
        found.append(SlipMatch(match, comparison.agreement(ends, match.pose)))
    return max(found, key=lambda one: one.agreement.log_likelihood)
