"""A simulated delivery: survey, delivery episode, score and report.

The robot's code gets its order but no ground truth; the scorer gets the ground truth.
"""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import chain, count
from pathlib import Path

import numpy as np

from wherry.errors import InputError
from wherry.files import ensure_writable_folder, write_atomically
from wherry.floorplan.plan import Cell, FloorPlan
from wherry.floorplan.world_files import find_world
from wherry.learning.rule_files.files import save_rules
from wherry.learning.rules import RuleLearner
from wherry.pipelines.delivery.agent import DeliveryEpisode, delivery_learner, run_started
from wherry.pipelines.delivery.page import draw_pictures, render_page
from wherry.pipelines.delivery.result import DeliveryResult
from wherry.pipelines.delivery.scorer import DeliveryScorer
from wherry.realization.mission import Mission, SurveyedWorld, order_from_plan
from wherry.robot import Robot
from wherry.simulation.seeded_worlds import seed_world
from wherry.simulation.simulator import Simulation, build
from wherry.space.map_files import load_map, save_map
from wherry.space.occupancy import OccupancyGrid
from wherry.trace.records import Sink, combine_sinks, null_sink

RESULT_FILE = "result.json"
RULES_FILE = "rules.json"
MAP_FILE = "map.yaml"
PICTURE_FILE = "delivery.svg"
REPORT_FILE = "report.html"


@dataclass(frozen=True, slots=True)
class DeliverySettings:
    """Settings of a simulated delivery.

    Attributes:
        world: Name of a built-in world, or path of a world file.
        boxes: Number of boxes to place in random cells; None for those of the world file.
        seed: Seed of all randomness.
        map_file: Path of a map.yaml to localize on instead of exploring.
        rules_file: Path of learnt rules to start with.
        learner: Name of a registered learner that can deliver.
        out: Folder for report, map and rules; None for runs/WORLD-seedN.
    """

    world: str = "rooms"
    boxes: int | None = None
    seed: int = 0
    map_file: Path | None = None
    rules_file: Path | None = None
    learner: str = "bayes"
    out: Path | None = None


def warm_up() -> None:
    """Run a delivery in the smallest world, so that all kernels are compiled before a run that is timed."""
    with tempfile.TemporaryDirectory() as folder:
        prepare_delivery(DeliverySettings(world="small", out=Path(folder)))(null_sink)


def prepare_delivery(settings: DeliverySettings) -> DeliveryRun:
    """Check all settings, create the output folder and build the simulation.

    Raises:
        InputError: The world, number of boxes, map, rules, learner or folder is invalid.
    """
    plan = find_world(settings.world)
    if not plan.warehouse:
        raise InputError(settings.world, "drawing", "has no warehouse (w)")
    world = seed_world(plan, settings.boxes, settings.seed)
    grid = None if settings.map_file is None else load_map(settings.map_file)
    if grid is not None and not grid.occupied.any():
        raise InputError(settings.map_file or "", "image", "shows no walls")
    learner = delivery_learner(settings.learner, settings.rules_file)
    out = settings.out or _unused_folder(Path("runs") / f"{plan.name}-seed{settings.seed}")
    ensure_writable_folder(out)
    simulation = build(world.plan, world.physics_rng)
    return DeliveryRun(simulation, grid, learner, out, settings.seed, world.robot_rng)


def _unused_folder(folder: Path) -> Path:
    """The folder, with the first number from 2 appended for which it has no results if it already has some."""
    numbered = (folder.with_name(f"{folder.name}-{number}") for number in count(2))
    return next(candidate for candidate in chain([folder], numbered) if not (candidate / RESULT_FILE).exists())


class DeliveryRun:
    """A prepared run; call it once.

    Args:
        simulation: The simulation.
        grid: Map to localize on; None to explore.
        learner: The robot's learner.
        out: Existing folder for the results.
        seed: Seed of the run, which the result states.
        rng: Source of the robot's own randomness.

    Attributes:
        simulation: The simulation.
        plan: The true floor plan with the boxes' initial cells.
        out: Folder for the results.
    """

    def __init__(
        self,
        simulation: Simulation,
        grid: OccupancyGrid | None,
        learner: RuleLearner,
        out: Path,
        seed: int,
        rng: np.random.Generator,
    ) -> None:
        self.simulation = simulation
        self.plan: FloorPlan = simulation.plan
        self.out = out
        self._grid = grid
        self._learner = learner
        self._rng = rng
        self._scorer = DeliveryScorer(simulation, self.plan.name, seed)
        self._episode: DeliveryEpisode | None = None

    @property
    def unreachable(self) -> tuple[Cell, ...]:
        """Cells of the boxes that no robot could deliver."""
        return self._scorer.unreachable

    @property
    def rules(self) -> tuple[str, ...]:
        """The learnt rules in words."""
        return self._learner.sentences()

    def __call__(self, sink: Sink, wrap: Callable[[Robot], Robot] = lambda robot: robot) -> DeliveryResult:
        """Run the delivery, score it, and write map, rules and report.

        Ctrl-C ends the run early; what was mapped and learnt until then is written.

        Args:
            sink: Called with the run's records.
            wrap: Wraps the simulated robot, for example in one that records its measurements.
        """
        started = time.perf_counter()
        sink = combine_sinks(self._scorer, sink)
        sink(run_started(self.plan.name, self._learner, self.simulation.robot.body))
        is_stopped = False
        try:
            self._episode = DeliveryEpisode(
                self._survey(wrap(self.simulation.robot), sink), self._learner, sink, self._rng
            )
            for step in self._episode:
                self._scorer.add_step(step)
        except KeyboardInterrupt:
            is_stopped = True
        grid = None if self._episode is None else self._episode.world.grid
        result = self._scorer.score(grid, time.perf_counter() - started, is_stopped=is_stopped)
        self._write(result)
        return result

    def _survey(self, robot: Robot, sink: Sink) -> SurveyedWorld:
        """Explore, or localize on the given map."""
        mission = Mission(robot, order_from_plan(self.plan), sink, self._rng)
        return mission.explore() if self._grid is None else mission.localize(self._grid)

    def _write(self, result: DeliveryResult) -> None:
        """Write the result and the rules and, if the survey was finished, the map and the report."""
        write_atomically(self.out / RESULT_FILE, json.dumps(result.as_json(), indent=2) + "\n")
        save_rules(self._learner, self.out / RULES_FILE)
        if self._episode is None:
            return
        world = self._episode.world
        save_map(world.grid, self.out / MAP_FILE)
        localization = self._scorer.localization()
        world_from_map = None if localization is None else localization.world_from_map
        pictures = draw_pictures(self._scorer.records, world, self.plan, world_from_map)
        if pictures:
            write_atomically(self.out / PICTURE_FILE, pictures[0].svg)
            page = render_page(result, pictures, self.rules, self._scorer.records)
            write_atomically(self.out / REPORT_FILE, page)
