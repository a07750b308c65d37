"""Comparison of a Kalman filter, grid Markov and Monte Carlo localization, as in the paper's section 5.A.

All filters process the same scans and odometry of a simulated robot among unmapped boxes: from a known start, from a
global start, and with a kidnapping half-way. The paper's three claims are then tested on the metrics.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from wherry.evaluation import root_mean_square
from wherry.experiments.localization.kidnapping import START_COVARIANCE
from wherry.experiments.localization.wandering import RandomWalk, WanderingRobot
from wherry.floorplan.generation import place_boxes
from wherry.floorplan.world_files import find_world
from wherry.localization.amcl import Amcl
from wherry.localization.ekf import EkfLocalization
from wherry.localization.grid_markov import GridMarkov
from wherry.localization.localizer import Localizer
from wherry.localization.parameters import PRECISE_PARAMETERS
from wherry.robot import Odometry, Scan
from wherry.simulation import build
from wherry.simulation.faults import random_cell_pose
from wherry.simulation.ground_truth import true_map
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose

MCL_PARTICLES = 2000  # particles of MCL without adaptation
AMCL_MAX_PARTICLES = 20_000  # particles of AMCL at a global start, of which KLD sampling soon drops most
AMCL_PARAMETERS = replace(
    PRECISE_PARAMETERS, recovery_alpha_slow=0.01, recovery_alpha_fast=0.3, max_particles=AMCL_MAX_PARTICLES
)
MCL_PARAMETERS = replace(PRECISE_PARAMETERS, min_particles=MCL_PARTICLES, max_particles=MCL_PARTICLES, refine=False)
LOCALIZED_MAX_DISTANCE = 0.5  # m, distance from the true position at the end of a drive below which it is localized
UPDATE_QUANTILE = 0.95  # quantile of the processor times, high since only few scans update a filter


@dataclass(frozen=True, slots=True)
class FilterComparisonSettings:
    """Inputs of the comparison.

    Attributes:
        world: Name of a built-in world, or path of a world file.
        boxes: Number of unmapped boxes.
        seconds: Simulated time of each of the three drives, s.
        repetitions: Number of drives of each kind, each with its own seed.
        seed: Seed of all randomness.
    """

    world: str = "rooms"
    boxes: int = 4
    seconds: float = 60.0
    repetitions: int = 5
    seed: int = 0


@dataclass(frozen=True, slots=True)
class LocalizationFilter:
    """The functions that all compared filters have in common.

    Attributes:
        start: Starts at a known pose of base_link, map frame.
        start_globally: Starts without a pose; the EKF starts at the map's centre with the covariance of the whole map.
        update: Processes odometry and scan of the same instant and returns the pose of base_link, map frame.
        memory: Returns the size of the filter's state, bytes.
    """

    start: Callable[[Pose], None]
    start_globally: Callable[[], None]
    update: Callable[[Odometry, Scan], Pose]
    memory: Callable[[], int]


def _ekf(grid: OccupancyGrid, lidar: Pose, _rng: np.random.Generator) -> LocalizationFilter:
    ekf = EkfLocalization(grid, lidar, PRECISE_PARAMETERS)
    height, width = grid.probability.shape
    centre = grid.origin @ Pose(width * grid.resolution / 2.0, height * grid.resolution / 2.0)
    uniform = np.diag([width * grid.resolution, height * grid.resolution, math.pi]) ** 2 / 12.0
    return LocalizationFilter(
        lambda pose: ekf.initialize(pose, START_COVARIANCE),
        lambda: ekf.initialize(centre, uniform),
        ekf.update,
        lambda: ekf.memory,
    )


def _grid_markov(grid: OccupancyGrid, lidar: Pose, _rng: np.random.Generator) -> LocalizationFilter:
    markov = GridMarkov(grid, lidar, PRECISE_PARAMETERS)
    return LocalizationFilter(
        lambda pose: markov.initialize(pose, START_COVARIANCE),
        markov.initialize_globally,
        markov.update,
        lambda: markov.memory,
    )


def _mcl(grid: OccupancyGrid, lidar: Pose, rng: np.random.Generator) -> LocalizationFilter:
    return _particle_filter(Amcl(grid, lidar, MCL_PARAMETERS, rng))


def _amcl(grid: OccupancyGrid, lidar: Pose, rng: np.random.Generator) -> LocalizationFilter:
    return _particle_filter(Amcl(grid, lidar, AMCL_PARAMETERS, rng))


def _amcl_with_relocalization(grid: OccupancyGrid, lidar: Pose, rng: np.random.Generator) -> LocalizationFilter:
    return _particle_filter(Localizer(grid, lidar, PRECISE_PARAMETERS, rng))


def _particle_filter(particle_filter: Amcl | Localizer) -> LocalizationFilter:
    return LocalizationFilter(
        lambda pose: particle_filter.initialize(pose, START_COVARIANCE),
        particle_filter.initialize_globally,
        lambda odometry, scan: particle_filter.update(odometry, scan).pose,
        lambda: particle_filter.particles.nbytes + particle_filter.weights.nbytes,
    )


FilterFactory = Callable[[OccupancyGrid, Pose, np.random.Generator], LocalizationFilter]
"""Makes a filter from the map, the lidar's pose in the base_link frame, and the source of its randomness."""

