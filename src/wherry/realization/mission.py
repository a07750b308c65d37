"""The first part of a delivery: map or localize, find the boxes, and set up the environment in which an agent acts.

The inputs are scans, odometry and the order, but no ground truth. The result is a `SurveyedWorld`. After a blocking box
was picked up, the agent has the survey extended.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from wherry.domains.delivery import DeliverySite
from wherry.errors import InputError
from wherry.floorplan.plan import Cell, FloorPlan
from wherry.localization.localizer import Localizer
from wherry.localization.parameters import PRECISE_PARAMETERS
from wherry.navigation.path import shortest_path
from wherry.realization.box_tracks import BoxTrack
from wherry.realization.environment import RobotEnvironment
from wherry.realization.global_localization import localize_globally
from wherry.realization.pilot import DriveStatus, Pilot
from wherry.realization.pose_estimators import Mapper, MapPoseEstimator, SlamMapper
from wherry.realization.pose_tracker import PoseEstimator, PoseTracker
from wherry.realization.surveyor import CellMap, Surveyor, costmap_around
from wherry.robot import Robot
from wherry.space.frame import CellFrame
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose
from wherry.trace.records import MapUpdate, Narration, Phase, Sink

INITIAL_POSE_COVARIANCE = np.diag([0.03**2, 0.03**2, 0.02**2])  # m², m², rad², of the pose when mapping ends


@dataclass(frozen=True)
class Order:
    """An order to deliver all boxes to a warehouse.

    Attributes:
        warehouse: [K, 2] centres of the warehouse's cells, m, in the frame of base_link at the start.
        cell_size: Side of the cells into which the world is divided, m; larger than the robot's footprint.
    """

    warehouse: Floats
    cell_size: float


def order_from_plan(plan: FloorPlan) -> Order:
    """The order for a world: its warehouse relative to the robot's start, and its cell size.

    Raises:
        InputError: The plan has no robot.
    """
    if plan.start is None:
        raise InputError(plan.name, "drawing", "has no robot (one of > ^ < v)")
    start = Pose(*plan.centre(plan.start), math.atan2(plan.heading.dy, plan.heading.dx))
    centres = np.array([plan.centre(cell) for cell in sorted(plan.warehouse)])
    return Order(warehouse=start.inverse.transform(centres), cell_size=plan.cell_size)


@dataclass(frozen=True)
class SurveyedWorld:
    """The result of a survey, after which the robot stands in the centre of a cell.

    Attributes:
        environment: The robot as an environment.
        grid: The map, without boxes.
        frame: The cell frame on the map.
        plan: The map discretized into cells.
        extend_survey: Surveys the area that has become reachable since; returns None if there is none.
        blocking_boxes: Returns the names of the boxes on the floor whose removal would make more area reachable, the
            nearest first.
    """

    environment: RobotEnvironment
    grid: OccupancyGrid
    frame: CellFrame
    plan: FloorPlan
    extend_survey: Callable[[], SurveyedWorld | None]
    blocking_boxes: Callable[[], tuple[str, ...]]


class Mission:
    """Surveys the world of an order with a robot, at the start and when more area becomes reachable.

    Args:
        robot: The robot; nothing else may command it.
        order: The order.
        sink: Called with snapshots of the robot, maps and narration.
        rng: Source of all randomness.
        mapper: Creates the mapper from the lidar's pose in the base_link frame.
        localizer: Creates the pose estimator from the finished map and base_link in the map frame; None for AMCL.
    """

    def __init__(
        self,
        robot: Robot,
        order: Order,
        sink: Sink,
        rng: np.random.Generator,
        *,
        mapper: Callable[[Pose], Mapper] = SlamMapper,
        localizer: Callable[[OccupancyGrid, Pose], PoseEstimator] | None = None,
    ) -> None:
        self._robot = robot
        self._order = order
        self._sink = sink
        self._rng = rng
        self._mapper = mapper
        self._localizer = localizer or self._amcl
        self._is_map_given = False

    def explore(self) -> SurveyedWorld:
        """Build a map by frontier exploration, search it for boxes, and return the surveyed world.

        Raises:
            InputError: The map has no walls to align cells with.
        """
        mapper = self._mapper(self._robot.body.lidar)
        pilot = Pilot(self._robot, PoseTracker(mapper.pose_estimator, mapper.start), self._sink)
        self._say(pilot, Phase.EXPLORE, "I have no map: I explore and drive to where my lidar will see most.")
        surveyor = Surveyor(pilot, self._order.cell_size, mapper)
        surveyor.survey()
        cell_map = surveyor.cell_map()
        self._finish_mapping(pilot, cell_map)
        return self._set_up_environment(surveyor, cell_map, mapper.start)

    def localize(self, grid: OccupancyGrid) -> SurveyedWorld:
        """Localize globally on a given map, search it for boxes, and return the surveyed world.

        Raises:
            InputError: The scans do not fit the map, the robot could not be localized on it, or it has no walls to
                align cells with.
        """
        self._is_map_given = True
        pilot, map_from_start = localize_globally(self._robot, grid, self._sink, self._rng)
        surveyor = Surveyor(pilot, self._order.cell_size, grid=grid)
        surveyor.survey()
        cell_map = surveyor.cell_map()
        self._localize_without_boxes(pilot, grid, cell_map)
        return self._set_up_environment(surveyor, cell_map, map_from_start)

    def _finish_mapping(self, pilot: Pilot, cell_map: CellMap) -> None:
        """Record the finished map, and localize on it from the current pose."""
        self._sink(MapUpdate(pilot.time, cell_map.grid, 1.0, 0))
        self._localize_on(cell_map.grid, pilot)

    def _localize_without_boxes(self, pilot: Pilot, grid: OccupancyGrid, cell_map: CellMap) -> None:
        """Localize on the map without boxes if the given map shows any."""
        if not np.array_equal(grid.occupied, cell_map.grid.occupied):
            self._localize_on(cell_map.grid, pilot)

    def _localize_on(self, grid: OccupancyGrid, pilot: Pilot) -> None:
        """Track the pose on a map from now on, starting from the current pose."""
        pilot.use_tracker(PoseTracker(self._localizer(grid, pilot.pose), pilot.pose))

    def _amcl(self, grid: OccupancyGrid, pose: Pose) -> PoseEstimator:
        """Create the particle filter on a map, initialized at base_link in the map frame."""
        localizer = Localizer(grid, self._robot.body.lidar, PRECISE_PARAMETERS, self._rng)
        localizer.initialize(pose, INITIAL_POSE_COVARIANCE)
        return MapPoseEstimator(localizer, is_map_given=self._is_map_given)

    def _set_up_environment(self, surveyor: Surveyor, cell_map: CellMap, map_from_start: Pose) -> SurveyedWorld:
        """Create the environment, and drive to the centre of a cell."""
        boxes = _boxes_in_open_cells(cell_map, surveyor)
        self._say(surveyor.pilot, Phase.SURVEY, f"I found {_count(len(boxes))}.")
        environment = RobotEnvironment(surveyor.pilot, cell_map.frame, self._site(cell_map, map_from_start), boxes)
        return self._surveyed_world(surveyor, cell_map, map_from_start, environment)

    def _surveyed_world(
        self, surveyor: Surveyor, cell_map: CellMap, map_from_start: Pose, environment: RobotEnvironment
    ) -> SurveyedWorld:
        """Drive to the centre of a cell, and return the surveyed world."""
        self._drive_to_cell_centre(surveyor.pilot, cell_map, environment)
        on_floor = {box.name for box in environment.boxes_on_floor}

        def extend_survey() -> SurveyedWorld | None:
            if on_floor <= {box.name for box in environment.boxes_on_floor}:
                return None  # only the removal of a box makes more area reachable
            return self._extend_survey(surveyor, cell_map, map_from_start, environment)

        def blocking_boxes() -> tuple[str, ...]:
            return _blocking_boxes(surveyor, environment)

        return SurveyedWorld(environment, cell_map.grid, cell_map.frame, cell_map.plan, extend_survey, blocking_boxes)

    def _extend_survey(
        self, surveyor: Surveyor, before: CellMap, map_from_start: Pose, environment: RobotEnvironment
    ) -> SurveyedWorld | None:
        """Survey the area that became reachable when a box was removed; None if there is none."""
        pilot, mapper = surveyor.pilot, surveyor.mapper
        known = [box.track for box in environment.boxes_on_floor]
        surveyor.update_boxes(known, environment.picked_up)
        if not surveyor.has_more_to_observe() or not environment.leave_unheld_box():
            return None
        phase = Phase.SURVEY if mapper is None else Phase.EXPLORE
        self._say(pilot, phase, "A box that blocked my way is gone: I survey what lies behind it.")
        if mapper is not None:
            pilot.stop()
            mapper.resume(pilot.pose)
            pilot.use_tracker(PoseTracker(mapper.pose_estimator, pilot.pose))
        surveyor.survey()
        cell_map = surveyor.cell_map()
        if mapper is not None:
            self._finish_mapping(pilot, cell_map)
        else:
            self._localize_without_boxes(pilot, before.grid, cell_map)
        boxes = _boxes_in_open_cells(cell_map, surveyor)
        known_ids = {track.track_id for track in known}
        new = sum(track.track_id not in known_ids for track in boxes)
        self._say(pilot, Phase.SURVEY, f"I found {_count(new)} more." if new else "I found no more boxes.")
        environment.update_map(cell_map.frame, self._site(cell_map, map_from_start), boxes)
        return self._surveyed_world(surveyor, cell_map, map_from_start, environment)

    def _site(self, cell_map: CellMap, map_from_start: Pose) -> DeliverySite:
        """The map's walls, and the cells of the warehouse that are open on the map."""
        warehouse_cells = cell_map.frame.cells_at(map_from_start.transform(self._order.warehouse))
        warehouse = {Cell(int(x), int(y)) for x, y in warehouse_cells}
        return DeliverySite.of_plan(replace(cell_map.plan, warehouse=frozenset(warehouse & set(cell_map.plan.cells()))))

    def _drive_to_cell_centre(self, pilot: Pilot, cell_map: CellMap, environment: RobotEnvironment) -> None:
        """Drive to the centre of the nearest reachable cell without a box."""
        frame = cell_map.frame
        boxes = [box.track for box in environment.boxes_on_floor]
        occupied = {Cell(*frame.cell_at(track.x, track.y)) for track in boxes}
        moves = cell_map.plan.distances(Cell(*frame.cell_at(pilot.pose.x, pilot.pose.y)))  # the nearest first
        costmap = costmap_around(pilot, cell_map.grid, boxes)
        reverse = pilot.boxes.is_holding
        for cell in (cell for cell in moves if cell not in occupied):
            centre = frame.centre(cell.x, cell.y)
            path = shortest_path(costmap, np.array([pilot.pose.x, pilot.pose.y]), centre)
            if path is not None and pilot.follow(path, reverse=reverse) is DriveStatus.ARRIVED:
                pilot.go_to(Pose(float(centre[0]), float(centre[1]), frame.heading(1, 0)), reverse=reverse)
                return
        self._say(pilot, Phase.SURVEY, "I cannot reach the centre of any cell.")

    def _say(self, pilot: Pilot, phase: Phase, text: str) -> None:
        self._sink(Narration(pilot.time, phase, text))


def _boxes_in_open_cells(cell_map: CellMap, surveyor: Surveyor) -> list[BoxTrack]:
    """The boxes found in cells that are open on the map."""
    return [box for box in surveyor.boxes() if cell_map.plan.is_open(Cell(*cell_map.frame.cell_at(box.x, box.y)))]


def _blocking_boxes(surveyor: Surveyor, environment: RobotEnvironment) -> tuple[str, ...]:
    """As `SurveyedWorld.blocking_boxes`; empty while the robot holds a box, since it can hold only one."""
    if environment.is_holding:
        return ()
    tracks = {box.name: box.track for box in environment.boxes_on_floor}
    surveyor.update_boxes(list(tracks.values()), environment.picked_up)
    pose = surveyor.pilot.pose
    nearest = sorted(tracks, key=lambda name: math.hypot(tracks[name].x - pose.x, tracks[name].y - pose.y))
    return tuple(name for name in nearest if surveyor.has_more_to_observe(without=tracks[name]))


def _count(boxes: int) -> str:
    """A number of boxes in words: "1 box", "2 boxes"."""
    return f"{boxes} {'box' if boxes == 1 else 'boxes'}"
