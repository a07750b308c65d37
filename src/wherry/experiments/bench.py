"""Benchmarks of wherry and of external implementations on the same tasks.

External implementations are measured where they are installed. Otherwise their published times are used, which were
measured on other machines.
"""

from __future__ import annotations

import importlib.util
import math
import os
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import permutations
from pathlib import Path

import numpy as np

from wherry.domains.delivery import DeliveryHeuristic, boxes_left, delivery_grid
from wherry.domains.taxi import taxi_grid
from wherry.errors import InputError
from wherry.experiments.data_folder import check_logs
from wherry.experiments.localization.recorded import INTEL
from wherry.experiments.localization.speed import MAX_RANGE, beam_angles, straight_drive
from wherry.experiments.machine import machine_load
from wherry.experiments.mapping.speed import measure_external, measure_own
from wherry.floorplan.world_files import find_world
from wherry.localization.amcl import Amcl
from wherry.localization.parameters import AmclParameters
from wherry.oomdp.conditional_models import PerStateModel
from wherry.pipelines.grids.learning import LearningExperiment, LearningSettings
from wherry.planning.prediction_cache import PredictionCache
from wherry.planning.search import a_star
from wherry.planning.state_space import StateSpace
from wherry.planning.value_iteration import ValueIteration
from wherry.robot import Odometry, Scan, Velocity
from wherry.simulation.ground_truth import true_map
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import IDENTITY, Floats, Pose

PARTICLES, BEAMS = 2_000, 60
UPDATES = 60
STEP = 0.05  # m, distance driven between two updates
EFFICIENT_RL_SCRIPT = Path(__file__).with_name("learning") / "efficient_rl_taxi.py"  # run by another interpreter
EFFICIENT_RL, DIUK = "DOORMAX, efficient_rl", "DOORMAX, Diuk et al. 2008"


class TimingSource(Enum):
    """The origin of a timing, as shown in tables and JSON."""

    MEASURED = "here"
    PUBLISHED = "published, on another machine"


Progress = Callable[[str], None]
"""Called with a description of the current measurement."""


@dataclass(frozen=True, slots=True)
class BenchSettings:
    """External data and programs.

    Attributes:
        data: Folder of recorded logs.
        efficient_rl: Python interpreter of an environment in which efficient_rl is installed; None to use its
            published times.
    """

    data: Path
    efficient_rl: Path | None = None


@dataclass(frozen=True, slots=True)
class Timing:
    """The time that one implementation takes for a task.

    Attributes:
        task: Description of the task.
        implementation: Name of the implementation.
        milliseconds: Median time, ms.
        source: Whether the time was measured in this run or published.
        is_own: Whether the implementation is wherry's.
    """

    task: str
    implementation: str
    milliseconds: float
    source: TimingSource = TimingSource.MEASURED
    is_own: bool = False

    @classmethod
    def own(cls, task: str, milliseconds: float, variant: str = "") -> Timing:
        """Return a measured time of wherry, in ms, with the variant of the implementation if there are several."""
        return cls(task, f"wherry, {variant}" if variant else "wherry", milliseconds, is_own=True)

    @classmethod
    def published(cls, task: str, implementation: str, milliseconds: float) -> Timing:
        """Return a published time of an external implementation, in ms."""
        return cls(task, implementation, milliseconds, TimingSource.PUBLISHED)


@dataclass(frozen=True, slots=True)
class BenchResult:
    """The timings of one benchmark.

    Attributes:
        name: Key of `BENCHES`.
        timings: Timings, grouped by task; those of wherry come first in each group.
        load: Description of the machine's load.
    """

    name: str
    timings: tuple[Timing, ...]
    load: str

    def ratio(self, timing: Timing) -> float | None:
        """Return a time divided by the first of wherry's times for the same task; None for wherry's own times."""
        own = next((other for other in self.timings if other.is_own and other.task == timing.task), None)
        return None if timing.is_own or own is None else timing.milliseconds / own.milliseconds