FILTERS: MappingProxyType[str, FilterFactory] = MappingProxyType(
    {
        "EKF, scan-matched": _ekf,
        "grid Markov, 0.25 m, 5°": _grid_markov,
        "MCL, 2,000 particles": _mcl,
        "AMCL": _amcl,
        "AMCL with relocalization": _amcl_with_relocalization,
    }
)
"""The compared filters by their displayed names."""


@dataclass(frozen=True, slots=True)
class FilterMetrics:
    """Metrics of one filter.

    Attributes:
        name: Key of the filter in `FILTERS`.
        rmse_m: Root mean square position error on the drives from a known start, m.
        p99_m: 99th percentile of the position errors on the drives from a known start, m.
        memory_bytes: Mean size of the filter's state on the drives from a known start, bytes.
        hertz: Number of scans with a filter update that fit into a second of processor time, 1/s.
        localized: Fraction of the drives from a global start at whose end the estimate is correct.
        recovered: Fraction of the drives with a kidnapping at whose end the estimate is correct.
    """

    name: str
    rmse_m: float
    p99_m: float
    memory_bytes: float
    hertz: float
    localized: float
    recovered: float


@dataclass(frozen=True, slots=True)
class PaperClaim:
    """A claim of the paper with the result of testing it.

    Attributes:
        text: Text of the claim, shortened.
        holds: Whether the claim was confirmed.
        evidence: The metrics by which the claim was tested.
    """

    text: str
    holds: bool
    evidence: str


@dataclass(frozen=True, slots=True)
class SimulatedDrive:
    """Measurements of a simulated robot with the ground truth.

    Attributes:
        measurements: [N] odometry and scan of the same instants.
        poses: [N] true poses of base_link at the scans, map frame.
    """

    measurements: tuple[tuple[Odometry, Scan], ...]
    poses: tuple[Pose, ...]


def run(settings: FilterComparisonSettings) -> Iterator[FilterMetrics]:
    """Run every filter on the same drives.

    Raises:
        InputError: The world cannot be used.
    """
    seeds = np.random.SeedSequence(settings.seed).spawn(settings.repetitions)
    plan = find_world(settings.world)
    grid = true_map(plan)
    undisturbed = [_record_drive(settings, seed, is_kidnapped=False) for seed in seeds]
    kidnapped = [_record_drive(settings, seed, is_kidnapped=True) for seed in seeds]
    lidar = build(replace(plan, boxes=()), np.random.default_rng(0)).robot.body.lidar
    for name, make in FILTERS.items():
        filters = [[make(grid, lidar, np.random.default_rng(seed)) for _ in range(3)] for seed in seeds]
        yield _metrics(name, filters, undisturbed, kidnapped)


