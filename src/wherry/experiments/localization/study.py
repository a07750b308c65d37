"""The paper's section 5.A as an experiment: Kalman filter, grid Markov localization, Monte Carlo localization.

All filters get the same scans and odometry of a simulated robot among boxes that are not on its map, three times: from
a known start, from anywhere, and with the robot put somewhere else on the way. The paper's three claims are then put
to the test; where one does not hold, the result says so.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from wherry.experiments.localization.kidnapping import Wanderer, somewhere, true_map
from wherry.floorplan.generation import place_boxes
from wherry.floorplan.world_files import find_world
from wherry.localization.amcl import Amcl
from wherry.localization.ekf import EkfLocalization
from wherry.localization.grid_markov import GridMarkov
from wherry.localization.localizer import Localizer
from wherry.localization.parameters import PRECISE
from wherry.navigation.controller import safe_velocity
from wherry.robot import Odometry, Scan
from wherry.simulation import build
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose

CLOSE = np.diag([0.05**2, 0.05**2, 0.03**2])
FIXED_COUNT = 2000  # particles of plain MCL
ADAPTIVE_MOST = 20_000  # particles of AMCL when it may be anywhere; it soon needs fewer
RECOVERING = replace(PRECISE, recovery_alpha_slow=0.01, recovery_alpha_fast=0.3, max_particles=ADAPTIVE_MOST)
FIXED = replace(PRECISE, min_particles=FIXED_COUNT, max_particles=FIXED_COUNT, refine=False)
FOUND = 0.5  # m; nearer to the truth than this at the end a filter has found the robot
WEIGHED = 0.95  # quantile of the time that an update takes; it falls among the scans that are weighed, not passed over


@dataclass(frozen=True, slots=True)
class Settings:
    """What to run.

    Attributes:
        world: A built-in world's name, or a world file.
        boxes: Boxes that are not on the map.
        seconds: s, simulated, of each of the three drives.
        repetitions: Drives of each kind, with seeds of their own.
        seed: Of everything that is random.
    """

    world: str = "rooms"
    boxes: int = 4
    seconds: float = 60.0
    repetitions: int = 5
    seed: int = 0


@dataclass(frozen=True, slots=True)
class Contender:
    """One filter, ready to be started.

    Attributes:
        begin: Start at a known pose.
        begin_anywhere: Start without one; a filter that cannot starts at the map's middle, knowing little.
        update: Take in a scan; base_link in the map frame.
        memory: Bytes that the belief takes now.
    """

    begin: Callable[[Pose], None]
    begin_anywhere: Callable[[], None]
    update: Callable[[Odometry, Scan], Pose]
    memory: Callable[[], int]


def _ekf(grid: OccupancyGrid, lidar: Pose, _rng: np.random.Generator) -> Contender:
    ekf = EkfLocalization(grid, lidar, PRECISE)
    height, width = grid.probability.shape
    middle = grid.origin @ Pose(width * grid.resolution / 2.0, height * grid.resolution / 2.0)
    wide = np.diag([width * grid.resolution, height * grid.resolution, math.pi]) ** 2 / 12.0
    return Contender(
        lambda pose: ekf.initialize(pose, CLOSE), lambda: ekf.initialize(middle, wide), ekf.update, lambda: ekf.memory
    )


def _markov(grid: OccupancyGrid, lidar: Pose, _rng: np.random.Generator) -> Contender:
    markov = GridMarkov(grid, lidar, PRECISE)
    return Contender(
        lambda pose: markov.initialize(pose, CLOSE), markov.initialize_globally, markov.update, lambda: markov.memory
    )


def _mcl(grid: OccupancyGrid, lidar: Pose, rng: np.random.Generator) -> Contender:
    return _particles(Amcl(grid, lidar, FIXED, rng))


def _amcl(grid: OccupancyGrid, lidar: Pose, rng: np.random.Generator) -> Contender:
    return _particles(Amcl(grid, lidar, RECOVERING, rng))


def _particles(amcl: Amcl) -> Contender:
    return Contender(
        lambda pose: amcl.initialize(pose, CLOSE),
        amcl.initialize_globally,
        lambda odometry, scan: amcl.update(odometry, scan).pose,
        lambda: amcl.particles.nbytes + amcl.weights.nbytes,
    )


def _watched(grid: OccupancyGrid, lidar: Pose, rng: np.random.Generator) -> Contender:
    localizer = Localizer(grid, lidar, PRECISE, rng)
    return Contender(
        lambda pose: localizer.initialize(pose, CLOSE),
        localizer.initialize_globally,
        lambda odometry, scan: localizer.update(odometry, scan).pose,
        lambda: localizer.amcl.particles.nbytes + localizer.amcl.weights.nbytes,
    )


CONTENDERS: MappingProxyType[str, Callable[[OccupancyGrid, Pose, np.random.Generator], Contender]] = MappingProxyType(
    {
        "EKF, scan-matched": _ekf,
        "grid Markov, 0.25 m, 5°": _markov,
        "MCL, 2,000 particles": _mcl,
        "AMCL": _amcl,
        "AMCL, watched": _watched,
    }
)


@dataclass(frozen=True, slots=True)
class Row:
    """One filter's figures.

    Attributes:
        name: A key of `CONTENDERS`.
        rmse_m: From a known start.
        p99_m: 99th percentile of the errors there.
        memory_bytes: Of the belief, in the mean over that drive.
        hertz: Scans a second that it can weigh.
        found: Share of the drives from anywhere at whose end it knew where the robot was.
        recovered: Share of the drives with a kidnapping at whose end it did.
    """

    name: str
    rmse_m: float
    p99_m: float
    memory_bytes: float
    hertz: float
    found: float
    recovered: float


@dataclass(frozen=True, slots=True)
class Claim:
    """A claim of the paper, and whether it held.

    Attributes:
        text: The paper's, shortened.
        holds: Whether it did.
        figures: What that rests on.
    """

    text: str
    holds: bool
    figures: str


@dataclass(frozen=True, slots=True)
class Drive:
    """What a robot measured on its way.

    Attributes:
        measurements: Odometry and scan of the same instants.
        truth: base_link in the map frame then.
    """

    measurements: tuple[tuple[Odometry, Scan], ...]
    truth: tuple[Pose, ...]


def run(settings: Settings) -> Iterator[Row]:
    """Let every filter have the same drives; one row each.

    Raises:
        InputError: The world cannot be used.
    """
    seeds = np.random.SeedSequence(settings.seed).spawn(settings.repetitions)
    plan = find_world(settings.world)
    grid = true_map(plan)
    calm = [_drive(settings, seed, kidnapped=False) for seed in seeds]
    kidnapped = [_drive(settings, seed, kidnapped=True) for seed in seeds]
    lidar = build(replace(plan, boxes=()), np.random.default_rng(0)).robot.body.lidar
    for name, make in CONTENDERS.items():
        make_new = [make(grid, lidar, np.random.default_rng(seed)) for seed in seeds for _ in range(3)]
        yield _row(name, iter(make_new), calm, kidnapped)


def _row(name: str, contenders: Iterator[Contender], calm: list[Drive], kidnapped: list[Drive]) -> Row:
    errors, seconds, memory, found, recovered = [], [], [], [], []
    for undisturbed, disturbed in zip(calm, kidnapped, strict=True):
        tracker, searcher, victim = next(contenders), next(contenders), next(contenders)
        tracker.begin(undisturbed.truth[0])
        searcher.begin_anywhere()
        victim.begin(disturbed.truth[0])
        tracked, took, held = _follow(tracker, undisturbed)
        errors.append(tracked)
        seconds.append(took)
        memory.append(held)
        found.append(_follow(searcher, undisturbed)[0][-1] < FOUND)
        recovered.append(_follow(victim, disturbed)[0][-1] < FOUND)
    every = np.concatenate(errors)
    return Row(
        name,
        rmse_m=math.sqrt(float(np.mean(every**2))),
        p99_m=float(np.quantile(every, 0.99)),
        memory_bytes=float(np.mean(memory)),
        hertz=1.0 / float(np.quantile(np.concatenate(seconds), WEIGHED)),
        found=float(np.mean(found)),
        recovered=float(np.mean(recovered)),
    )


def _follow(contender: Contender, drive: Drive) -> tuple[Floats, Floats, float]:
    """[N] m errors, [N] s of a core that the updates took, bytes in the mean."""
    errors, seconds, memory = [], [], []
    for (odometry, scan), truth in zip(drive.measurements, drive.truth, strict=True):
        before = time.thread_time()
        pose = contender.update(odometry, scan)
        seconds.append(time.thread_time() - before)
        errors.append(pose.distance_to(truth))
        memory.append(contender.memory())
    return np.array(errors), np.array(seconds), float(np.mean(memory))


def _drive(settings: Settings, seed: np.random.SeedSequence, *, kidnapped: bool) -> Drive:
    """Record a wandering robot; half-way it may be put somewhere else."""
    boxes_rng, world_rng, way_rng = (np.random.default_rng(child) for child in seed.spawn(3))
    plan = place_boxes(find_world(settings.world), settings.boxes, boxes_rng)
    simulation = build(plan, world_rng)
    wanderer = Wanderer(way_rng)
    measurements: list[tuple[Odometry, Scan]] = []
    truth: list[Pose] = []
    odometry: Odometry | None = None
    while simulation.time < settings.seconds:
        if kidnapped and simulation.time >= settings.seconds / 2.0:
            simulation.physics.place_robot(somewhere(plan, way_rng), None)
            kidnapped = False
        measurement = simulation.robot.receive()
        if isinstance(measurement, Odometry):
            odometry = measurement
        elif odometry is not None:
            measurements.append((odometry, measurement))
            truth.append(simulation.physics.robot_pose)
            velocity = wanderer.velocity(measurement)
            simulation.robot.command(safe_velocity(velocity, measurement, simulation.robot.body))
    return Drive(tuple(measurements), tuple(truth))


def claims(rows: list[Row]) -> list[Claim]:
    """The three claims of section 5.A, tried on the rows of all contenders."""
    ekf, markov, mcl, amcl, _ = rows
    return [
        Claim(
            "Unlike Kalman filters it represents multi-modal beliefs, and can localize a robot globally.",
            amcl.found > ekf.found and amcl.found >= 0.9,
            f"found from anywhere: AMCL {amcl.found:.0%}, EKF {ekf.found:.0%}",
        ),
        Claim(
            "It needs drastically less memory than grid Markov localization, and integrates measurements faster.",
            amcl.memory_bytes < markov.memory_bytes / 10.0 and amcl.hertz > markov.hertz,
            f"{amcl.memory_bytes / 1e3:.0f} against {markov.memory_bytes / 1e3:.0f} kB, "
            f"{amcl.hertz:.0f} against {markov.hertz:.0f} scans/s",
        ),
        Claim(
            "It is more accurate than Markov localization with fixed cells.",
            min(amcl.rmse_m, mcl.rmse_m) < markov.rmse_m,
            f"rmse: AMCL {amcl.rmse_m:.3f} m, MCL {mcl.rmse_m:.3f} m, Markov {markov.rmse_m:.3f} m",
        ),
    ]
