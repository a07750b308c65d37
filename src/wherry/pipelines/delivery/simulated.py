"""The delivery, end to end: a robot explores, maps, localizes itself, learns and delivers; a referee scores it.

Only this file sees both the robot and the referee. The robot is told its order, nothing else.
"""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, count, groupby
from pathlib import Path

import numpy as np

from wherry.episodes import Step
from wherry.errors import InputError
from wherry.files import make_folder, write_atomically
from wherry.floorplan.plan import Cell, FloorPlan
from wherry.floorplan.world_files import find_world
from wherry.learning.learners import RuleLearner
from wherry.learning.rule_files.files import save_rules
from wherry.pipelines.delivery.agent import Delivery, beginning, delivery_learner
from wherry.pipelines.delivery.page import page, pictures_of
from wherry.pipelines.delivery.score import Result, align, position_errors, root_mean_square, shortest_delivery
from wherry.realization.mission import Mission, SurveyedWorld, order_from_plan
from wherry.robot import Robot
from wherry.simulation import BoxStatus, Simulation, build
from wherry.simulation.seeded_worlds import seed_world
from wherry.space.map_files import load_map, save_map
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry.trace.records import CellsLaid, Record, Seen, Sink, both, ignore, thinned

SCORED_EVERY = 0.5  # s between two poses that the localization is scored by


RESULT = "result.json"


@dataclass(frozen=True, slots=True)
class Settings:
    """What to run.

    Attributes:
        world: A built-in world's name, or a world file.
        boxes: How many; None for what the world says.
        seed: Of everything that is random.
        map_file: A map.yaml to use instead of exploring.
        rules_file: Learnt rules to begin with.
        learner: A key of `LEARNERS`.
        out: The folder for report, map and rules; None for runs/WORLD-seedN.
    """

    world: str = "rooms"
    boxes: int | None = None
    seed: int = 0
    map_file: Path | None = None
    rules_file: Path | None = None
    learner: str = "bayes"
    out: Path | None = None


def warm_up() -> None:
    """Deliver in the smallest world and forget about it, so that every kernel is compiled before a clock runs."""
    with tempfile.TemporaryDirectory() as folder:
        prepare(Settings(world="small", out=Path(folder)))(ignore)


def prepare(settings: Settings) -> DeliveryRun:
    """Check everything that a user has given, before anything is done.

    Raises:
        InputError: World, map, rules, learner or folder cannot be used.
    """
    plan = find_world(settings.world)
    if not plan.warehouse:
        raise InputError(settings.world, "drawing", "has no warehouse (w)")
    world = seed_world(plan, settings.boxes, settings.seed)
    grid = None if settings.map_file is None else load_map(settings.map_file)
    if grid is not None and not grid.occupied.any():
        raise InputError(settings.map_file or "", "image", "shows no walls")
    learner = delivery_learner(settings.learner, settings.rules_file)
    out = settings.out or _free_folder(Path("runs") / f"{plan.name}-seed{settings.seed}")
    make_folder(out)
    return DeliveryRun(settings, world.plan, grid, learner, out, build(world.plan, world.physics_rng), world.robot_rng)


def _free_folder(folder: Path) -> Path:
    """The folder, or one with a number behind its name where an earlier run has left its results."""
    numbered = (folder.with_name(f"{folder.name}-{number}") for number in count(2))
    return next(free for free in chain([folder], numbered) if not (free / RESULT).exists())


@dataclass(frozen=True, slots=True)
class Mark:
    """Where things truly stood between two actions.

    Attributes:
        robot: The robot's cell.
        boxes: The cells of the boxes on the floor.
        loaded: Whether it held one.
        driven: Cells driven until then.
    """

    robot: Cell
    boxes: tuple[Cell, ...]
    loaded: bool
    driven: int


@dataclass(frozen=True, slots=True)
class Round:
    """What a robot does between two surveys of its world.

    Attributes:
        steps: N of them.
        marks: N + 1: before, between and after them.
    """

    steps: list[Step]
    marks: list[Mark]


