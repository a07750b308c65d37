"""The score of a simulated delivery, computed from the referee's ground truth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from wherry.episodes import Step
from wherry.evaluation import align, position_errors, root_mean_square
from wherry.floorplan.plan import Cell
from wherry.pipelines.delivery.result import DeliveryResult, DeliveryStatus
from wherry.pipelines.delivery.shortest_delivery import shortest_delivery
from wherry.simulation.referee import BoxStatus
from wherry.simulation.simulator import Simulation
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry.trace.records import TIME_TOLERANCE, CellLayout, Record, RobotSnapshot, throttle_snapshots

SNAPSHOT_PERIOD = 0.5  # s from one pose that is scored to the next
HEADING_LEVER = 1.0  # m of position error that weigh as much in the alignment as 1 rad of heading error


@dataclass(frozen=True, slots=True)
class TrueState:
    """The true state before or after an action.

    Attributes:
        robot: The robot's cell.
        boxes: Cells of the deliverable boxes on the floor.
        has_load: Whether the robot holds a box.
        cells_driven: Number of cells that the robot has driven through since the start.
    """

    robot: Cell
    boxes: tuple[Cell, ...]
    has_load: bool
    cells_driven: int


@dataclass(frozen=True, slots=True)
class Segment:
    """The actions between two surveys, in which the robot's cell frame does not change.

    Attributes:
        steps: The N steps so far.
        states: The N + 1 true states before, between and after the steps.
    """

    steps: list[Step]
    states: list[TrueState]


@dataclass(frozen=True, slots=True)
class LocalizationScore:
    """The robot's poses on its finished map, compared with the true ones.

    Attributes:
        world_from_map: The map frame in the world frame, which aligns the estimated poses with the true ones best.
        rmse: Root mean square error of the aligned positions, m.
    """

    world_from_map: Pose
    rmse: float


class DeliveryScorer:
    """Computes the score of a simulated delivery from its records, its steps and the ground truth.

    Args:
        simulation: The simulation.
        world: Name of the world.
        seed: Seed of the run.

    Attributes:
        unreachable: Cells of the boxes that no robot could deliver.
        records: The run's records, with one snapshot in each `SNAPSHOT_PERIOD`.
    """

    def __init__(self, simulation: Simulation, world: str, seed: int) -> None:
        self.unreachable = simulation.plan.unreachable_boxes()
        self.records: list[Record] = []
        self._simulation = simulation
        self._world = world
        self._seed = seed
        self._segments: list[Segment] = []
        # Throttled here, so that the score does not depend on other sinks.
        self._record = throttle_snapshots(self.records.append, SNAPSHOT_PERIOD)

    def __call__(self, record: Record) -> None:
        """Receive a record; a cell layout marks the end of a survey and begins a segment."""
        self._record(record)
        if isinstance(record, CellLayout):
            self._segments.append(Segment([], [self._true_state()]))

    def add_step(self, step: Step) -> None:
        """Add a step to the present segment."""
        self._segments[-1].steps.append(step)
        self._segments[-1].states.append(self._true_state())

    def score(self, grid: OccupancyGrid | None, wall_seconds: float, *, is_stopped: bool) -> DeliveryResult:
        """Compute the result of the run so far.

        Args:
            grid: The robot's map; None if it has none yet.
            wall_seconds: Duration of the run, s, wall clock.
            is_stopped: Whether the user stopped the run.
        """
        referee = self._simulation.referee
        boxes, unreachable = len(self._simulation.plan.boxes), len(self.unreachable)
        localization = self.localization()
        is_complete = referee.delivered >= boxes - unreachable
        completed = DeliveryStatus.DELIVERED if is_complete else DeliveryStatus.NOT_DELIVERED
        return DeliveryResult(
            delivered=referee.delivered,
            boxes=boxes,
            unreachable=unreachable,
            collisions=len(referee.collisions),
            learning_steps=sum(step.is_learning for segment in self._segments for step in segment.steps),
            actions=sum(len(segment.steps) for segment in self._segments),
            path_ratio=self._path_ratio(),
            localization_rmse_m=None if localization is None else localization.rmse,
            map_error_m=None if localization is None else self._map_error(grid, localization.world_from_map),
            sim_seconds=self._simulation.time,
            wall_seconds=wall_seconds,
            real_time_factor=self._simulation.time / wall_seconds,
            seed=self._seed,
            world=self._world,
            status=DeliveryStatus.STOPPED if is_stopped else completed,
        )

    def localization(self) -> LocalizationScore | None:
        """Align the poses estimated after mapping with the true ones; None if there are no such poses."""
        snapshots = [record for record in self.records if isinstance(record, RobotSnapshot) and len(record.particles)]
        if not snapshots:
            return None
        trajectory = self._simulation.referee.trajectory
        rows = np.searchsorted(trajectory[:, 0], [record.time - TIME_TOLERANCE for record in snapshots])
        true = trajectory[np.minimum(rows, len(trajectory) - 1), 1:]
        estimated = np.array([record.pose.as_array() for record in snapshots])
        world_from_map = align(estimated, true, heading_lever=HEADING_LEVER)
        return LocalizationScore(world_from_map, root_mean_square(position_errors(estimated, true, world_from_map)))

    def _map_error(self, grid: OccupancyGrid | None, world_from_map: Pose) -> float | None:
        """Median distance of the map's occupied cells from the true walls, m."""
        if grid is None:
            return None
        points = world_from_map.transform(grid.occupied_points())
        return float(np.median(self._simulation.referee.wall_distance(points)))

    def _path_ratio(self) -> float | None:
        """Cells driven while following complete plans ÷ decrease of the shortest remaining delivery."""
        cells_driven = progress = 0
        for first, last in self._exploitation_stretches():
            remaining = [
                shortest_delivery(self._simulation.plan, state.robot, state.boxes, has_load=state.has_load)
                for state in (first, last)
            ]
            if remaining[0] is not None and remaining[1] is not None:
                cells_driven += last.cells_driven - first.cells_driven
                progress += remaining[0] - remaining[1]
        return cells_driven / progress if progress > 0 else None

    def _exploitation_stretches(self) -> Iterator[tuple[TrueState, TrueState]]:
        """True states at the start and the end of every stretch in which the robot followed a complete plan."""
        for segment in self._segments:
            for begin, end in _consecutive_true([not step.is_exploring for step in segment.steps]):
                yield segment.states[begin], segment.states[end]

    def _true_state(self) -> TrueState:
        """The present true state."""
        plan, referee = self._simulation.plan, self._simulation.referee
        boxes = [box for box in referee.boxes if box.initial_cell not in self.unreachable]
        return TrueState(
            robot=plan.cell_at(referee.pose.x, referee.pose.y),
            boxes=tuple(plan.cell_at(*box.position) for box in boxes if box.status is BoxStatus.ON_FLOOR),
            has_load=any(box.status is BoxStatus.HELD for box in boxes),
            cells_driven=len(referee.visited_cells),
        )


def _consecutive_true(flags: Sequence[bool]) -> Iterator[tuple[int, int]]:
    """First and one-past-last index of every stretch of consecutive True flags."""
    for value, group in groupby(range(len(flags)), key=lambda index: flags[index]):
        if value:
            members = list(group)
            yield members[0], members[-1] + 1
