"""How long things take, beside others: run one after the other where they are installed.

Where others are not installed, figures that were published stand for them; these come from other machines.
"""

from __future__ import annotations

import importlib.util
import math
import os
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from pathlib import Path

import numpy as np

from wherry.domains.delivery import DeliveryHeuristic, boxes_left, delivery_grid
from wherry.domains.taxi import taxi_grid
from wherry.errors import InputError
from wherry.experiments.localization.speed import RANGE, beam_angles, straight_drive
from wherry.experiments.machine import load_in_words
from wherry.experiments.mapping.speed import measure
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
STEP = 0.05  # m, from one update to the next
INTEL = Path("intel/intel_910_rawodom.clf.gz")
EFFICIENT_RL = Path(__file__).with_name("learning") / "efficient_rl_taxi.py"  # run by another interpreter
RIVAL, DIUK = "DOORMAX, efficient_rl", "DOORMAX, Diuk et al. 2008"
MEASURED, ELSEWHERE = "here", "published, on another machine"

Progress = Callable[[str], None]
"""Told what is being done."""


@dataclass(frozen=True, slots=True)
class Outside:
    """What measurements need that is not part of wherry.

    Attributes:
        data: The folder of recorded logs.
        efficient_rl: The Python interpreter of an environment in which efficient_rl is installed; None without one.
    """

    data: Path
    efficient_rl: Path | None = None


@dataclass(frozen=True, slots=True)
class Time:
    """How long one thing takes.

    Attributes:
        task: What is done.
        who: Who does it.
        milliseconds: The median.
        source: Whether it was measured here.
    """

    task: str
    who: str
    milliseconds: float
    source: str = MEASURED

    @property
    def ours(self) -> bool:
        """Whether it is wherry's."""
        return self.who.startswith("wherry")


@dataclass(frozen=True, slots=True)
class Bench:
    """The times of one kind of work.

    Attributes:
        name: A key of `BENCHES`.
        times: All of them, ours before others' in every task.
        load: What the machine was busy with, in words.
    """

    name: str
    times: tuple[Time, ...]
    load: str

    def ratio(self, other: Time) -> float | None:
        """How many times longer others take than our first for the same task; None for ours."""
        ours = next((row for row in self.times if row.ours and row.task == other.task), None)
        return None if other.ours or ours is None else other.milliseconds / ours.milliseconds


def learning(outside: Outside, progress: Progress) -> list[Time]:
    """A whole learning step: predict, learn, plan; the median of repetitions' averages."""
    times = []
    for size, published in ((5, {RIVAL: 27.45, DIUK: 13.88}), (10, {RIVAL: 320.6, DIUK: 293.72})):
        task = f"a step of Taxi {size}×{size}"
        for learner in ("doormax", "doormax-near-miss", "bayes"):
            progress(f"{learner}, {task}")
            experiment = LearningExperiment(LearningSettings(size=size, learner=learner, repetitions=5))
            list(experiment.repetitions())
            times.append(Time(task, f"wherry, {learner}", experiment.result().ms_per_step))
        others = {who: Time(task, who, milliseconds, ELSEWHERE) for who, milliseconds in published.items()}
        if outside.efficient_rl is not None and size == 5:  # its tables of the large grid take gigabytes
            progress(f"efficient_rl, {task}")
            others[RIVAL] = Time(task, RIVAL, _efficient_rl(outside.efficient_rl))
        times += others.values()
    return times


def _efficient_rl(interpreter: Path) -> float:
    """What a step takes efficient_rl in an environment of its own, ms.

    Raises:
        InputError: It cannot be run there.
    """
    one_core = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    try:
        done = subprocess.run(  # noqa: S603 - the interpreter is the user's own
            [interpreter, EFFICIENT_RL], capture_output=True, text=True, env={**os.environ, **one_core}, check=False
        )
    except OSError as error:
        raise InputError(interpreter, "efficient_rl", error.strerror or str(error)) from error
    if done.returncode:
        raise InputError(interpreter, "efficient_rl", (done.stderr.strip().splitlines() or ["failed"])[-1])
    return float(done.stdout)


def planning(_outside: Outside, progress: Progress) -> list[Time]:
    """Optimal policies for all states of the large Taxi grid, and the plan of a whole delivery."""
    progress("value iteration")
    experiment = LearningExperiment(LearningSettings(learner="bayes", repetitions=1))
    list(experiment.repetitions())
    learner = experiment.learner
    assert learner is not None  # noqa: S101 - bayes learns rules
    grid, space = taxi_grid(10), StateSpace()
    marks = sorted(grid.plan.marks)
    starts = [grid.state_of((0, 0), waits, wants) for waits, wants in permutations(marks, 2)]

    def solve() -> None:
        planner = ValueIteration(learner, optimistic=False, space=space)
        for start in starts:
            planner.policy(start)

    first = _milliseconds(solve, 1)
    again = _milliseconds(solve, 5)
    task = f"optimal policies for {len(space.states):,} Taxi states, of learnt rules"
    progress("A*")
    plan = find_world("rooms")
    delivery = delivery_grid(plan, 4)
    state, cache = delivery.start(np.random.default_rng(0)), PredictionCache(PerStateModel(delivery.domain, delivery))
    search = _milliseconds(lambda: a_star(cache, state, boxes_left, DeliveryHeuristic()), 3)
    return [
        Time(task, "wherry, with the states met for the first time", first),
        Time(task, "wherry, with the states known", again),
        Time(task, "simple_rl, 10,100 states", 38_000.0, ELSEWHERE),
        Time(task, "BURLAP, 1,950 states", 37_000.0, ELSEWHERE),
        Time("the plan of a delivery of 4 boxes, rooms", "wherry, A*", search),
    ]


