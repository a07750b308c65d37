"""Grid SLAM with Rao–Blackwellized particles (Grisetti, Stachniss & Burgard 2007), the method of gmapping.

Each particle has a way of its own and the map that follows from it. Particles move to where odometry and the scan agree
best, and are drawn again only when few of them still count.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import kernel
from wherry.mapping.cloud import Cloud
from wherry.mapping.keyscans import Keyscan, MapDrawing
from wherry.mapping.motion_prior import MotionNoise, is_within
from wherry.mapping.shared_tiles import SharedTiles, log_likelihood
from wherry.mapping.slam import NO_DISCS
from wherry.mapping.submap import FULL
from wherry.robot import Odometry, Scan
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import IDENTITY, Floats, Pose, compose
from wherry.space.trajectory import Trajectory

POINTS = 120  # of a scan
INDEPENDENT = 50.0  # points; neighbours on one wall say the same, so a scan counts as so many
FLOOR = 0.05  # likelihood of a point that lies nowhere
CLIMB_STEP, CLIMB_ANGLE = 0.08, math.radians(2.0)  # m and rad, first steps of the climb to the best pose
CLIMB_HALVINGS = 5
LATTICE_STEP, LATTICE_ANGLE = 0.02, math.radians(0.4)  # m and rad between the poses that the proposal is made of
LEAST_POINTS = 20
MOTION = MotionNoise(0.03, 0.15, 0.05, math.radians(1.0), 0.12, math.radians(3.0))


@dataclass(frozen=True, slots=True)
class ParticleSlamSettings:
    """What can be chosen.

    Attributes:
        particles: N.
        resolution: m, a grid cell of the map that is drawn.
        range_limit: m, readings beyond it are not used.
        empty_range: m, how far a beam that met nothing is believed to be free.
        keyscan_distance: m between scans that are used.
        keyscan_angle: rad between scans that are used.
        draw_below: Share of N below which N_eff has the particles drawn again.
    """

    particles: int = 30
    resolution: float = 0.05
    range_limit: float = 30.0
    empty_range: float = 10.0
    keyscan_distance: float = 0.25
    keyscan_angle: float = math.radians(15.0)
    draw_below: float = 0.5


class ParticleSlam:
    """Rao–Blackwellized particle SLAM, as in `wherry.mapping.slam.Slam`.

    Args:
        lidar: Where it is mounted, in the base_link frame.
        rng: Where the randomness comes from.
        settings: What can be chosen.

    Attributes:
        poses: [N, 3] m, m, rad, map frame: each particle's base_link at the last keyscan.
        log_weights: [N], up to a constant.
        draws: How often the particles were drawn again.
    """

    def __init__(self, lidar: Pose, rng: np.random.Generator, settings: ParticleSlamSettings | None = None) -> None:
        self.settings = settings or ParticleSlamSettings()
        self.poses = np.zeros((self.settings.particles, 3))
        self.log_weights = np.zeros(self.settings.particles)
        self.draws = 0
        self._lidar = lidar
        self._rng = rng
        self._maps = SharedTiles(self.settings.particles)
        self._keyscans: list[Keyscan] = []
        self._ways: list[Floats] = []  # [N, 3] at each keyscan, before particles were drawn again
        self._parents: list[NDArray[np.int64]] = []  # [N] of each keyscan's particles, among those of the one before
        self._passed: list[tuple[float, int, Pose]] = []
        self._key_odometry: Odometry | None = None
        self._rate = np.zeros(3)
        self._drawing = MapDrawing(
            lidar, self.settings.resolution, self.settings.range_limit, self.settings.empty_range
        )

    @property
    def effective(self) -> float:
        """N_eff, how many particles still count (equation 18)."""
        weights = _normalized(self.log_weights)
        return float(1.0 / (weights**2).sum())

    @property
    def trajectory(self) -> Trajectory:
        """The best particle's way."""
        nodes = self._way(int(np.argmax(self.log_weights)))
        times = np.array([time for time, _, _ in self._passed])
        poses = [(Pose.from_array(nodes[key]) @ offset).as_array() for _, key, offset in self._passed]
        return Trajectory(times, np.array(poses).reshape(-1, 3))

    def grid(self, exclude: Floats = NO_DISCS) -> OccupancyGrid:
        """The best particle's map; see `wherry.mapping.slam.Slam.grid`."""
        return self._drawing.grid(self._keyscans, self._way(int(np.argmax(self.log_weights))), exclude)

    def add(self, scan: Scan, odometry: Odometry | None = None) -> Pose:
        """Take in a scan; see `wherry.mapping.slam.Slam.add`."""
        movement = self._movement(scan.time, odometry)
        if self._keyscans and is_within(movement, self.settings.keyscan_distance, self.settings.keyscan_angle):
            self._passed.append((scan.time, len(self._keyscans) - 1, movement))
            return Pose.from_array(self.poses[np.argmax(self.log_weights)]) @ movement
        cloud = Cloud.of(scan, self._lidar, self.settings.range_limit)
        points = cloud.thinned(POINTS).points
        count = self.settings.particles
        parents = np.arange(count)
        if self._keyscans:
            self._move(points, movement)
            if self.effective < self.settings.draw_below * count:
                parents = _drawn(_normalized(self.log_weights), float(self._rng.random()))
                self.draws += 1
        self._ways.append(self.poses.copy())
        self.poses, self.log_weights = self.poses[parents], self.log_weights[parents]
        if self.draws and (parents != np.arange(count)).any():
            self.log_weights[:] = 0.0
            self._maps.draw(parents)
        self._parents.append(parents)
        for particle in range(count):
            self._maps.add(particle, Pose.from_array(self.poses[particle]).transform(cloud.points))
        self._keyscans.append(Keyscan(scan, cloud))
        self._key_odometry = odometry
        self._passed.append((scan.time, len(self._keyscans) - 1, IDENTITY))
        return Pose.from_array(self.poses[np.argmax(self.log_weights)])

    def _movement(self, time: float, odometry: Odometry | None) -> Pose:
        """How base_link has moved since the last keyscan."""
        if odometry is None or self._key_odometry is None:
            since = time - self._keyscans[-1].scan.time if self._keyscans else 0.0
            return Pose.from_array(self._rate * since)
        return odometry.pose.relative_to(self._key_odometry.pose)

    def _move(self, points: Floats, movement: Pose) -> None:
        """Draw each particle from the improved proposal and weigh it (equations 10 to 17)."""
        distance, angle = MOTION.deviations(movement)
        deviations = np.array([distance, distance, angle])
        expected = compose(self.poses, np.broadcast_to(movement.as_array(), self.poses.shape))
        noise = self._rng.normal(size=(2, *self.poses.shape))
        starts = expected + noise[0] * deviations
        before = self.poses
        self.poses, gains = _propose(
            self._maps.index, self._maps.tiles, self._maps.corner, points, expected, starts, deviations, noise[1], LOGS
        )
        self.log_weights = self.log_weights + gains - gains.max()
        best = int(np.argmax(self.log_weights))
        seconds = max(self._passed[-1][0] - self._keyscans[-1].scan.time, 1e-3)
        moved = Pose.from_array(self.poses[best]).relative_to(Pose.from_array(before[best]))
        self._rate = moved.as_array() / seconds

    def _way(self, particle: int) -> Floats:
        """[K, 3] m, m, rad: a particle's base_link at every keyscan, traced back through its parents."""
        way = np.zeros((len(self._ways), 3))
        for key in range(len(self._ways) - 1, -1, -1):
            particle = int(self._parents[key][particle])
            way[key] = self._ways[key][particle]
        return way