def learning(settings: BenchSettings, progress: Progress) -> list[Timing]:
    """Measure a learning step (predict, learn, plan): median over repetitions of the mean time per step."""
    timings = []
    for size, published in ((5, {EFFICIENT_RL: 27.45, DIUK: 13.88}), (10, {EFFICIENT_RL: 320.6, DIUK: 293.72})):
        task = f"a step of Taxi {size}×{size}"
        for learner in ("doormax", "doormax-near-miss", "bayes"):
            progress(f"{learner}, {task}")
            experiment = LearningExperiment(LearningSettings(size=size, learner=learner, repetitions=5))
            list(experiment.repetitions())
            timings.append(Timing.own(task, experiment.result().ms_per_step, learner))
        external = {name: Timing.published(task, name, milliseconds) for name, milliseconds in published.items()}
        if settings.efficient_rl is not None and size == 5:  # its tables of the large grid take gigabytes
            progress(f"efficient_rl, {task}")
            external[EFFICIENT_RL] = Timing(task, EFFICIENT_RL, _efficient_rl(settings.efficient_rl))
        timings += external.values()
    return timings


def _efficient_rl(interpreter: Path) -> float:
    """Return the mean time per step of efficient_rl, run in its own environment, ms.

    Raises:
        InputError: The interpreter cannot be run, or efficient_rl is not installed in its environment.
    """
    single_thread = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    try:
        finished = subprocess.run(  # noqa: S603 - the interpreter is the user's own
            [interpreter, EFFICIENT_RL_SCRIPT],
            capture_output=True,
            text=True,
            env={**os.environ, **single_thread},
            check=False,
        )
    except OSError as error:
        raise InputError(interpreter, "efficient_rl", error.strerror or str(error)) from error
    if finished.returncode:
        raise InputError(interpreter, "efficient_rl", (finished.stderr.strip().splitlines() or ["failed"])[-1])
    return float(finished.stdout)


def planning(settings: BenchSettings, progress: Progress) -> list[Timing]:
    """Measure optimal policies for all states of the large Taxi grid, and the plan of a whole delivery."""
    return [*_value_iteration(progress), _delivery_plan(progress)]


def _value_iteration(progress: Progress) -> list[Timing]:
    """Measure value iteration on learnt rules, with generating the states and without, beside published planners."""
    progress("value iteration")
    experiment = LearningExperiment(LearningSettings(learner="bayes", repetitions=1))
    list(experiment.repetitions())
    learner = experiment.learner
    if learner is None:
        raise RuntimeError("the learning experiment has no learner of rules")
    grid, space = taxi_grid(10), StateSpace()
    marks = sorted(grid.plan.marks)
    starts = [grid.state_of((0, 0), passenger, destination) for passenger, destination in permutations(marks, 2)]

    def solve() -> None:
        planner = ValueIteration(learner, optimistic=False, space=space)
        for start in starts:
            planner.policy(start)

    first = _milliseconds(solve, 1)
    again = _milliseconds(solve, 5)
    task = f"optimal policies for {len(space.states):,} Taxi states from learnt rules"
    return [
        Timing.own(task, first, "with the states met for the first time"),
        Timing.own(task, again, "with the states known"),
        Timing.published(task, "simple_rl, 10,100 states", 38_000.0),
        Timing.published(task, "BURLAP, 1,950 states", 37_000.0),
    ]


def _delivery_plan(progress: Progress) -> Timing:
    """Measure A* on a whole delivery."""
    progress("A*")
    plan = find_world("rooms")
    delivery = delivery_grid(plan, 4)
    state = delivery.draw_initial_state(np.random.default_rng(0))
    cache = PredictionCache(PerStateModel(delivery.domain, delivery))
    milliseconds = _milliseconds(lambda: a_star(cache, state, boxes_left, DeliveryHeuristic()), 3)
    return Timing.own("the plan of a delivery of 4 boxes, rooms", milliseconds, "A*")


def slam(settings: BenchSettings, progress: Progress) -> list[Timing]:
    """Measure mapping per scan of the Intel log, and yag_slam's where it is installed."""
    check_logs(settings.data, [INTEL])
    progress("mapping Intel")
    log, task = settings.data / INTEL, "a scan of Intel"
    own = [Timing.own(task, milliseconds, method) for method, milliseconds in measure_own(log).items()]
    external = [Timing(task, name, milliseconds) for name, milliseconds in measure_external(log).items()]
    return own + external


def localization(settings: BenchSettings, progress: Progress) -> list[Timing]:
    """Measure an AMCL update (predict, reweight, resample), and that of PyPI's amcl where it is installed."""
    task = f"an update, {PARTICLES:,} particles, {BEAMS} beams"
    progress(task)
    grid = true_map(find_world("rooms"))
    odometry, scans = straight_drive(grid, UPDATES, STEP, BEAMS)
    timings = [Timing.own(task, _wherry_amcl(grid, odometry, scans))]
    if importlib.util.find_spec("amcl") is not None:
        progress("PyPI amcl")
        timings.append(Timing(task, "PyPI amcl", _pypi_amcl(grid, odometry, scans)))
    return [*timings, Timing.published(task, "ROS 1 amcl", 9.0)]


