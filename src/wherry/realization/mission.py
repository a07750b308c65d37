"""A delivery from the robot's side: explore and map, or find itself on a map; find the boxes; stand ready to act.

Everything here is known from scans, odometry and the order. What the robot does after that is the agent's business: the
mission hands it a `RobotEnvironment`, and is asked again when boxes have gone that stood in the way of something.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from wherry.domains.delivery import DeliverySite
from wherry.errors import InputError
from wherry.floorplan.plan import Cell, FloorPlan
from wherry.localization.localizer import Localizer
from wherry.localization.parameters import PRECISE_PARAMETERS
from wherry.navigation.path import shortest_path
from wherry.realization.boxes import Box
from wherry.realization.correctors import SURE_SCANS, MapCorrector, Mapper, OwnMapper, Searcher
from wherry.realization.environment import RobotEnvironment
from wherry.realization.pilot import Pilot, Ride
from wherry.realization.survey import Chart, Survey, costmap_of
from wherry.realization.tracking import Corrector, PoseTracker
from wherry.robot import Robot
from wherry.space.frame import CellFrame
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose
from wherry.trace.records import MapUpdate, Narration, Phase, Sink

START_COVARIANCE = np.diag([0.03**2, 0.03**2, 0.02**2])  # m², m², rad² of a pose that SLAM just gave
LONGEST_LEG, MOST_LEGS = 1.5, 30  # m, and how many such legs a robot drives to find out where it is


@dataclass(frozen=True)
class Order:
    """What a robot is asked to do.

    Attributes:
        warehouse: [K, 2] m, the middles of the warehouse's cells as seen from where the robot starts, x ahead.
        cell_size: m, the side of the cells that the world is to be divided into: the robot's footprint and some room.
    """

    warehouse: Floats
    cell_size: float


@dataclass(frozen=True)
class Ready:
    """A robot that stands in the middle of a cell and knows where everything is that it could see so far.

    Attributes:
        environment: Its world, to act in.
        grid: The map, without boxes.
        frame: Where the cells lie on it.
        plan: The map in cells.
        look_further: See what has come within reach since then; None if that is nothing.
        in_the_way: The names of the boxes on the floor behind which there would be something to see, the nearest first.
    """

    environment: RobotEnvironment
    grid: OccupancyGrid
    frame: CellFrame
    plan: FloorPlan
    look_further: Callable[[], Ready | None]
    in_the_way: Callable[[], tuple[str, ...]]


class Mission:
    """One robot's way from being switched on to standing ready to deliver, and on from there.

    Args:
        robot: The robot; nobody else drives it meanwhile.
        order: What it is asked to do.
        sink: Told what happens.
        rng: Where all randomness comes from.
        mapper: Makes what maps, from the lidar's pose.
        localizer: Makes what localizes on a finished map from the pose that is believed; None for our own.
    """

    def __init__(
        self,
        robot: Robot,
        order: Order,
        sink: Sink,
        rng: np.random.Generator,
        *,
        mapper: Callable[[Pose], Mapper] = OwnMapper,
        localizer: Callable[[OccupancyGrid, Pose], Corrector] | None = None,
    ) -> None:
        self._robot = robot
        self._order = order
        self._sink = sink
        self._rng = rng
        self._mapper = mapper
        self._localizer = localizer or self._own_localizer

    def explore(self) -> Ready:
        """Make a map by driving to where most is unknown, until nothing reachable is; then get ready on it.

        Raises:
            InputError: There is nothing to see, so that no cells can be laid.
        """
        mapper = self._mapper(self._robot.body.lidar)
        pilot = Pilot(self._robot, PoseTracker(mapper.corrector, mapper.start), self._sink)
        self._say(pilot, Phase.EXPLORE, "I know nothing of this place, so I drive to where my laser will see most.")
        survey = Survey(pilot, self._order.cell_size, mapper)
        survey.run()
        chart = survey.chart()
        self._hand_over(pilot, chart)
        return self._get_ready(survey, chart, mapper.start)

    def find_itself(self, grid: OccupancyGrid) -> Ready:
        """Find the robot's place on a map that it was given, then get ready on it.

        Raises:
            InputError: It fits nowhere on the map, however much the robot drives around.
        """
        localizer = Localizer(grid, self._robot.body.lidar, PRECISE_PARAMETERS, self._rng)
        localizer.initialize_globally()
        searcher = Searcher(localizer)
        pilot = Pilot(self._robot, PoseTracker(searcher, Pose()), self._sink)
        self._say(pilot, Phase.LOCALIZE, "I have a map, but I do not know where I am on it.")
        start = pilot.odometry.pose
        pilot.look(SURE_SCANS)
        for _ in range(MOST_LEGS):
            if searcher.is_sure:
                break
            self._wander(pilot)
        else:
            raise InputError("map", "", "does not fit what the robot sees, or it looks the same in several places")
        map_from_start = searcher.found @ pilot.odometry.pose.inverse @ start
        pilot.localize_with(PoseTracker(MapCorrector(localizer), searcher.found))
        self._say(pilot, Phase.LOCALIZE, "Now I know.")
        survey = Survey(pilot, self._order.cell_size, grid=grid)
        survey.run()
        chart = survey.chart()
        self._forget_boxes_on_map(pilot, grid, chart)
        return self._get_ready(survey, chart, map_from_start)

    def _wander(self, pilot: Pilot) -> None:
        """Drive a metre or so to where there is room, for another view."""
        scan = pilot.look()
        reach = np.where(np.isnan(scan.ranges), 0.0, np.minimum(scan.ranges, LONGEST_LEG + pilot.body.radius))
        half = max(round(math.radians(20.0) / abs(scan.angle_increment)), 1)
        room = ndimage.minimum_filter1d(reach, 2 * half + 1, mode="wrap")
        widest = np.flatnonzero(room >= 0.8 * room.max())
        beam = int(self._rng.choice(widest))
        heading = pilot.pose.theta + float(scan.angles[beam])
        pilot.turn(heading)
        leg = max(float(room[beam]) - 2.0 * pilot.body.radius, 0.0)
        goal = pilot.pose @ Pose(leg)
        pilot.approach(goal, reverse=False)

    def _hand_over(self, pilot: Pilot, chart: Chart) -> None:
        """End mapping: go on by localization on the map, from the pose that is believed now."""
        self._sink(MapUpdate(pilot.time, chart.grid, 1.0, 0))
        pilot.localize_with(PoseTracker(self._localizer(chart.grid, pilot.pose), pilot.pose))

    def _forget_boxes_on_map(self, pilot: Pilot, grid: OccupancyGrid, chart: Chart) -> None:
        """Localize on the map without its boxes, if the one that was localized on shows any."""
        if not np.array_equal(grid.occupied, chart.grid.occupied):
            pilot.localize_with(PoseTracker(self._localizer(chart.grid, pilot.pose), pilot.pose))

    def _own_localizer(self, grid: OccupancyGrid, pose: Pose) -> Corrector:
        """Our own particle filter on a map."""
        localizer = Localizer(grid, self._robot.body.lidar, PRECISE_PARAMETERS, self._rng)
        localizer.initialize(pose, START_COVARIANCE)
        return MapCorrector(localizer)

    def _get_ready(self, survey: Survey, chart: Chart, map_from_start: Pose) -> Ready:
        """Say what was found, and stand in the middle of a cell."""
        boxes = _boxes_on(chart, survey)
        self._say(survey.pilot, Phase.SURVEY, f"I found {_count(len(boxes))}.")
        environment = RobotEnvironment(survey.pilot, chart.frame, self._site(chart, map_from_start), boxes)
        return self._stand_ready(survey, chart, map_from_start, environment)

    def _stand_ready(self, survey: Survey, chart: Chart, map_from_start: Pose, environment: RobotEnvironment) -> Ready:
        """Stand in the middle of a cell."""
        self._centre(survey.pilot, chart, environment)
        standing = {box.name for box in environment.standing}

        def look_further() -> Ready | None:
            if standing <= {box.name for box in environment.standing}:
                return None  # as long as no box has gone, nothing more has come within reach
            return self._look_further(survey, chart, map_from_start, environment)

        def in_the_way() -> tuple[str, ...]:
            return _in_the_way(survey, environment)

        return Ready(environment, chart.grid, chart.frame, chart.plan, look_further, in_the_way)

    def _look_further(
        self, survey: Survey, before: Chart, map_from_start: Pose, environment: RobotEnvironment
    ) -> Ready | None:
        """See what came within reach when a box went; None if that is nothing."""
        pilot, mapper = survey.pilot, survey.mapper
        standing = [box.place for box in environment.standing]
        survey.begin_anew(standing, environment.taken)
        if not survey.would_show_more() or not environment.step_aside():
            return None
        phase = Phase.SURVEY if mapper is None else Phase.EXPLORE
        self._say(pilot, phase, "A box has gone that stood in my way: I look at what lies behind.")
        if mapper is not None:
            pilot.stand()
            mapper.resume(pilot.pose)
            pilot.localize_with(PoseTracker(mapper.corrector, pilot.pose))
        survey.run()
        chart = survey.chart()
        if mapper is not None:
            self._hand_over(pilot, chart)
        else:
            self._forget_boxes_on_map(pilot, before.grid, chart)
        boxes = _boxes_on(chart, survey)
        known = {box.number for box in standing}
        more = sum(box.number not in known for box in boxes)
        self._say(pilot, Phase.SURVEY, f"I found {_count(more)} more." if more else "I found no more boxes.")
        environment.learn_of(chart.frame, self._site(chart, map_from_start), boxes)
        return self._stand_ready(survey, chart, map_from_start, environment)

    def _site(self, chart: Chart, map_from_start: Pose) -> DeliverySite:
        """The site on a map, with as much of the warehouse as the map shows."""
        tiles = chart.frame.cells_at(map_from_start.transform(self._order.warehouse))
        warehouse = {Cell(int(x), int(y)) for x, y in tiles}
        return DeliverySite.of_plan(replace(chart.plan, warehouse=frozenset(warehouse & set(chart.plan.cells()))))

    def _centre(self, pilot: Pilot, chart: Chart, environment: RobotEnvironment) -> None:
        """Drive to the middle of the nearest cell without a box."""
        frame, plan = chart.frame, chart.plan
        boxes = [box.place for box in environment.standing]
        taken = {Cell(*frame.cell_at(box.x, box.y)) for box in boxes}
        free = [cell for cell in plan.distances(Cell(*frame.cell_at(pilot.pose.x, pilot.pose.y))) if cell not in taken]
        costmap = costmap_of(chart.grid, pilot, boxes)
        reverse = pilot.load.held
        for cell in free:  # the nearest first
            middle = frame.centre(cell.x, cell.y)
            path = shortest_path(costmap, np.array([pilot.pose.x, pilot.pose.y]), middle)
            if path is not None and pilot.follow(path, reverse=reverse) is Ride.ARRIVED:
                pilot.go_to(Pose(float(middle[0]), float(middle[1]), frame.heading(1, 0)), reverse=reverse)
                return
        self._say(pilot, Phase.SURVEY, "I do not get to the middle of any cell.")

    def _say(self, pilot: Pilot, phase: Phase, text: str) -> None:
        self._sink(Narration(pilot.time, phase, text))


def _boxes_on(chart: Chart, survey: Survey) -> Sequence[Box]:
    """The boxes that a survey has found and that stand where a robot can."""
    return [box for box in survey.boxes() if chart.plan.is_open(Cell(*chart.frame.cell_at(box.x, box.y)))]


def _in_the_way(survey: Survey, environment: RobotEnvironment) -> tuple[str, ...]:
    """As `Ready.in_the_way`."""
    if environment.holding:
        return ()
    boxes = {box.name: box.place for box in environment.standing}
    survey.begin_anew(list(boxes.values()), environment.taken)
    pose = survey.pilot.pose
    nearest = sorted(boxes, key=lambda name: math.hypot(boxes[name].x - pose.x, boxes[name].y - pose.y))
    return tuple(name for name in nearest if survey.would_show_more(without=boxes[name]))


def _count(boxes: int) -> str:
    return f"{boxes} {'box' if boxes == 1 else 'boxes'}"