class DeliveryRun:
    """A run that is ready to begin; call it once.

    Attributes:
        plan: The true floor plan, with the boxes where they stand at first.
        out: The folder for results.
        unreachable: The cells of the boxes that no robot could deliver.
        simulation: The world, for those who score or film it.
    """

    def __init__(
        self,
        settings: Settings,
        plan: FloorPlan,
        grid: OccupancyGrid | None,
        learner: RuleLearner,
        out: Path,
        simulation: Simulation,
        rng: np.random.Generator,
    ) -> None:
        self.plan = plan
        self.out = out
        self.unreachable = plan.unreachable_boxes()
        self._settings = settings
        self._grid = grid
        self._learner = learner
        self.simulation = simulation
        self._rng = rng
        self._records: list[Record] = []
        self._rounds: list[Round] = []
        self._delivery: Delivery | None = None

    def __call__(self, watch: Sink, wrap: Callable[[Robot], Robot] = lambda robot: robot) -> Result:
        """Run, score, and write map, rules and page; Ctrl-C ends it early and keeps what was learnt.

        Args:
            watch: Told what happens while it happens.
            wrap: Makes the robot that is driven of the simulated one, such as one that is recorded.
        """
        started = time.perf_counter()

        # Thinned, so that a run is scored by the same records whoever watches it.
        sink = both(thinned(self._records.append, SCORED_EVERY), self._begin_round, watch)
        sink(beginning(self.plan.name, self._learner, self.simulation.robot.body))
        try:
            ready = self._get_ready(wrap(self.simulation.robot), sink)
            self._delivery = Delivery(ready, self._learner, sink, self._rng)
            self._deliver(self._delivery)
            stopped = False
        except KeyboardInterrupt:
            stopped = True
        result = self._score(time.perf_counter() - started, stopped=stopped)
        self._write(result)
        return result

    def _get_ready(self, robot: Robot, sink: Sink) -> SurveyedWorld:
        """Map or localize; the robot is told only where the warehouse is, as seen from where it starts."""
        mission = Mission(robot, order_from_plan(self.plan), sink, self._rng)
        return mission.explore() if self._grid is None else mission.localize(self._grid)

    @property
    def rules(self) -> tuple[str, ...]:
        """What was learnt, in words."""
        return self._learner.sentences()

    @property
    def _ready(self) -> SurveyedWorld | None:
        """What the robot knows by now; None before it has stood ready."""
        return None if self._delivery is None else self._delivery.ready

    def _deliver(self, delivery: Delivery) -> None:
        """The agent loop on the robot, with the referee looking on."""
        for step in delivery:
            self._rounds[-1].steps.append(step)
            self._rounds[-1].marks.append(self._mark())

    def _begin_round(self, record: Record) -> None:
        """Take a mark whenever cells are laid: from there on the robot acts, and does not explore."""
        if isinstance(record, CellsLaid):
            self._rounds.append(Round([], [self._mark()]))

    def _mark(self) -> Mark:
        referee, size = self.simulation.referee, self.plan.cell_size
        truths = [box for box in referee.boxes if box.initial_cell not in self.unreachable]
        on_floor = tuple(_cell_of(box.position, size) for box in truths if box.status is BoxStatus.ON_FLOOR)
        loaded = any(box.status is BoxStatus.HELD for box in truths)
        pose = referee.pose
        return Mark(_cell_of((pose.x, pose.y), size), on_floor, loaded, len(referee.trajectory))

    def _score(self, wall_seconds: float, *, stopped: bool) -> Result:
        """Everything in it but the steps comes from the referee."""
        referee = self.simulation.referee
        boxes, unreachable = len(self.plan.boxes), len(self.unreachable)
        world_from_map, rmse = self._localization()
        complete = referee.delivered >= boxes - unreachable
        return Result(
            delivered=referee.delivered,
            boxes=boxes,
            unreachable=unreachable,
            collisions=len(referee.collisions),
            learning_steps=sum(step.learning for round_ in self._rounds for step in round_.steps),
            actions=sum(len(round_.steps) for round_ in self._rounds),
            path_ratio=self._path_ratio(),
            localization_rmse_m=rmse,
            map_error_m=self._map_error(world_from_map),
            sim_seconds=self.simulation.time,
            wall_seconds=wall_seconds,
            real_time_factor=self.simulation.time / wall_seconds,
            seed=self._settings.seed,
            world=self.plan.name,
            status="stopped" if stopped else "delivered" if complete else "not delivered",
        )

    def _path_ratio(self) -> float | None:
        """Cells driven while following a complete plan, ÷ by how many cells that brought the job nearer to its end."""
        driven = nearer = 0
        for first, last in self._straight_on():
            left = [shortest_delivery(self.plan, mark.robot, mark.boxes, loaded=mark.loaded) for mark in (first, last)]
            if left[0] is not None and left[1] is not None:
                driven += last.driven - first.driven
                nearer += left[0] - left[1]
        return driven / nearer if nearer > 0 else None

    def _straight_on(self) -> Iterator[tuple[Mark, Mark]]:
        """The ends of all stretches in which a complete plan was followed."""
        for round_ in self._rounds:
            for begin, end in _stretches([not step.exploring for step in round_.steps]):
                yield round_.marks[begin], round_.marks[end]

    def _localization(self) -> tuple[Pose | None, float | None]:
        """The map's frame in the world, and the rms error, m, of the poses after the map was finished."""
        seen = [record for record in self._records if isinstance(record, Seen) and len(record.particles)]
        if not seen:
            return None, None
        history = self.simulation.referee.history
        rows = np.searchsorted(history[:, 0], [record.time - 1e-6 for record in seen])
        true = [Pose.from_array(row[1:]) for row in history[np.minimum(rows, len(history) - 1)]]
        estimated = [record.pose for record in seen]
        world_from_map = align(estimated, true)
        return world_from_map, root_mean_square(position_errors(estimated, true, world_from_map))

    def _map_error(self, world_from_map: Pose | None) -> float | None:
        if world_from_map is None or self._ready is None:
            return None
        points = world_from_map.transform(self._ready.grid.occupied_points())
        return float(np.median(self.simulation.referee.wall_distance(points)))

    def _write(self, result: Result) -> None:
        """What was made: the map, the rules, the result, and the page."""
        write_atomically(self.out / RESULT, json.dumps(result.as_json(), indent=2) + "\n")
        save_rules(self._learner, self.out / "rules.json")
        if self._ready is None:
            return
        save_map(self._ready.grid, self.out / "map.yaml")
        world_from_map, _ = self._localization()
        pictures = pictures_of(self._records, self._ready, self.plan, world_from_map)
        if pictures:
            write_atomically(self.out / "delivery.svg", pictures[0].svg)
            write_atomically(self.out / "report.html", page(result, pictures, self.rules, self._records))


def _stretches(flags: Sequence[bool]) -> Iterator[tuple[int, int]]:
    """First and one-past-last index of every stretch of true flags."""
    for value, group in groupby(range(len(flags)), key=lambda index: flags[index]):
        if value:
            members = list(group)
            yield members[0], members[-1] + 1


def _cell_of(position: tuple[float, float], size: float) -> Cell:
    return Cell(int(position[0] // size), int(position[1] // size))