def slam(outside: Outside, progress: Progress) -> list[Time]:
    """A scan of the Intel log; beside yag_slam where that is installed."""
    progress("mapping Intel")
    return [Time("a scan of Intel", who, milliseconds) for who, milliseconds in measure(outside.data / INTEL).items()]


def localization(_outside: Outside, progress: Progress) -> list[Time]:
    """One update: predict, weigh, resample; beside the amcl of the Python Package Index where that is installed."""
    task = f"an update, {PARTICLES:,} particles, {BEAMS} beams"
    progress(task)
    grid = true_map(find_world("rooms"))
    odometry, scans = straight_drive(grid, UPDATES, STEP, BEAMS)
    times = [Time(task, "wherry", _wherry_amcl(grid, odometry, scans))]
    if importlib.util.find_spec("amcl") is not None:
        progress("PyPI amcl")
        times.append(Time(task, "PyPI amcl", _pypi_amcl(grid, odometry, scans)))
    return [*times, Time(task, "ROS 1 amcl", 9.0, ELSEWHERE)]


BENCHES: Mapping[str, Callable[[Outside, Progress], list[Time]]] = {
    "learning": learning,
    "slam": slam,
    "localization": localization,
    "planning": planning,
}
"""The kinds of work whose time is measured."""


def run(name: str, outside: Outside, progress: Progress) -> Bench:
    """Measure.

    Args:
        name: A key of `BENCHES`.
        outside: What measurements need that is not part of wherry.
        progress: Told what is being done.

    Raises:
        InputError: A log is missing, or another library cannot be run.
    """
    times = BENCHES[name](outside, progress)
    return Bench(name, tuple(times), load_in_words())


def _milliseconds(work: Callable[[], object], times: int) -> float:
    """The median time that some work takes of a core."""
    taken = []
    for _ in range(times):
        began = time.thread_time()
        work()
        taken.append(1e3 * (time.thread_time() - began))
    return float(np.median(taken))


def _wherry_amcl(grid: OccupancyGrid, poses: Sequence[Pose], scans: Sequence[Floats]) -> float:
    parameters = replace(
        AmclParameters(), min_particles=PARTICLES, max_particles=PARTICLES, max_beams=BEAMS, update_min_d=0.0,
        update_min_a=0.0, initial_pose=poses[0],
    )  # fmt: skip
    amcl = Amcl(grid, IDENTITY, parameters, np.random.default_rng(0))
    taken = []
    for at, (pose, ranges) in enumerate(zip(poses, scans, strict=True)):
        scan = Scan(0.1 * at, ranges, -math.pi, 2 * math.pi / BEAMS, 0.05, RANGE)
        began = time.perf_counter()
        amcl.update(Odometry(0.1 * at, pose, Velocity()), scan)
        taken.append(1e3 * (time.perf_counter() - began))
    return float(np.median(taken[1:]))  # the first compiles


def _pypi_amcl(grid: OccupancyGrid, poses: Sequence[Pose], scans: Sequence[Floats]) -> float:
    """The same drive, with the same numbers of particles and beams, and amcl's own defaults."""
    import amcl  # noqa: PLC0415 - optional

    motion = amcl.MotionParameters(alpha1=0.2, alpha2=0.2, alpha3=0.2, alpha4=0.2, alpha5=0.2)
    laser = amcl.LaserParameters(
        z_hit=0.5, z_short=0.05, z_max=0.05, z_rand=0.5, sigma_hit=0.2, lambda_short=0.1, chi_outlier=0.0,
        max_beams=BEAMS,
    )  # fmt: skip
    other = amcl.AMCL(
        min_particles=PARTICLES, max_particles=PARTICLES, alpha_slow=0.0, alpha_fast=0.0, motion_params=motion,
        laser_params=laser, robot_model_type="differential",
    )  # fmt: skip
    cells = np.where(grid.occupied, 100, np.where(grid.free, 0, -1))
    other.set_map(amcl.create_occupancy_grid_from_list(cells.tolist(), grid.resolution, grid.origin.x, grid.origin.y))
    other.set_laser_pose(amcl.Vector3D(0.0, 0.0, 0.0))
    other.set_initial_pose(
        amcl.Vector3D(poses[0].x, poses[0].y, poses[0].theta), amcl.create_diagonal_covariance(0.1, 0.1, 0.05)
    )
    taken, angles = [], beam_angles(BEAMS)
    for pose, ranges in zip(poses, scans, strict=True):
        readings = np.column_stack([np.minimum(ranges, RANGE), angles]).tolist()
        scan, odometry = amcl.create_laser_scan_from_list(readings, RANGE), amcl.Vector3D(pose.x, pose.y, pose.theta)
        began = time.perf_counter()
        other.update(scan, odometry)
        taken.append(1e3 * (time.perf_counter() - began))
    return float(np.median(taken[1:]))