LOGS = np.log(FLOOR + (1.0 - FLOOR) * np.arange(FULL + 1) / FULL)


def _normalized(log_weights: Floats) -> Floats:
    """[N] weights whose sum is 1."""
    weights = np.exp(log_weights - log_weights.max())
    normalized: Floats = weights / weights.sum()
    return normalized


def _drawn(weights: Floats, start: float) -> NDArray[np.int64]:
    """[N] which particles survive, by systematic resampling; ``start`` in [0, 1)."""
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
    logs: Floats,
) -> tuple[Floats, Floats]:
    """Poses drawn from the improved proposal, and the logarithms of what their weights gain.

    Args:
        index: [N, H, W], of the particles' maps, with ``tiles`` and ``corner``.
        tiles: [T, TILE, TILE].
        corner: [2].
        points: [P, 2] m, base_link frame.
        expected: [N, 3] where odometry says.
        starts: [N, 3] where to begin to climb.
        deviations: [3] σ of odometry.
        noise: [N, 3] standard normal numbers.
        logs: [256] of likelihoods.

    Returns:
        [N, 3] and [N].
    """
    count = len(expected)
    poses, gains = starts.copy(), np.zeros(count)
    if len(points) < LEAST_POINTS:
        return poses, gains
    temper = INDEPENDENT / len(points)
    for n in range(count):
        highest = _climb(index[n], tiles, corner, points, poses[n], expected[n], deviations, logs, temper)
        # The proposal is a Gaussian with the moments of a lattice around the best pose (equations 15 to 17).
        total, mean, second = 0.0, np.zeros(3), np.zeros((3, 3))
        for node in range(27):
            offset = np.array(
                [
                    (node % 3 - 1) * LATTICE_STEP,
                    (node // 3 % 3 - 1) * LATTICE_STEP,
                    (node // 9 - 1) * LATTICE_ANGLE,
                ]
            )
            value = _posterior(
                index[n], tiles, corner, points, poses[n] + offset, expected[n], deviations, logs, temper
            )
            weight = math.exp(value - highest)
            total += weight
            mean += weight * offset
            second += weight * np.outer(offset, offset)
        mean /= total
        covariance = second / total - np.outer(mean, mean) + np.diag(np.array([1e-8, 1e-8, 1e-9]))
        poses[n] += mean + np.linalg.cholesky(covariance) @ noise[n]
        gains[n] = highest + math.log(total)
    return poses, gains


@kernel
def _climb(
    index: NDArray[np.int32],
    tiles: NDArray[np.uint8],
    corner: NDArray[np.int64],
    points: Floats,
    pose: Floats,
    expected: Floats,
    deviations: Floats,
    logs: Floats,
    temper: float,
) -> float:
    """Move a pose [3] uphill, axis by axis with halving steps, to the nearest peak; return its height."""
    highest = _posterior(index, tiles, corner, points, pose, expected, deviations, logs, temper)
    step = np.array([CLIMB_STEP, CLIMB_STEP, CLIMB_ANGLE])
    for _ in range(CLIMB_HALVINGS):
        climbing = True
        while climbing:
            climbing = False
            for side in range(6):
                tried = pose.copy()
                tried[side // 2] += step[side // 2] * (1.0 if side % 2 == 0 else -1.0)
                value = _posterior(index, tiles, corner, points, tried, expected, deviations, logs, temper)
                if value > highest:
                    pose[:], highest, climbing = tried, value, True
        step = step / 2.0
    return highest


@kernel
def _posterior(
    index: NDArray[np.int32],
    tiles: NDArray[np.uint8],
    corner: NDArray[np.int64],
    points: Floats,
    pose: Floats,
    expected: Floats,
    deviations: Floats,
    logs: Floats,
    temper: float,
) -> float:
    """Log of p(z | x, map) p(x | odometry), up to a constant."""
    seen = log_likelihood(index, tiles, corner, points, pose[0], pose[1], pose[2], logs)
    off = pose - expected
    off[2] -= math.tau * np.round(off[2] / math.tau)
    return temper * seen - 0.5 * float(((off / deviations) ** 2).sum())
