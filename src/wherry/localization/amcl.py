"""Adaptive Monte Carlo localization: propagate, reweight, resample (paper, section 5; Fox et al., 1999)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wherry.errors import InputError
from wherry.localization.clusters import heaviest_cluster
from wherry.localization.motion import MOTION_MODELS
from wherry.localization.parameters import AmclParameters
from wherry.localization.proposal import draw_around_match
from wherry.localization.recovery import RecoveryAverages
from wherry.localization.refinement import agrees, match_scan
from wherry.localization.resampling import (
    BIN_SIZE,
    adaptive_count,
    hash_table,
    log_sum,
    low_variance,
    normalize,
    tempering,
)
from wherry.localization.sensor import SENSOR_MODELS, Beams, choose_beams
from wherry.robot import Odometry, Scan
from wherry.space.distance_field import DistanceField
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose

Floats = NDArray[np.float64]

MATCHED_BEAMS = 360  # more do not make the match better
ONE_PLACE = 0.8  # share of the belief that is in the heaviest cluster, and
PLACE_SIZE = 1.0  # m, its standard deviation, where the belief is called to be at one place
AT_ONE_PLACE = 0.1  # of least_effective is enough there: nothing else has to be kept alive
BETTER = 0.02  # share of the beams that a match must explain more, to be preferred to one that goes on smoothly
NEAR, NEAR_HEADING = 0.03, 0.01  # m, rad: matches from so near to a match come to the same place
JUMP_SLACK = 0.5  # m; odometry is not called a jump below this


@dataclass(frozen=True, slots=True)
class Estimate:
    """Where the robot is believed to be.

    Attributes:
        time: s, the scan's.
        pose: base_link in the map frame.
        covariance: [3, 3] m, m, rad, of the heaviest cluster of particles.
        weight: That cluster's share of the belief, 0 to 1.
        particles: How many carry the belief.
        likelihood: Geometric mean of the beams' likelihoods, averaged over the particles, at the last filter update.
        updated: Whether this scan was weighed; otherwise the robot had hardly moved since the last one that was.
        problem: Why the measurement was not used; empty when it was.
    """

    time: float
    pose: Pose
    covariance: Floats
    weight: float
    particles: int
    likelihood: float
    updated: bool
    problem: str = ""

    @property
    def is_at_one_place(self) -> bool:
        """Whether nearly all of the belief is around the pose; a heaviest cluster may also be spread over the map."""
        return self.weight > ONE_PLACE and float(np.trace(self.covariance[:2, :2])) < PLACE_SIZE**2


class Amcl:
    """A particle filter over poses on a known map.

    Args:
        grid: The map.
        lidar: The lidar's pose on the base, base_link frame.
        parameters: As in nav2's amcl.
        rng: Where all randomness comes from; the same seed gives the same bytes.

    Attributes:
        parameters: As given.
        field: Distances to the map's obstacles.
    """

    def __init__(self, grid: OccupancyGrid, lidar: Pose, parameters: AmclParameters, rng: np.random.Generator) -> None:
        self.parameters = parameters
        self._grid = grid
        self._lidar = lidar
        self._rng = rng
        self.field = DistanceField.of(grid, parameters.laser_likelihood_max_dist)
        self._sensor = SENSOR_MODELS[parameters.laser_model_type](self.field, parameters)
        self._move = MOTION_MODELS[parameters.robot_model_type]
        most = parameters.max_particles
        self._buffers = (np.empty((most, 3)), np.empty((most, 3)))
        self._noise = np.empty((most, 4 if parameters.turn_slip else 3), np.float32)
        self._log_weights = np.empty(most)
        self._increments = np.empty(most)
        self._weights = np.empty(most)
        self._table = hash_table(most)
        self._bin_size = np.array(BIN_SIZE)
        p = parameters
        self._limits = np.array([p.pf_err, p.pf_z, p.min_particles, p.max_particles], np.float64)
        self._free = np.flatnonzero(grid.free)
        self._recovery = RecoveryAverages(parameters.recovery_alpha_slow, parameters.recovery_alpha_fast)
        self._seen: Odometry | None = None
        self._reference: Pose | None = None  # the odometry's pose at the last filter update
        self._time = -math.inf
        self._count = 0
        self._updates = 0
        self._likelihood = 0.0
        self._forced = True
        self._evenly_weighted = True
        self._estimate = Estimate(self._time, parameters.initial_pose, np.eye(3), 1.0, 0, 0.0, updated=False)
        self.initialize(parameters.initial_pose, np.diag(parameters.initial_covariance))

    @property
    def particles(self) -> Floats:
        """[N, 3] m, m, rad, map frame."""
        return self._buffers[0][: self._count].copy()

    @property
    def weights(self) -> Floats:
        """[N] summing to 1."""
        log_weights = self._log_weights[: self._count].copy()
        weights = np.empty(self._count)
        normalize(log_weights, weights)
        return weights

    def initialize(self, pose: Pose, covariance: Floats) -> None:
        """Believe that the robot is about here, and forget all else.

        Args:
            pose: base_link in the map frame.
            covariance: [3, 3] m, m, rad.

        Raises:
            InputError: Pose or covariance is not finite, or the covariance has a negative direction.
        """
        _check_belief(pose, covariance)
        count = self.parameters.max_particles
        drawn = self._rng.multivariate_normal(pose.as_array(), covariance, count, method="eigh")
        self._believe(drawn, pose, weight=1.0)

    def initialize_at(
        self, places: Sequence[tuple[Pose, Floats, float]], elsewhere: float = 0.0, kept: float = 0.0
    ) -> None:
        """Believe that the robot is at one of several places.

        Args:
            places: Pose of base_link in the map frame, covariance [3, 3] m, m, rad, and share of the belief of each.
            elsewhere: Share of the belief that is spread over the map's free space.
            kept: Share of the belief that stays what it was.

        Raises:
            InputError: As `initialize`.
        """
        for pose, covariance, _ in places:
            _check_belief(pose, covariance)
        shares = np.array([share for _, _, share in places])
        most = self.parameters.max_particles
        old, random = round(most * kept), round(most * elsewhere) if len(self._free) else 0
        counts = self._rng.multinomial(most - old - random, shares / shares.sum())
        drawn = [
            self._rng.multivariate_normal(pose.as_array(), covariance, count, method="eigh")
            for (pose, covariance, _), count in zip(places, counts, strict=True)
        ]
        remembered = np.empty((old, 3))
        low_variance(self._buffers[0][: self._count], self.weights, self._rng.random(), remembered)
        heaviest = float(shares.max() / shares.sum()) * (1.0 - kept - elsewhere)
        pose = self._estimate.pose if kept > heaviest else places[int(shares.argmax())][0]
        together = np.vstack([remembered, *drawn, self._anywhere(random)])
        self._believe(together, pose, weight=max(kept, heaviest))

    def initialize_globally(self) -> None:
        """Believe that the robot may be anywhere on the map's free space.

        Raises:
            InputError: The map has no free space.
        """
        if not len(self._free):
            raise InputError("map", "", "has no free space, so the robot can be nowhere on it")
        drawn = self._anywhere(self.parameters.max_particles)
        self._believe(drawn, Pose.from_array(drawn[0]), weight=0.0)

    def request_update(self) -> None:
        """Weigh the next scan even if the robot has not moved (nav2's request_nomotion_update)."""
        self._forced = True

    def update(self, odometry: Odometry, scan: Scan) -> Estimate:
        """Take in one scan, and the odometry of the same instant.

        The filter is updated when the robot has moved update_min_d or turned update_min_a; in between, the last
        estimate is carried on by odometry. Measurements that make no sense are left out, and ``problem`` says why.

        Args:
            odometry: base_link in the odom frame when the scan was taken.
            scan: The scan.

        Returns:
            The pose of base_link in the map frame when the scan was taken, never NaN.
        """
        problem = self._refusal(odometry, scan)
        if problem:
            return replace(self._estimate, updated=False, problem=problem)
        problem = self._absorb_jump(odometry)
        beams = choose_beams(scan, self._lidar, self.parameters)
        if not len(beams):
            self._estimate = replace(self._carried_on(odometry, scan), problem="the scan has no readings")
        elif self._is_due(odometry):
            self._propagate(odometry)
            self._reweight(beams)
            carried = self._carried_on(odometry, scan)
            summary = self._summary(carried)
            self._estimate = self._refined(summary, [carried.pose, summary.pose], scan)
            self._resample()
        else:
            carried = self._carried_on(odometry, scan)
            self._estimate = self._refined(carried, [carried.pose], scan)
        self._seen = odometry
        self._time = scan.time
        return replace(self._estimate, problem=problem) if problem else self._estimate

    def _propagate(self, odometry: Odometry) -> None:
        """x_t ~ p(x_t | u_t, x_{t−1})."""
        noise = self._noise[: self._count]
        self._rng.standard_normal(dtype=np.float32, out=noise)
        self._move(self._buffers[0][: self._count], self._motion_since_update(odometry), self.parameters, noise)
        self._reference = odometry.pose

    def _reweight(self, beams: Beams) -> None:
        """w_t ∝ p(z_t | x_t, m) w_{t−1}, in logarithms."""
        log_weights, increments = self._log_weights[: self._count], self._increments[: self._count]
        increments.fill(0.0)
        self._sensor.add_log_likelihood(self._buffers[0][: self._count], beams, increments)
        self._likelihood = math.exp(log_sum(log_weights + increments) / len(beams))
        increments *= min(1.0, self.parameters.independent_beams / len(beams))
        least = self.parameters.least_effective * self._count
        if self._is_at_one_place and tempering(log_weights, increments, least) < 1.0:
            self._propose_again(beams, increments, log_weights)
            least *= AT_ONE_PLACE
        increments *= tempering(log_weights, increments, least)
        log_weights += increments
        self._evenly_weighted = False
        normalize(log_weights, self._weights[: self._count])
        self._recovery.observe(self._likelihood)

    def _propose_again(self, beams: Beams, increments: Floats, log_weights: Floats) -> None:
        """Draw some of the particles where the scan fits, when the motion has left too few of them there."""
        particles = self._buffers[0][: self._count]
        best = Pose.from_array(particles[int(increments.argmax())])
        repetition = max(1.0, len(beams) / self.parameters.independent_beams)
        sigma = self.parameters.sigma_hit
        moved, weights = draw_around_match(particles, best, self.field, beams.ends, sigma, repetition, self._rng)
        again = np.zeros(len(moved))
        self._sensor.add_log_likelihood(particles[moved], beams, again)
        increments[moved] = again / repetition
        log_weights += weights

    def _resample(self) -> None:
        """Draw particles by weight: as many as KLD sampling asks for, some of them anywhere when the fit gets worse."""
        self._updates += 1
        weights = self._weights[: self._count]
        if self._updates % self.parameters.resample_interval:
            return
        if self.parameters.selective_resampling and 1.0 / float(weights @ weights) > 0.5 * self._count:
            return
        particles, resampled = self._buffers
        count = adaptive_count(
            particles[: self._count], weights, self._table, self._bin_size, self._limits, self._rng.random()
        )
        share = self._recovery.random_share if len(self._free) else 0.0
        count = self._room_for(count, share)
        low_variance(particles[: self._count], weights, self._rng.random(), resampled[:count])
        if share > 0.0:
            replaced = self._rng.choice(count, self._rng.binomial(count, share), replace=False)
            resampled[replaced] = self._anywhere(len(replaced))
        self._buffers = (resampled, particles)
        self._count = count
        self._log_weights[:count] = -math.log(count)
        self._weights[:count] = 1.0 / count
        self._evenly_weighted = True

    def _room_for(self, count: int, share: float) -> int:
        """How many particles KLD sampling asks for when a share of them is random, each in a bin of its own."""
        p = self.parameters
        growing = share / (2.0 * p.pf_err)
        return p.max_particles if growing >= 1.0 else min(math.ceil(count / (1.0 - growing)), p.max_particles)

    def _summary(self, expected: Estimate) -> Estimate:
        """The heaviest cluster's mean and covariance."""
        cluster = heaviest_cluster(self._buffers[0][: self._count], self._weights[: self._count], self._table)
        return replace(
            expected,
            pose=cluster.mean,
            covariance=cluster.covariance,
            weight=cluster.weight,
            particles=self._count,
            likelihood=self._likelihood,
            updated=True,
        )

    def _carried_on(self, odometry: Odometry, scan: Scan) -> Estimate:
        """The last estimate moved on by what the wheels have reported since."""
        moved = odometry.pose.relative_to(self._seen.pose) if self._seen else Pose()
        return replace(self._estimate, time=scan.time, pose=self._estimate.pose @ moved, updated=False, problem="")

    def _refined(self, estimate: Estimate, starts: Sequence[Pose], scan: Scan) -> Estimate:
        """The estimate matched to the map, over all beams, if the parameters ask for it.

        A pose that was refined before is more precise than the particles' mean. It is carried on as long as the
        particles support it and the scan fits no worse there.

        Args:
            estimate: Its covariance says how far a match may be away.
            starts: Where matches begin, the preferred one first.
            scan: The scan.
        """
        if not self.parameters.refine:
            return estimate
        ends = choose_beams(scan, self._lidar, self.parameters, MATCHED_BEAMS).ends
        sigma = self.parameters.refine_sigma
        supported = [pose for pose in starts if agrees(pose, estimate.pose, estimate.covariance)]
        best, most = estimate.pose, -1.0
        for pose in supported:
            if most >= 0.0 and pose.is_near(best, NEAR, NEAR_HEADING):
                continue  # a match from there would come to the same place
            match = match_scan(self.field, ends, pose, estimate.covariance, sigma)
            if match.explained > most + BETTER:
                best, most = match.pose, match.explained
        return replace(estimate, pose=best)

    @property
    def _is_at_one_place(self) -> bool:
        """Whether the particles are equally likely and lie around one place."""
        return self._evenly_weighted and self._estimate.is_at_one_place

    def _motion_since_update(self, odometry: Odometry) -> Pose:
        return odometry.pose.relative_to(self._reference) if self._reference else Pose()

    def _is_due(self, odometry: Odometry) -> bool:
        """Whether the robot has moved enough for the filter, or somebody has asked for an update."""
        motion = self._motion_since_update(odometry)
        due = (
            self._forced
            or math.hypot(motion.x, motion.y) >= self.parameters.update_min_d
            or abs(motion.theta) >= self.parameters.update_min_a
        )
        self._forced = False
        return due

    def _refusal(self, odometry: Odometry, scan: Scan) -> str:
        """Why a measurement cannot be used at all; empty if it can."""
        if not (np.isfinite(odometry.pose.as_array()).all() and math.isfinite(odometry.time)):
            return "the odometry is not finite"
        if not all(map(math.isfinite, (scan.time, scan.angle_min, scan.angle_increment))):
            return "the scan's time or angles are not finite"
        if scan.time < self._time or (self._seen and odometry.time < self._seen.time):
            return "time runs backwards"
        return ""

    def _absorb_jump(self, odometry: Odometry) -> str:
        """Take a jump of the odometry for what it is, a new odom frame, and not for a motion; say so."""
        if self._seen is None or self._reference is None:
            self._reference = self._reference or odometry.pose
            return ""
        jump = odometry.pose.distance_to(self._seen.pose)
        if jump <= JUMP_SLACK + self.parameters.max_odometry_speed * (odometry.time - self._seen.time):
            return ""
        pending = self._seen.pose.relative_to(self._reference)
        self._reference = odometry.pose @ pending.inverse
        self._seen = odometry
        return f"the odometry jumped by {jump:.2f} m"

    def _believe(self, particles: Floats, pose: Pose, weight: float) -> None:
        """Replace the belief by equally likely particles, of which a share lies around a pose."""
        self._count = len(particles)
        self._buffers[0][: self._count] = particles
        self._buffers[0][: self._count, 2] = np.remainder(particles[:, 2] + math.pi, math.tau) - math.pi
        self._log_weights[: self._count] = -math.log(self._count)
        self._weights[: self._count] = 1.0 / self._count
        self._evenly_weighted = True
        self._likelihood = 0.0
        self._updates = 0
        self._recovery.reset()
        self._forced = True
        self._estimate = Estimate(self._time, pose, np.cov(particles.T), weight, self._count, 0.0, updated=False)

    def _anywhere(self, count: int) -> Floats:
        """[count, 3] poses drawn uniformly from the map's free space."""
        if not count:
            return np.empty((0, 3))
        chosen = self._free[self._rng.integers(len(self._free), size=count)]
        row, column = np.divmod(chosen, self._grid.probability.shape[1])
        inside = self._rng.random((count, 3))
        places = np.column_stack([column, row]) + inside[:, :2]
        places = self._grid.origin.transform(places * self._grid.resolution)
        return np.column_stack([places, (inside[:, 2] * 2.0 - 1.0) * math.pi])


def _check_belief(pose: Pose, covariance: Floats) -> None:
    """Raise an InputError unless pose and covariance are finite and the covariance has no negative direction."""
    if not np.isfinite(pose.as_array()).all():
        raise InputError("initial pose", "", f"{pose} is not finite")
    if not np.isfinite(covariance).all() or float(np.linalg.eigvalsh(covariance).min()) < -1e-9:
        raise InputError("initial pose", "covariance", "is not a covariance: finite, symmetric and not negative")