BENCHES: Mapping[str, Callable[[BenchSettings, Progress], list[Timing]]] = {
    "learning": learning,
    "slam": slam,
    "localization": localization,
    "planning": planning,
}
"""The benchmarks by name; each takes its settings and a progress callback, and returns timings grouped by task."""


def run_bench(name: str, settings: BenchSettings, progress: Progress) -> BenchResult:
    """Run a benchmark.

    Args:
        name: Key of `BENCHES`.
        settings: External data and programs.
        progress: Called with a description of the current measurement.

    Raises:
        InputError: A log is missing, or an external program cannot be run.
    """
    return BenchResult(name, tuple(BENCHES[name](settings, progress)), machine_load())


def _milliseconds(work: Callable[[], object], repetitions: int) -> float:
    """Return the median processor time of some work, ms."""
    durations = []
    for _ in range(repetitions):
        started = time.thread_time()
        work()
        durations.append(1e3 * (time.thread_time() - started))
    return float(np.median(durations))


def _wherry_amcl(grid: OccupancyGrid, poses: Sequence[Pose], scans: Sequence[Floats]) -> float:
    """Return the median time of an update of wherry's AMCL, ms.

    Args:
        grid: The map.
        poses: Odometry at every scan, in the map frame.
        scans: [`BEAMS`] ranges of every scan, m.
    """
    parameters = AmclParameters(
        min_particles=PARTICLES,
        max_particles=PARTICLES,
        max_beams=BEAMS,
        update_min_d=0.0,
        update_min_a=0.0,
        initial_pose=poses[0],
    )
    amcl = Amcl(grid, IDENTITY, parameters, np.random.default_rng(0))
    durations = []
    for index, (pose, ranges) in enumerate(zip(poses, scans, strict=True)):
        scan = Scan(0.1 * index, ranges, -math.pi, 2 * math.pi / BEAMS, 0.05, MAX_RANGE)
        started = time.perf_counter()
        amcl.update(Odometry(0.1 * index, pose, Velocity()), scan)
        durations.append(1e3 * (time.perf_counter() - started))
    return float(np.median(durations[1:]))  # the first update compiles the kernels


def _pypi_amcl(grid: OccupancyGrid, poses: Sequence[Pose], scans: Sequence[Floats]) -> float:
    """Return the median time of an update of PyPI's amcl on the same drive, ms.

    Numbers of particles and beams are those of `_wherry_amcl`, other parameters amcl's own defaults.
    """
    import amcl  # noqa: PLC0415 - optional

    motion = amcl.MotionParameters(alpha1=0.2, alpha2=0.2, alpha3=0.2, alpha4=0.2, alpha5=0.2)
    laser = amcl.LaserParameters(
        z_hit=0.5,
        z_short=0.05,
        z_max=0.05,
        z_rand=0.5,
        sigma_hit=0.2,
        lambda_short=0.1,
        chi_outlier=0.0,
        max_beams=BEAMS,
    )
    particle_filter = amcl.AMCL(
        min_particles=PARTICLES,
        max_particles=PARTICLES,
        alpha_slow=0.0,
        alpha_fast=0.0,
        motion_params=motion,
        laser_params=laser,
        robot_model_type="differential",
    )
    cells = np.where(grid.occupied, 100, np.where(grid.free, 0, -1))
    particle_filter.set_map(
        amcl.create_occupancy_grid_from_list(cells.tolist(), grid.resolution, grid.origin.x, grid.origin.y)
    )
    particle_filter.set_laser_pose(amcl.Vector3D(0.0, 0.0, 0.0))
    particle_filter.set_initial_pose(
        amcl.Vector3D(poses[0].x, poses[0].y, poses[0].theta), amcl.create_diagonal_covariance(0.1, 0.1, 0.05)
    )
    durations, angles = [], beam_angles(BEAMS)
    for pose, ranges in zip(poses, scans, strict=True):
        readings = np.column_stack([np.minimum(ranges, MAX_RANGE), angles]).tolist()
        scan, odometry = (
            amcl.create_laser_scan_from_list(readings, MAX_RANGE),
            amcl.Vector3D(pose.x, pose.y, pose.theta),
        )
        started = time.perf_counter()
        particle_filter.update(scan, odometry)
        durations.append(1e3 * (time.perf_counter() - started))
    return float(np.median(durations[1:]))
