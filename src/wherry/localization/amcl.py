"""Adaptive Monte Carlo localization: propagate, reweight, resample (paper, section 5; Fox et al., 1999)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wherry.errors import InputError
from wherry.localization.adaptive_resampling import AdaptiveResampler
from wherry.localization.estimation import PoseEstimate, cluster_estimate, match_estimate
from wherry.localization.initialization import FreeSpace, PoseMode, draw_from_modes
from wherry.localization.measurement import MeasurementUpdate
from wherry.localization.motion import MotionUpdate
from wherry.localization.odometry_monitor import OdometryMonitor, UpdatePolicy
from wherry.localization.parameters import AmclParameters
from wherry.localization.particles import ParticleSet
from wherry.localization.resampling import hash_table, low_variance_resample
from wherry.localization.sensor import Beams, valid_beams
from wherry.robot import Odometry, Scan
from wherry.space.distance_field import DistanceField
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose, wrap_angles

NO_READINGS = "the scan has no readings"


class Amcl:
    """A particle filter over poses on a known map.

    Args:
        grid: The map.
        lidar: The lidar's pose, base_link frame.
        parameters: The filter's parameters, as in nav2's amcl.
        rng: Source of all randomness; the same seed gives the same bytes.

    Attributes:
        parameters: The filter's parameters.
        field: Distances to the map's obstacles.
    """

    def __init__(self, grid: OccupancyGrid, lidar: Pose, parameters: AmclParameters, rng: np.random.Generator) -> None:
        p = parameters
        bins = hash_table(p.max_particles)
        self.parameters = p
        self.field = DistanceField.of(grid, p.laser_likelihood_max_dist)
        self._lidar = lidar
        self._rng = rng
        self._bins = bins
        self._free_space = FreeSpace(grid)
        self._odometry = OdometryMonitor(p.max_odometry_speed)
        self._update_policy = UpdatePolicy(p.update_min_d, p.update_min_a)
        self._motion = MotionUpdate(p, rng)
        self._measurement = MeasurementUpdate(self.field, p, rng)
        self._resampler = AdaptiveResampler(self._free_space, p, bins, rng)
        self._particles: ParticleSet
        self._estimate: PoseEstimate
        self.initialize(p.initial_pose, np.diag(p.initial_covariance))

    @property
    def particles(self) -> Floats:
        """[N, 3] m, m, rad, map frame."""
        return self._particles.poses.copy()

    @property
    def weights(self) -> Floats:
        """[N] importance weights of the particles, summing to 1."""
        return self._particles.weights.copy()

    def initialize(self, pose: Pose, covariance: Floats) -> None:
        """Draw all particles from a Gaussian.

        Args:
            pose: Mean pose of base_link, map frame.
            covariance: [3, 3] m, m, rad.

        Raises:
            InputError: Pose or covariance is not finite, or the covariance has a negative eigenvalue.
        """
        poses = PoseMode(pose, covariance, 1.0).draw(self.parameters.max_particles, self._rng)
        self._restart(poses, pose, weight=1.0)

    def initialize_modes(
        self, modes: Sequence[PoseMode], *, uniform_weight: float = 0.0, prior_weight: float = 0.0
    ) -> None:
        """Draw the particles from a mixture of Gaussian modes, of free space and of the current particles.

        Args:
            modes: The modes, at least one; they share the weight that the two other components leave.
            uniform_weight: Weight of the uniform distribution over the map's free space, 0 to 1.
            prior_weight: Weight of the current particles, 0 to 1.
        """
        total = self.parameters.max_particles
        prior_count = round(total * prior_weight)
        uniform_count = 0 if self._free_space.is_empty else round(total * uniform_weight)
        drawn = draw_from_modes(modes, total - prior_count - uniform_count, self._rng)
        prior = np.empty((prior_count, 3))
        low_variance_resample(self._particles.poses, self._particles.weights, self._rng.random(), prior)
        uniform = self._free_space.draw(uniform_count, self._rng)
        weights = np.array([mode.weight for mode in modes])
        dominant = float(weights.max() / weights.sum()) * (1.0 - prior_weight - uniform_weight)
        pose = self._estimate.pose if prior_weight > dominant else modes[int(weights.argmax())].pose
        self._restart(np.vstack([prior, drawn, uniform]), pose, weight=max(prior_weight, dominant))

    def initialize_globally(self) -> None:
        """Draw the particles uniformly from the map's free space.

        Raises:
            InputError: The map has no free space.
        """
        if self._free_space.is_empty:
            raise InputError("map", "", "has no free space to draw particles from")
        poses = self._free_space.draw(self.parameters.max_particles, self._rng)
        self._restart(poses, Pose.from_array(poses[0]), weight=0.0)

    def request_update(self) -> None:
        """Update the filter with the next scan even if the robot has not moved (nav2's request_nomotion_update)."""
        self._update_policy.request()

    def update(self, odometry: Odometry, scan: Scan, beams: Beams | None = None) -> PoseEstimate:
        """Process one scan and the odometry of the same instant.

        The filter is updated when the robot has moved update_min_d or turned update_min_a; in between, the last
        estimate is moved on by odometry. An unusable measurement is ignored, and ``problem`` gives the reason.

        Args:
            odometry: Pose of base_link in the odom frame when the scan was taken.
            scan: The scan.
            beams: The scan's valid beams; None to select them here by `sensor.valid_beams`.

        Returns:
            The pose of base_link in the map frame when the scan was taken, never NaN.
        """
        problem = self._odometry.rejection(odometry, scan)
        if problem:
            return replace(self._estimate, is_updated=False, problem=problem)
        problem = self._odometry.absorb_jump(odometry)
        beams = valid_beams(scan, self._lidar, self.parameters) if beams is None else beams
        predicted = self._estimate.moved(self._odometry.since_last_scan(odometry), scan.time)
        if not len(beams):
            self._estimate = replace(predicted, problem=NO_READINGS)
        elif self._update_policy.is_due(self._odometry.since_last_update(odometry)):
            self._estimate = self._filter(odometry, beams, predicted)
        else:
            self._estimate = self._matched(predicted, [predicted.pose], beams)
        self._odometry.mark_scan(odometry, scan)
        return replace(self._estimate, problem=problem) if problem else self._estimate

    def _filter(self, odometry: Odometry, beams: Beams, predicted: PoseEstimate) -> PoseEstimate:
        """Propagate, reweight, estimate, resample."""
        propagated = self._motion.propagate(self._particles, self._odometry.since_last_update(odometry))
        self._odometry.mark_update(odometry)
        self._update_policy.mark_update()
        spaced = beams.evenly_spaced(self.parameters.max_beams)
        reweighted, likelihood = self._measurement.reweight(propagated, spaced, is_unimodal=self._estimate.is_unimodal)
        estimate = cluster_estimate(reweighted, predicted.time, likelihood, self._bins)
        self._particles = self._resampler.resample(reweighted, likelihood)
        return self._matched(estimate, [predicted.pose, estimate.pose], beams)

    def _matched(self, estimate: PoseEstimate, starts: Sequence[Pose], beams: Beams) -> PoseEstimate:
        """The estimate matched to the map, if the parameters ask for it."""
        if not self.parameters.refine:
            return estimate
        return match_estimate(estimate, starts, beams, self.field, self.parameters.refine_sigma)

    def _restart(self, poses: Floats, estimate: Pose, weight: float) -> None:
        """Replace the particles.

        Args:
            poses: [N, 3] m, m, rad, poses of equally weighted particles, map frame.
            estimate: The estimated pose, map frame.
            weight: Posterior weight around the estimated pose, 0 to 1.
        """
        wrapped = poses.copy()
        wrapped[:, 2] = wrap_angles(poses[:, 2])
        self._particles = ParticleSet.uniform(wrapped)
        self._resampler.reset()
        self._update_policy.request()
        self._estimate = PoseEstimate(
            self._odometry.scan_time, estimate, np.cov(poses.T), weight, len(poses), 0.0, is_updated=False
        )