def _metrics(
    name: str,
    filters: list[list[LocalizationFilter]],
    undisturbed: list[SimulatedDrive],
    kidnapped: list[SimulatedDrive],
) -> FilterMetrics:
    """Metrics of one filter.

    Args:
        name: Key of the filter in `FILTERS`.
        filters: For each seed three instances: for a known start, a global start, and the recovery from a kidnapping.
        undisturbed: The drive without a kidnapping for each seed.
        kidnapped: The drive with a kidnapping for each seed.
    """
    errors, seconds, memory, localized, recovered = [], [], [], [], []
    for (tracking, global_start, recovery), drive, kidnapped_drive in zip(filters, undisturbed, kidnapped, strict=True):
        tracking.start(drive.poses[0])
        global_start.start_globally()
        recovery.start(kidnapped_drive.poses[0])
        drive_errors, drive_seconds, drive_memory = _follow(tracking, drive)
        errors.append(drive_errors)
        seconds.append(drive_seconds)
        memory.append(drive_memory)
        localized.append(_follow(global_start, drive)[0][-1] < LOCALIZED_MAX_DISTANCE)
        recovered.append(_follow(recovery, kidnapped_drive)[0][-1] < LOCALIZED_MAX_DISTANCE)
    all_errors = np.concatenate(errors)
    return FilterMetrics(
        name,
        rmse_m=root_mean_square(all_errors),
        p99_m=float(np.quantile(all_errors, 0.99)),
        memory_bytes=float(np.mean(memory)),
        hertz=1.0 / float(np.quantile(np.concatenate(seconds), UPDATE_QUANTILE)),
        localized=float(np.mean(localized)),
        recovered=float(np.mean(recovered)),
    )


def _follow(localization_filter: LocalizationFilter, drive: SimulatedDrive) -> tuple[Floats, Floats, float]:
    """[N] position errors, m; [N] processor times of the scans, s; mean size of the filter's state, bytes."""
    errors, seconds, memory = [], [], []
    for (odometry, scan), truth in zip(drive.measurements, drive.poses, strict=True):
        before = time.thread_time()
        pose = localization_filter.update(odometry, scan)
        seconds.append(time.thread_time() - before)
        errors.append(pose.distance_to(truth))
        memory.append(localization_filter.memory())
    return np.array(errors), np.array(seconds), float(np.mean(memory))


def _record_drive(
    settings: FilterComparisonSettings, seed: np.random.SeedSequence, *, is_kidnapped: bool
) -> SimulatedDrive:
    """Record a wandering robot, kidnapped half-way if ``is_kidnapped``."""
    boxes_rng, world_rng, path_rng = (np.random.default_rng(child) for child in seed.spawn(3))
    plan = place_boxes(find_world(settings.world), settings.boxes, boxes_rng)
    simulation = build(plan, world_rng)
    robot = WanderingRobot(simulation, RandomWalk(path_rng))
    recorded: list[tuple[Odometry, Scan, Pose]] = []
    if is_kidnapped:
        recorded += robot.measurements(settings.seconds / 2.0)
        simulation.physics.place_robot(random_cell_pose(plan, path_rng), None)
    recorded += robot.measurements(settings.seconds)
    return SimulatedDrive(
        tuple((odometry, scan) for odometry, scan, _ in recorded), tuple(truth for _, _, truth in recorded)
    )


def claims(metrics: list[FilterMetrics]) -> list[PaperClaim]:
    """Test the three claims of section 5.A on the metrics of all filters, in the order of `FILTERS`."""
    ekf, markov, mcl, amcl, _ = metrics
    return [
        PaperClaim(
            "Unlike Kalman filters it represents multi-modal beliefs, and can localize a robot globally.",
            amcl.localized > ekf.localized and amcl.localized >= 0.9,
            f"localized from a global start: AMCL {amcl.localized:.0%}, EKF {ekf.localized:.0%}",
        ),
        PaperClaim(
            "It needs drastically less memory than grid Markov localization, and integrates measurements faster.",
            amcl.memory_bytes < markov.memory_bytes / 10.0 and amcl.hertz > markov.hertz,
            f"{amcl.memory_bytes / 1e3:.0f} against {markov.memory_bytes / 1e3:.0f} kB, "
            f"{amcl.hertz:.0f} against {markov.hertz:.0f} scans/s",
        ),
        PaperClaim(
            "It is more accurate than Markov localization with fixed cells.",
            min(amcl.rmse_m, mcl.rmse_m) < markov.rmse_m,
            f"rmse: AMCL {amcl.rmse_m:.3f} m, MCL {mcl.rmse_m:.3f} m, Markov {markov.rmse_m:.3f} m",
        ),
    ]
