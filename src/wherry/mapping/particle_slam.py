"""Grid SLAM with Rao–Blackwellized particles, the method of gmapping (Grisetti, Stachniss & Burgard 2007).

Each particle has its own trajectory and map. Particles move to the poses at which odometry and scan agree best, and are
resampled only when the effective sample size is small. Equation numbers are those of the article.

Odometry is checked by graph SLAM without loop closing: its motion between keyframes is what the particles are moved by.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import kernel
from wherry.mapping.graph_slam import GraphSlam
from wherry.mapping.graph_snapshot import GraphSnapshot, ScanPose
from wherry.mapping.keyframes import Keyframe, MapRenderer
from wherry.mapping.loop_closure import LoopClosure
from wherry.mapping.matching_grid import MAX_LIKELIHOOD
from wherry.mapping.motion_noise import MotionNoise, is_within
from wherry.mapping.odometry_check import OdometryContradiction
from wherry.mapping.point_cloud import PointCloud
from wherry.mapping.scan_matching import MIN_POINTS
from wherry.mapping.settings import GraphSlamSettings, ParticleSlamSettings
from wherry.mapping.shared_tiles import SharedTiles, log_likelihood
from wherry.robot import Odometry, Scan
from wherry.space.occupancy import NO_DISCS, OccupancyGrid
from wherry.space.pose import IDENTITY, Floats, Pose, compose
from wherry.space.trajectory import Trajectory

SCAN_POINTS = 120  # points of a scan that are matched
INDEPENDENT_POINTS = 50.0  # points that a scan's likelihood counts for; errors of points on one wall are correlated
MIN_POINT_LIKELIHOOD = 0.05  # likelihood of a point that is far from all mapped points
CLIMB_STEP, CLIMB_ANGLE_STEP = 0.08, math.radians(2.0)  # m and rad, first steps of hill climbing
CLIMB_HALVINGS = 5  # step sizes of hill climbing, each half of the one before
LATTICE_STEP, LATTICE_ANGLE_STEP = 0.02, math.radians(0.4)  # m and rad, spacing of the lattice of the proposal
MOTION_NOISE = MotionNoise(
    distance=0.03,
    distance_per_distance=0.15,
    distance_per_angle=0.05,
    angle=math.radians(1.0),
    angle_per_angle=0.12,
    angle_per_distance=math.radians(3.0),
)
# Log likelihood of each value 0 to 255 of a map's cell, [256].
LOG_TABLE = np.log(MIN_POINT_LIKELIHOOD + (1.0 - MIN_POINT_LIKELIHOOD) * np.arange(MAX_LIKELIHOOD + 1) / MAX_LIKELIHOOD)


class ParticleSlam:
    """Rao–Blackwellized particle SLAM; implements `wherry.mapping.slam.Slam`.

    Args:
        lidar: Pose of the lidar in the base_link frame.
        rng: Source of all randomness.
        settings: Settings of the method.
    """

    def __init__(self, lidar: Pose, rng: np.random.Generator, settings: ParticleSlamSettings | None = None) -> None:
        self._settings = settings or ParticleSlamSettings()
        self._particles = np.zeros((self._settings.particles, 3))
        self._log_weights = np.zeros(self._settings.particles)
        self._resampling_count = 0
        self._lidar = lidar
        self._rng = rng
        self._maps = SharedTiles(self._settings.particles)
        self._keyframes: list[Keyframe] = []
        self._history: list[Floats] = []  # particles [N, 3] at each keyframe, before resampling
        self._parents: list[NDArray[np.int64]] = []  # [N] index of each particle's parent among those of the history
        self._scan_poses: list[ScanPose] = []
        self._matcher = GraphSlam(lidar, GraphSlamSettings(range_limit=self._settings.range_limit, close_loops=False))
        self._keyframe_match = IDENTITY  # base_link at the last keyframe, by the matcher
        self._renderer = MapRenderer(
            lidar, self._settings.resolution, self._settings.range_limit, self._settings.empty_range
        )

    @property
    def particles(self) -> Floats:
        """base_link of each particle at the last keyframe in the map frame, [N, 3] m, m, rad."""
        return self._particles

    @property
    def log_weights(self) -> Floats:
        """Log weights of the particles, [N], up to a constant."""
        return self._log_weights

    @property
    def resampling_count(self) -> int:
        """How often the particles were resampled."""
        return self._resampling_count

    @property
    def effective_sample_size(self) -> float:
        """Effective sample size N_eff (equation 18)."""
        weights = _normalized(self._log_weights)
        return float(1.0 / (weights**2).sum())

    @property
    def trajectory(self) -> Trajectory:
        """base_link of the best particle at each scan in the map frame."""
        poses = self.keyframe_poses
        times = np.array([scan_pose.time for scan_pose in self._scan_poses])
        at_scans = [(Pose.from_array(poses[keyframe]) @ offset).as_array() for _, keyframe, offset in self._scan_poses]
        return Trajectory(times, np.array(at_scans).reshape(-1, 3))

    @property
    def keyframe_poses(self) -> Floats:
        """base_link of the best particle and its ancestors at each keyframe in the map frame, [K, 3] m, m, rad."""
        particle = self._best_particle
        poses = np.zeros((len(self._history), 3))
        for keyframe in range(len(self._history) - 1, -1, -1):
            particle = int(self._parents[keyframe][particle])
            poses[keyframe] = self._history[keyframe][particle]
        return poses

    @property
    def loop_closures(self) -> Sequence[LoopClosure]:
        """Empty, since particles close loops without explicit constraints."""
        return ()

    @property
    def odometry_contradictions(self) -> Sequence[OdometryContradiction]:
        """See `wherry.mapping.slam.Slam.odometry_contradictions`."""
        return self._matcher.odometry_contradictions

    def snapshot(self) -> GraphSnapshot | None:
        """None, since there is no pose graph."""
        return None

    def finish(self) -> None:
        """See `wherry.mapping.slam.Slam.finish`; nothing is ever pending."""

    def grid(self, exclude: Floats = NO_DISCS) -> OccupancyGrid:
        """Map of the best particle; see `wherry.mapping.slam.Slam.grid`."""
        return self._renderer.grid(self._keyframes, self.keyframe_poses, exclude)

    def add(self, scan: Scan, odometry: Odometry | None = None) -> Pose:
        """Add a scan; see `wherry.mapping.slam.Slam.add`."""
        matched = self._matcher.add(scan, odometry)
        motion = matched.relative_to(self._keyframe_match)
        settings = self._settings
        if self._keyframes and is_within(motion, settings.keyframe_distance, settings.keyframe_angle):
            self._scan_poses.append(ScanPose(scan.time, len(self._keyframes) - 1, motion))
            return self._best_pose @ motion
        cloud = PointCloud.from_scan(scan, self._lidar, settings.range_limit)
        if self._keyframes:
            self._sample(cloud.subsampled(SCAN_POINTS).points, motion)
        self._history.append(self._particles.copy())
        self._parents.append(self._resample())
        for particle in range(settings.particles):
            self._maps.add(particle, Pose.from_array(self._particles[particle]).transform(cloud.points))
        self._keyframes.append(Keyframe(scan, cloud))
        self._keyframe_match = matched
        self._scan_poses.append(ScanPose(scan.time, len(self._keyframes) - 1, IDENTITY))
        return self._best_pose

    @property
    def _best_particle(self) -> int:
        """Index of the particle with the largest weight."""
        return int(np.argmax(self._log_weights))

    @property
    def _best_pose(self) -> Pose:
        """base_link of the best particle at the last keyframe in the map frame."""
        return Pose.from_array(self._particles[self._best_particle])

    def _sample(self, points: Floats, motion: Pose) -> None:
        """Sample each particle from the improved proposal, and weight it (equations 10 to 17)."""
        distance, angle = MOTION_NOISE.deviations(motion)
        deviations = np.array([distance, distance, angle])
        expected = compose(self._particles, np.broadcast_to(motion.as_array(), self._particles.shape))
        noise = self._rng.normal(size=(2, *self._particles.shape))
        starts = expected + noise[0] * deviations
        maps = self._maps
        self._particles, increments = _propose(
            maps.index, maps.tiles, maps.corner, points, expected, starts, deviations, noise[1], LOG_TABLE
        )
        self._log_weights = self._log_weights + increments - increments.max()

    def _resample(self) -> NDArray[np.int64]:
        """Resample if the effective sample size is small, and return the parents of the particles, [N]."""
        count = self._settings.particles
        identity = np.arange(count)
        if not self._keyframes or self.effective_sample_size >= self._settings.resample_below * count:
            return identity
        parents = _systematic_resample(_normalized(self._log_weights), float(self._rng.random()))
        self._resampling_count += 1
        self._particles, self._log_weights = self._particles[parents], self._log_weights[parents]
        if (parents != identity).any():
            self._log_weights[:] = 0.0
            self._maps.resample(parents)
        return parents


def _normalized(log_weights: Floats) -> Floats:
    """Weights [N] that sum to 1."""
    weights = np.exp(log_weights - log_weights.max())
    normalized: Floats = weights / weights.sum()
    return normalized


def _systematic_resample(weights: Floats, start: float) -> NDArray[np.int64]:
    """Indices [N] of the particles that are drawn; ``start`` is uniform in [0, 1)."""
    count = len(weights)
    marks = (np.arange(count) + start) / count
    return np.minimum(np.searchsorted(np.cumsum(weights), marks), count - 1).astype(np.int64)


@kernel
def _propose(
    index: NDArray[np.int32],
    tiles: NDArray[np.uint8],
    corner: NDArray[np.int64],
    points: Floats,
    expected: Floats,
    starts: Floats,
    deviations: Floats,
    noise: Floats,
    log_table: Floats,
) -> tuple[Floats, Floats]:
    """Sample poses from the improved proposal.

    Args:
        index: Index of the particles' maps, [N, H, W], see `SharedTiles`.
        tiles: Tiles of the maps, [T, TILE_SIZE, TILE_SIZE].
        corner: Corner of the index, [2].
        points: Points of the scan in the base_link frame, [P, 2] m.
        expected: Poses that the motion predicts, [N, 3] m, m, rad.
        starts: Poses at which hill climbing begins, [N, 3] m, m, rad.
        deviations: Standard deviations of the motion, [3] m, m, rad.
        noise: Standard normal samples, [N, 3].
        log_table: Log likelihood of each value of a cell, [256].

    Returns:
        Poses [N, 3] m, m, rad, and the increments of the log weights [N].
    """
    count = len(expected)
    poses, increments = starts.copy(), np.zeros(count)
    if len(points) < MIN_POINTS:
        return poses, increments
    exponent = INDEPENDENT_POINTS / len(points)
    for n in range(count):
        highest = _hill_climb(index[n], tiles, corner, points, poses[n], expected[n], deviations, log_table, exponent)
        total, mean, covariance = _lattice_moments(
            index[n], tiles, corner, points, poses[n], expected[n], deviations, log_table, exponent, highest
        )
        poses[n] += mean + np.linalg.cholesky(covariance) @ noise[n]
        increments[n] = highest + math.log(total)
    return poses, increments


@kernel
def _lattice_moments(
    index: NDArray[np.int32],
    tiles: NDArray[np.uint8],
    corner: NDArray[np.int64],
    points: Floats,
    pose: Floats,
    expected: Floats,
    deviations: Floats,
    log_table: Floats,
    exponent: float,
    highest: float,
) -> tuple[float, Floats, Floats]:
    """Moments of the posterior on a lattice of 3 × 3 × 3 poses around one (equations 15 to 17).

    Args:
        index: As in `_propose`, of one particle, [H, W].
        tiles: As in `_propose`.
        corner: As in `_propose`.
        points: As in `_propose`.
        pose: Centre of the lattice, [3] m, m, rad.
        expected: Pose that the motion predicts, [3] m, m, rad.
        deviations: As in `_propose`.
        log_table: As in `_propose`.
        exponent: Weight of the scan's log likelihood.
        highest: Log posterior that is scaled to a weight of 1.

    Returns:
        Sum of the weights, mean [3] and covariance [3, 3] of the offsets from the centre, m, m, rad.
    """
    total, mean, second = 0.0, np.zeros(3), np.zeros((3, 3))
    for node in range(27):
        offset = np.array(
            [(node % 3 - 1) * LATTICE_STEP, (node // 3 % 3 - 1) * LATTICE_STEP, (node // 9 - 1) * LATTICE_ANGLE_STEP]
        )
        value = _log_posterior(index, tiles, corner, points, pose + offset, expected, deviations, log_table, exponent)
        weight = math.exp(value - highest)
        total += weight
        mean += weight * offset
        second += weight * np.outer(offset, offset)
    mean /= total
    covariance = second / total - np.outer(mean, mean) + np.diag(np.array([1e-8, 1e-8, 1e-9]))
    return total, mean, covariance


@kernel
def _hill_climb(
    index: NDArray[np.int32],
    tiles: NDArray[np.uint8],
    corner: NDArray[np.int64],
    points: Floats,
    pose: Floats,
    expected: Floats,
    deviations: Floats,
    log_table: Floats,
    exponent: float,
) -> float:
    """Hill-climb a pose [3] to a maximum of the posterior, axis by axis with halving steps; return its log."""
    highest = _log_posterior(index, tiles, corner, points, pose, expected, deviations, log_table, exponent)
    step = np.array([CLIMB_STEP, CLIMB_STEP, CLIMB_ANGLE_STEP])
    for _ in range(CLIMB_HALVINGS):
        has_improved = True
        while has_improved:
            has_improved = False
            for side in range(6):
                tried = pose.copy()
                tried[side // 2] += step[side // 2] * (1.0 if side % 2 == 0 else -1.0)
                value = _log_posterior(index, tiles, corner, points, tried, expected, deviations, log_table, exponent)
                if value > highest:
                    pose[:], highest, has_improved = tried, value, True
        step = step / 2.0
    return highest


@kernel
def _log_posterior(
    index: NDArray[np.int32],
    tiles: NDArray[np.uint8],
    corner: NDArray[np.int64],
    points: Floats,
    pose: Floats,
    expected: Floats,
    deviations: Floats,
    log_table: Floats,
    exponent: float,
) -> float:
    """Log of p(z | x, map) p(x | odometry), up to a constant."""
    evidence = log_likelihood(index, tiles, corner, points, pose[0], pose[1], pose[2], log_table)
    offset = pose - expected
    offset[2] -= math.tau * np.round(offset[2] / math.tau)
    return exponent * evidence - 0.5 * float(((offset / deviations) ** 2).sum())
