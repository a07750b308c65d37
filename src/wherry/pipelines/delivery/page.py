"""The picture page of one delivery: which instants to show, and what to say of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wherry.floorplan.plan import Cell, Direction, FloorPlan
from wherry.pipelines.delivery.score import Result
from wherry.realization.mission import SurveyedWorld
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose
from wherry.trace.records import Explored, Record, Said, Seen, Stepped
from wherry.views.drawing import Scene, draw
from wherry.views.report import Picture, Report, render

CLOSE_BY = 0.8  # m shown to each side of the robot in the close-up
NO_POINTS = np.empty((0, 2))


def page(result: Result, pictures: Sequence[Picture], rules: Sequence[str], records: Sequence[Record]) -> str:
    """The page as HTML.

    Args:
        result: What the referee says.
        pictures: From `pictures_of`.
        rules: What was learnt, in words.
        records: The run's trace.
    """
    good = result.status == "delivered"
    lead = (
        f"In the world “{result.world}” (seed {result.seed}) the robot brought {result.delivered} of {result.boxes} "
        f"boxes to the warehouse, {result.real_time_factor:.0f} times faster than real time."
    )
    return render(
        Report(
            title="wherry: a delivery",
            verdict=result.verdict,
            good=good,
            lead=lead,
            pictures=pictures,
            figures=result.figures,
            rules=rules,
            log=[record for record in records if isinstance(record, Said)],
        )
    )


def pictures_of(
    records: Sequence[Record], ready: SurveyedWorld, plan: FloorPlan, world_from_map: Pose | None
) -> list[Picture]:
    """The delivery at its fullest, from afar and close by; the map half made; and the moment after the last box.

    Args:
        records: The run's trace.
        ready: The robot's map and cells.
        plan: The true plan, shown faintly under the map.
        world_from_map: The map's frame in the world; None where nothing can be said of the truth.
    """
    seen = [record for record in records if isinstance(record, Seen)]
    mapping = [record for record in seen if not len(record.particles)]
    localized = [record for record in seen if len(record.particles)]
    warehouse = _warehouse(ready)
    walls = NO_POINTS.reshape(0, 2, 2) if world_from_map is None else _true_walls(plan, world_from_map.inverse)
    body = ready.environment.pilot.body

    def picture(moment: Seen, grid: OccupancyGrid, caption: str, around_robot: float | None = None) -> Picture:
        scene = Scene(grid, warehouse, walls, body.radius, body.box_radius)
        driven = np.array([(record.pose.x, record.pose.y) for record in seen if record.time <= moment.time])
        goals = _plan_at(records, moment.time)
        return Picture(draw(scene, moment, driven, goals, label=caption, around_robot=around_robot), caption)

    pictures = []
    if localized:
        moment = _carrying(localized, records)
        doing = "The robot brings a box to the warehouse" if moment.loaded else "The robot at work"
        caption = (
            f"{doing}, {moment.time:.0f} s after it was switched on: what its laser sees, where its particles say that "
            "it is, and the cells that it means to drive through."
        )
        pictures.append(picture(moment, ready.grid, caption))
        caption = "The same instant close by: the cloud of particles, the fork and what is in it."
        pictures.append(picture(moment, ready.grid, caption, around_robot=CLOSE_BY))
    if mapping:
        moment = mapping[len(mapping) // 3]
        grids = [record for record in records if isinstance(record, Explored) and record.time <= moment.time]
        grid = grids[-1].grid if grids else ready.grid
        pictures.append(picture(moment, grid, f"The map after {moment.time:.0f} s of exploring."))
    if localized:
        last = localized[-1]
        pictures.append(picture(last, ready.grid, f"The end, after {last.time:.0f} s, and all the ways it drove."))
    return pictures


def _carrying(moments: Sequence[Seen], records: Sequence[Record]) -> Seen:
    """An instant at the beginning of a long ride with a box, while others still wait; else whatever is most like it."""

    def telling(moment: Seen) -> tuple[bool, bool, int, int]:
        way_left = len(_plan_at(records, moment.time))
        return moment.loaded, len(moment.path) > 1, min(len(moment.boxes), 1) * way_left, way_left

    return max(moments, key=telling)


def _plan_at(records: Sequence[Record], time: float) -> Floats:
    """[M, 2] m, map frame: the cells that the robot meant to drive through at an instant."""
    plans = [record.plan for record in records if isinstance(record, Stepped) and record.time <= time]
    return plans[-1].astype(float) if plans else NO_POINTS


def _warehouse(ready: SurveyedWorld) -> Floats:
    """[K, 4, 2] m, map frame: the corners of the warehouse's cells."""
    half = ready.frame.cell_size / 2
    square = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    turned = Pose(theta=ready.frame.origin.theta).transform(square)
    cells = sorted(ready.environment.site.warehouse)
    return np.array([ready.frame.centre(cell.x, cell.y) + turned for cell in cells]).reshape(-1, 4, 2)


def _true_walls(plan: FloorPlan, map_from_world: Pose) -> Floats:
    """[S, 2, 2] m, map frame: every edge of a cell that a wall, an obstacle or the plan's end makes impassable."""
    size = plan.cell_size
    segments = []
    for cell in plan.cells():
        for direction in Direction:
            if plan.blocked(cell, direction):
                segments.append(_edge(cell, direction, size))
    ends = map_from_world.transform(np.array(segments).reshape(-1, 2))
    return ends.reshape(-1, 2, 2)


def _edge(cell: Cell, direction: Direction, size: float) -> list[list[float]]:
    """The two ends of a cell's edge, m, world frame."""
    middle_x, middle_y = (cell.x + 0.5 + direction.dx / 2) * size, (cell.y + 0.5 + direction.dy / 2) * size
    along_x, along_y = abs(direction.dy) * size / 2, abs(direction.dx) * size / 2
    return [[middle_x - along_x, middle_y - along_y], [middle_x + along_x, middle_y + along_y]]
