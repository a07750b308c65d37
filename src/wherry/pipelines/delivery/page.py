"""The report page of a delivery: chooses snapshots, draws them and writes their captions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wherry.floorplan.plan import Cell, Direction, FloorPlan
from wherry.pipelines.delivery.result import DeliveryResult, DeliveryStatus
from wherry.realization.mission import SurveyedWorld
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose
from wherry.trace.records import MapUpdate, Narration, Record, RobotSnapshot, StepTaken
from wherry.views.report import DeliveryReport, ReportPicture, render_report
from wherry.views.snapshot_svg import MapBackground, draw_snapshot

CLOSE_UP_RADIUS = 0.8  # m shown on each side of the robot in the close-up
NO_POINTS = np.empty((0, 2))


def render_page(
    result: DeliveryResult, pictures: Sequence[ReportPicture], rules: Sequence[str], records: Sequence[Record]
) -> str:
    """Render the page as HTML.

    Args:
        result: The referee's score.
        pictures: From `draw_pictures`.
        rules: The learnt rules in words.
        records: The run's records.
    """
    return render_report(
        DeliveryReport(
            title="wherry: a delivery",
            verdict=result.verdict,
            is_success=result.status is DeliveryStatus.DELIVERED,
            summary=(
                f"In the world “{result.world}” (seed {result.seed}) the robot delivered {result.delivered} of "
                f"{result.boxes} boxes, {result.real_time_factor:.0f} times faster than real time."
            ),
            pictures=pictures,
            metrics=result.metrics,
            rules=rules,
            log=[record for record in records if isinstance(record, Narration)],
        )
    )


def draw_pictures(
    records: Sequence[Record], world: SurveyedWorld, plan: FloorPlan, world_from_map: Pose | None
) -> list[ReportPicture]:
    """Draw a delivery in progress, the same snapshot close up, the map during exploration, and the end.

    Pictures whose part of the run did not take place are left out.

    Args:
        records: The run's records.
        world: The robot's map and cells.
        plan: The true plan, whose walls are drawn under the map.
        world_from_map: The map frame in the world frame; None to draw no true walls.
    """
    painter = _SnapshotPainter(records, world, plan, world_from_map)
    mapping = [snapshot for snapshot in painter.snapshots if not len(snapshot.particles)]
    localized = [snapshot for snapshot in painter.snapshots if len(snapshot.particles)]
    pictures = []
    if localized:
        snapshot = _most_informative(localized, records)
        activity = "The robot carries a box to the warehouse" if snapshot.has_load else "The robot at work"
        caption = (
            f"{activity}, {snapshot.time:.0f} s after its start: end points of the lidar's beams, particles of the "
            "localization, and the cells of the plan."
        )
        pictures.append(painter.draw(snapshot, world.grid, caption))
        caption = "The same snapshot close up: the particles, the fork and its load."
        pictures.append(painter.draw(snapshot, world.grid, caption, around_robot=CLOSE_UP_RADIUS))
    if mapping:
        snapshot = mapping[len(mapping) // 3]
        grid = _map_at(records, snapshot.time, world.grid)
        pictures.append(painter.draw(snapshot, grid, f"The map after {snapshot.time:.0f} s of exploring."))
    if localized:
        snapshot = localized[-1]
        caption = f"The end, after {snapshot.time:.0f} s, with the whole trajectory."
        pictures.append(painter.draw(snapshot, world.grid, caption))
    return pictures


class _SnapshotPainter:
    """Draws snapshots of a run on the map, with the trajectory and the plan at the snapshot's time.

    Args:
        records: The run's records.
        world: The robot's map and cells.
        plan: The true plan.
        world_from_map: The map frame in the world frame; None to draw no true walls.
    """

    def __init__(
        self, records: Sequence[Record], world: SurveyedWorld, plan: FloorPlan, world_from_map: Pose | None
    ) -> None:
        self.snapshots = [record for record in records if isinstance(record, RobotSnapshot)]
        self._records = records
        self._warehouse = _warehouse_corners(world)
        no_walls = NO_POINTS.reshape(0, 2, 2)
        self._walls = no_walls if world_from_map is None else _true_walls(plan, world_from_map.inverse)
        self._body = world.environment.pilot.body

    def draw(
        self, snapshot: RobotSnapshot, grid: OccupancyGrid, caption: str, around_robot: float | None = None
    ) -> ReportPicture:
        """Draw a snapshot.

        Args:
            snapshot: The robot's pose, scan, particles and path.
            grid: The map at its time.
            caption: Caption of the picture.
            around_robot: Distance from the robot that the picture shows on each side, m; None for the whole map.
        """
        background = MapBackground(grid, self._warehouse, self._walls, self._body.radius, self._body.box_radius)
        positions = [(earlier.pose.x, earlier.pose.y) for earlier in self.snapshots if earlier.time <= snapshot.time]
        goals = _plan_at(self._records, snapshot.time)
        svg = draw_snapshot(background, snapshot, np.array(positions), goals, label=caption, around_robot=around_robot)
        return ReportPicture(svg, caption)


def _most_informative(snapshots: Sequence[RobotSnapshot], records: Sequence[Record]) -> RobotSnapshot:
    """The snapshot that shows most: a load first, then a path, boxes on the floor, and a long plan."""

    def information(snapshot: RobotSnapshot) -> tuple[bool, bool, int, int]:
        plan_length = len(_plan_at(records, snapshot.time))
        has_boxes = min(len(snapshot.boxes), 1)
        return snapshot.has_load, len(snapshot.path) > 1, has_boxes * plan_length, plan_length

    return max(snapshots, key=information)


def _map_at(records: Sequence[Record], time: float, default: OccupancyGrid) -> OccupancyGrid:
    """The last map recorded until a time, s; the default if there is none."""
    updates = [record for record in records if isinstance(record, MapUpdate) and record.time <= time]
    return updates[-1].grid if updates else default


def _plan_at(records: Sequence[Record], time: float) -> Floats:
    """[M, 2] centres of the cells on the plan at a time, s; m, map frame."""
    plans = [record.plan for record in records if isinstance(record, StepTaken) and record.time <= time]
    return plans[-1].astype(float) if plans else NO_POINTS


def _warehouse_corners(world: SurveyedWorld) -> Floats:
    """[K, 4, 2] corners of the warehouse's cells, m, map frame."""
    half = world.frame.cell_size / 2
    square = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    corners = Pose(theta=world.frame.origin.theta).transform(square)
    cells = sorted(world.environment.site.warehouse)
    return np.array([world.frame.centre(cell.x, cell.y) + corners for cell in cells]).reshape(-1, 4, 2)


def _true_walls(plan: FloorPlan, map_from_world: Pose) -> Floats:
    """[S, 2, 2] end points of every blocked cell edge of the true plan, m, map frame."""
    edges = [
        _edge(cell, direction, plan.cell_size)
        for cell in plan.cells()
        for direction in Direction
        if plan.is_blocked(cell, direction)
    ]
    return map_from_world.transform(np.array(edges).reshape(-1, 2)).reshape(-1, 2, 2)


def _edge(cell: Cell, direction: Direction, size: float) -> list[list[float]]:
    """[2, 2] end points of a cell's edge, m, world frame."""
    middle_x, middle_y = (cell.x + 0.5 + direction.dx / 2) * size, (cell.y + 0.5 + direction.dy / 2) * size
    along_x, along_y = abs(direction.dy) * size / 2, abs(direction.dx) * size / 2
    return [[middle_x - along_x, middle_y - along_y], [middle_x + along_x, middle_y + along_y]]
