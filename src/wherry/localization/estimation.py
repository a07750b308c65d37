"""The filter's estimate: mean and covariance of the dominant cluster of particles, matched to the map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wherry.localization.clusters import dominant_cluster
from wherry.localization.particles import ParticleSet
from wherry.localization.refinement import MAX_MATCHED_BEAMS, is_within_gate, match_scan
from wherry.localization.resampling import Integers
from wherry.localization.sensor import Beams
from wherry.space.distance_field import DistanceField
from wherry.space.pose import Floats, Pose

UNIMODAL_MIN_WEIGHT = 0.8  # posterior weight of the dominant cluster above which the posterior is unimodal
UNIMODAL_MAX_DEVIATION = 1.0  # m, standard deviation of the position below which the posterior is unimodal
MATCH_MIN_INLIER_GAIN = 0.02  # inlier fraction by which the match of a later start must exceed that of an earlier one
SAME_START_DISTANCE, SAME_START_ANGLE = 0.03, 0.01  # m, rad, from an earlier match within which a start is skipped


@dataclass(frozen=True, slots=True)
class PoseEstimate:
    """Estimated pose of the robot on the map.

    Attributes:
        time: Time of the scan, s.
        pose: Pose of base_link, map frame.
        covariance: [3, 3] m, m, rad, covariance of the dominant cluster of particles.
        weight: Posterior weight of the dominant cluster, 0 to 1.
        particle_count: Number of particles.
        likelihood: Geometric mean of the beams' likelihoods, averaged over the particles, at the last filter update.
        is_updated: Whether the filter was updated with this scan; otherwise the pose is moved on by odometry.
        problem: Why the measurement was not used; empty if it was.
    """

    time: float
    pose: Pose
    covariance: Floats
    weight: float
    particle_count: int
    likelihood: float
    is_updated: bool
    problem: str = ""

    @property
    def is_unimodal(self) -> bool:
        """Whether the dominant cluster holds most of the posterior weight and is compact."""
        variance = float(np.trace(self.covariance[:2, :2]))
        return self.weight > UNIMODAL_MIN_WEIGHT and variance < UNIMODAL_MAX_DEVIATION**2

    def moved(self, motion: Pose, time: float) -> PoseEstimate:
        """The estimate moved on by odometry, without a filter update.

        Args:
            motion: Pose of base_link relative to its pose at this estimate.
            time: Time of the new scan, s.
        """
        return replace(self, time=time, pose=self.pose @ motion, is_updated=False, problem="")


def cluster_estimate(particles: ParticleSet, time: float, likelihood: float, table: Integers) -> PoseEstimate:
    """The estimate after a filter update: the dominant cluster's mean and covariance.

    Args:
        particles: The reweighted particles.
        time: Time of the scan, s.
        likelihood: The scan's likelihood, see `PoseEstimate`.
        table: Scratch memory from `resampling.hash_table` for at least as many bins as there are particles.
    """
    cluster = dominant_cluster(particles.poses, particles.weights, table)
    return PoseEstimate(
        time, cluster.mean, cluster.covariance, cluster.weight, len(particles), likelihood, is_updated=True
    )


def match_estimate(
    estimate: PoseEstimate, starts: Sequence[Pose], beams: Beams, field: DistanceField, sigma: float
) -> PoseEstimate:
    """Match the estimate to the map with all beams.

    A pose that was matched before is more precise than the particles' mean. It is therefore the first start while it is
    within the particles' gate, and its match is kept unless that of another start has more inliers.

    Args:
        estimate: The particles' estimate; starts and matches outside of its gate are rejected.
        starts: Start poses of the matching, map frame, in order of preference.
        beams: All beams of the scan.
        field: Distances to the map's obstacles.
        sigma: Standard deviation σ of the beam ends around the obstacles, m.
    """
    ends = beams.evenly_spaced(MAX_MATCHED_BEAMS).ends
    gated = [pose for pose in starts if is_within_gate(pose, estimate.pose, estimate.covariance)]
    best, best_inliers = estimate.pose, -1.0
    for start in gated:
        if best_inliers >= 0.0 and start.is_near(best, SAME_START_DISTANCE, SAME_START_ANGLE):
            continue
        match = match_scan(field, ends, start, estimate.covariance, sigma)
        if match.inlier_fraction > best_inliers + MATCH_MIN_INLIER_GAIN:
            best, best_inliers = match.pose, match.inlier_fraction
    return replace(estimate, pose=best)
