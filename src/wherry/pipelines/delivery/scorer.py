"""The score of a simulated delivery, computed from the referee's ground truth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from wherry.episodes import Step
from wherry.evaluation import align, position_errors, root_mean_square
from wherry.floorplan.plan import Cell
from wherry.pipelines.delivery.score import DeliveryResult, DeliveryStatus, shortest_delivery
from wherry.simulation.referee import BoxStatus
from wherry.simulation.simulator import Simulation
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry.trace.records import CellLayout, Record, RobotSnapshot, throttle_snapshots

SNAPSHOT_PERIOD = 0.5  # s between two poses by which the localization is scored
HEADING_LEVER = 1.0  # m at which an error of the heading weighs like an error of the position in the alignment
TIME_TOLERANCE = 1e-6  # s by which a record's time may exceed that of the true pose it is compared with


@dataclass(frozen=True, slots=True)
class TrueState:
    """The true state between two actions.

    Attributes:
        robot: The robot's cell.
        boxes: The cells of the deliverable boxes on the floor.
        has_load: Whether the robot holds a box.
        cells_driven: Number of cells that the robot has driven through since the start.
    """

    robot: Cell
    boxes: tuple[Cell, ...]
    has_load: bool
    cells_driven: int


@dataclass(frozen=True, slots=True)
class Segment:
    """The actions between two surveys.

    Attributes:
        steps: N steps.
        states: N + 1 true states: before, between and after the steps.
    """

    steps: list[Step]
    states: list[TrueState]


class DeliveryScorer:
    """Observes a simulated delivery as a sink and step by step, and scores it.

    Args:
        simulation: The simulation.
        world: Name of the world.
        seed: Seed of the run.

    Attributes:
        unreachable: The cells of the boxes that no robot could deliver.
        records: The run's records, with fewer snapshots.
    """

    def __init__(self, simulation: Simulation, world: str, seed: int) -> None:
        self.unreachable = simulation.plan.unreachable_boxes()
        self.records: list[Record] = []
        self._simulation = simulation
        self._world = world
        self._seed = seed
        self._segments: list[Segment] = []
        # Throttled, so that the score does not depend on who else receives the records.
        self._keep = throttle_snapshots(self.records.append, SNAPSHOT_PERIOD)

    def __call__(self, record: Record) -> None:
        """Receive a record; a new cell layout ends a survey and begins a segment."""
        self._keep(record)
        if isinstance(record, CellLayout):
            self._segments.append(Segment([], [self._true_state()]))

    def add_step(self, step: Step) -> None:
        """Add a step of the present segment."""
        self._segments[-1].steps.append(step)
        self._segments[-1].states.append(self._true_state())

    def score(self, grid: OccupancyGrid | None, wall_seconds: float, *, is_stopped: bool) -> DeliveryResult:
        """The result of the run so far.

        Args:
            grid: The robot's map; None if it has none yet.
            wall_seconds: Duration of the run, s, wall clock.
            is_stopped: Whether the user has stopped the run.
        """
        referee = self._simulation.referee
        boxes, unreachable = len(self._simulation.plan.boxes), len(self.unreachable)
        world_from_map, rmse = self.localization()
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
            localization_rmse_m=rmse,
            map_error_m=self._map_error(grid, world_from_map),
            sim_seconds=self._simulation.time,
            wall_seconds=wall_seconds,
            real_time_factor=self._simulation.time / wall_seconds,
            seed=self._seed,
            world=self._world,
            status=DeliveryStatus.STOPPED if is_stopped else completed,
        )

    def localization(self) -> tuple[Pose | None, float | None]:
        """The map frame in the world frame, and the RMSE, m, of the aligned poses after mapping; None without poses."""
        snapshots = [record for record in self.records if isinstance(record, RobotSnapshot) and len(record.particles)]
        if not snapshots:
            return None, None
        history = self._simulation.referee.history
        rows = np.searchsorted(history[:, 0], [record.time - TIME_TOLERANCE for record in snapshots])
        true = history[np.minimum(rows, len(history) - 1), 1:]
        estimated = np.array([record.pose.as_array() for record in snapshots])
        world_from_map = align(estimated, true, heading_lever=HEADING_LEVER)
        return world_from_map, root_mean_square(position_errors(estimated, true, world_from_map))

    def _map_error(self, grid: OccupancyGrid | None, world_from_map: Pose | None) -> float | None:
        """Median distance of the map's occupied cells from the true walls, m."""
        if grid is None or world_from_map is None:
            return None
        points = world_from_map.transform(grid.occupied_points())
        return float(np.median(self._simulation.referee.wall_distance(points)))

    def _path_ratio(self) -> float | None:
        """Cells driven while following complete plans ÷ cells by which the shortest remaining delivery shrank."""
        driven = progress = 0
        for first, last in self._exploitation_stretches():
            remaining = [
                shortest_delivery(self._simulation.plan, state.robot, state.boxes, has_load=state.has_load)
                for state in (first, last)
            ]
            if remaining[0] is not None and remaining[1] is not None:
                driven += last.cells_driven - first.cells_driven
                progress += remaining[0] - remaining[1]
        return driven / progress if progress > 0 else None

    def _exploitation_stretches(self) -> Iterator[tuple[TrueState, TrueState]]:
        """First and last true state of every stretch in which a complete plan was followed."""
        for segment in self._segments:
            for begin, end in _true_runs([not step.is_exploring for step in segment.steps]):
                yield segment.states[begin], segment.states[end]

    def _true_state(self) -> TrueState:
        plan, referee = self._simulation.plan, self._simulation.referee
        boxes = [box for box in referee.boxes if box.initial_cell not in self.unreachable]
        return TrueState(
            robot=plan.cell_at(referee.pose.x, referee.pose.y),
            boxes=tuple(plan.cell_at(*box.position) for box in boxes if box.status is BoxStatus.ON_FLOOR),
            has_load=any(box.status is BoxStatus.HELD for box in boxes),
            cells_driven=len(referee.trajectory),
        )


def _true_runs(flags: Sequence[bool]) -> Iterator[tuple[int, int]]:
    """First and one-past-last index of every run of True flags."""
    for value, group in groupby(range(len(flags)), key=lambda index: flags[index]):
        if value:
            members = list(group)
            yield members[0], members[-1] + 1
