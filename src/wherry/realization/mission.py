"""A delivery from the robot's side: explore and map, or find itself on a map; find the boxes; stand ready to act.

Everything here is known from scans, odometry and the order. What the robot does after that is the agent's business: the
mission ends with a `RobotEnvironment`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from wherry.domains.delivery import Site
from wherry.errors import InputError
from wherry.floorplan import Cell, Direction, FloorPlan
from wherry.localization.localizer import Localizer
from wherry.localization.parameters import PRECISE
from wherry.mapping.graph_slam import GraphSlam
from wherry.mapping.slam import Slam
from wherry.navigation.exploration import frontier_cells, next_viewpoint, visible_unknown
from wherry.navigation.path import Costmap, shortest_path
from wherry.realization.box_watch import ENOUGH_LOOKS, LOOK_EVERY, BoxWatch, SeenCells
from wherry.realization.boxes import Box, standing_free, without_boxes
from wherry.realization.cells import occupied_cells, plan_of_map
from wherry.realization.environment import RobotEnvironment
from wherry.realization.pilot import Pilot, Ride
from wherry.realization.tracking import Corrector, PoseTracker
from wherry.robot import Odometry, Robot, Scan
from wherry.space.frame import CellFrame, lay_cells
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose
from wherry.trace import Explored, Said, Sink

REPLAN = 1.5  # s of driving after which the growing map is looked at again
OWN_PLACE = 0.35  # m around itself that a robot knows to be free although its lidar cannot see it
START_COVARIANCE = np.diag([0.03**2, 0.03**2, 0.02**2])  # m², m², rad² of a pose that SLAM just gave
UNSURE = 0.5  # probability of being lost from which on a robot stops and looks around
SURE, SURE_SCANS = 0.1, 10  # probability of being lost that a robot accepts, in so many scans in a row
LONGEST_LEG, MOST_LEGS = 1.5, 30  # m, and how many such legs a robot drives to find out where it is
WORTHWHILE = 0.15  # m² of the unknown, less than half a cell, for which the robot drives to see them
MOST_LOOKOUTS = 3  # places that are tried to look into a cell from
BEHIND_FRONTIER = 1.0  # m of unknown that are expected behind a frontier, to tell how far a map has come


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
    """A robot that stands in the middle of a cell and knows where everything is.

    Attributes:
        environment: Its world, to act in.
        grid: The map, without boxes.
        frame: Where the cells lie on it.
        plan: The map in cells.
    """

    environment: RobotEnvironment
    grid: OccupancyGrid
    frame: CellFrame
    plan: FloorPlan


class SlamCorrector:
    """Corrects the pose by making the map."""

    def __init__(self, slam: Slam) -> None:
        self._slam = slam

    def correct(self, odometry: Odometry, scan: Scan) -> Pose:
        """As `Corrector.correct`."""
        return self._slam.add(scan, odometry)

    @property
    def particles(self) -> NDArray[np.float64]:
        """None: SLAM here believes in one pose."""
        return np.empty((0, 3))

    @property
    def lost(self) -> bool:
        """Never: the map is wherever the robot is."""
        return False


class Mapper(Protocol):
    """What gives a map that grows while the robot explores, and the robot's pose on it."""

    @property
    def corrector(self) -> Corrector:
        """Corrects the pose on the map."""
        ...

    @property
    def start(self) -> Pose:
        """base_link in the map frame where exploring begins."""
        ...

    def grid(self) -> OccupancyGrid:
        """The map so far."""
        ...


class OwnMapper:
    """Our own SLAM; the map frame is where the robot starts.

    Args:
        lidar: The lidar's pose, base_link frame.
    """

    def __init__(self, lidar: Pose) -> None:
        self._slam = GraphSlam(lidar)
        self.corrector: Corrector = SlamCorrector(self._slam)
        self.start = Pose()

    def grid(self) -> OccupancyGrid:
        """As `Mapper.grid`."""
        return self._slam.grid()


class MapCorrector:
    """Corrects the pose on a finished map."""

    def __init__(self, localizer: Localizer) -> None:
        self._localizer = localizer
        self._lost = False

    def correct(self, odometry: Odometry, scan: Scan) -> Pose:
        """As `Corrector.correct`."""
        found = self._localizer.update(odometry, scan)
        self._lost = found.lost_probability > (SURE if self._lost else UNSURE)
        return found.pose

    @property
    def particles(self) -> NDArray[np.float64]:
        """[N, 3] x m, y m, θ rad, map frame."""
        return self._localizer.amcl.particles

    @property
    def lost(self) -> bool:
        """From when it is more likely lost than not, until it is sure again."""
        return self._lost


class Searcher:
    """Looks for the robot's place on a map while the robot drives by odometry alone, in the odom frame."""

    def __init__(self, localizer: Localizer) -> None:
        self._localizer = localizer
        self._sure_scans = 0
        self.found = Pose()

    @property
    def is_sure(self) -> bool:
        """Whether the place has been beyond doubt for some scans in a row."""
        return self._sure_scans >= SURE_SCANS

    def correct(self, odometry: Odometry, scan: Scan) -> Pose:
        """As `Corrector.correct`, but the map frame here is the odom frame."""
        located = self._localizer.update(odometry, scan)
        self._sure_scans = self._sure_scans + 1 if located.lost_probability < SURE else 0
        self.found = located.pose
        return odometry.pose

    @property
    def particles(self) -> NDArray[np.float64]:
        """None that would fit into the odom frame."""
        return np.empty((0, 3))

    @property
    def lost(self) -> bool:
        """Never: in the odom frame the robot is where its wheels say."""
        return False


class Mission:
    """One robot's way from being switched on to standing ready to deliver.

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
        """Make a map by driving to where most is unknown, until nothing reachable is; then get ready on it."""
        mapper = self._mapper(self._robot.body.lidar)
        pilot = Pilot(self._robot, PoseTracker(mapper.corrector, mapper.start), self._sink)
        watch = BoxWatch(pilot)
        self._say(pilot, "explore", "I know nothing of this place, so I drive to where my laser will see most.")
        pilot.look()
        looked: list[Floats] = []
        goal: Floats | None = None
        while True:
            grid = mapper.grid()
            costmap = self._costmap(grid, pilot, watch.boxes)
            if goal is None or visible_unknown(grid, goal) < WORTHWHILE:
                viewpoint = next_viewpoint(
                    grid, costmap, pilot.pose, np.array(looked).reshape(-1, 2), least_gain=WORTHWHILE
                )
                if viewpoint is None:
                    break
                goal = viewpoint.position
            self._tell_progress(pilot, grid)
            path = shortest_path(costmap, _position(pilot.pose), goal)
            if path is None or not self._ride(pilot, path):
                looked.append(goal)
                goal = None
        pilot.stand()
        grid = mapper.grid()
        boxes = standing_free(watch.boxes, grid, pilot.body.box_radius)
        grid = without_boxes(grid, boxes, pilot.body.box_radius)
        self._sink(Explored(pilot.time, grid, 1.0, 0))
        self._say(pilot, "explore", "Nothing that I can reach is unknown any more.")
        self._localize(pilot, grid)
        return self._get_ready(pilot, watch, grid, mapper.start)

    def find_itself(self, grid: OccupancyGrid) -> Ready:
        """Find the robot's place on a map that it was given, then get ready on it.

        Raises:
            InputError: It fits nowhere on the map, however much the robot drives around.
        """
        localizer = Localizer(grid, self._robot.body.lidar, PRECISE, self._rng)
        localizer.initialize_globally()
        searcher = Searcher(localizer)
        pilot = Pilot(self._robot, PoseTracker(searcher, Pose()), self._sink)
        self._say(pilot, "localize", "I have a map, but I do not know where I am on it.")
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
        self._say(pilot, "localize", "Now I know.")
        return self._get_ready(pilot, BoxWatch(pilot), grid, map_from_start)

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

    def _tell_progress(self, pilot: Pilot, grid: OccupancyGrid) -> None:
        """Tell the sink how far the map has come."""
        frontier = float(np.count_nonzero(frontier_cells(grid))) * grid.resolution  # m
        known = float(np.count_nonzero(grid.free)) * grid.resolution**2  # m²
        self._sink(Explored(pilot.time, grid, known / (known + frontier * BEHIND_FRONTIER), frontier))

    def _ride(self, pilot: Pilot, path: Floats) -> bool:
        """Follow a path for a while; whether it is worth going on, for the robot is neither there nor held up."""
        deadline = pilot.time + REPLAN
        return pilot.follow(path, until=lambda: pilot.time >= deadline) is Ride.CUT_SHORT

    def _localize(self, pilot: Pilot, grid: OccupancyGrid) -> None:
        """Go on by localization on a map, from the pose that is believed now."""
        pilot.localize_with(PoseTracker(self._localizer(grid, pilot.pose), pilot.pose))

    def _own_localizer(self, grid: OccupancyGrid, pose: Pose) -> Corrector:
        """Our own particle filter on a map."""
        localizer = Localizer(grid, self._robot.body.lidar, PRECISE, self._rng)
        localizer.initialize(pose, START_COVARIANCE)
        return MapCorrector(localizer)

    def _get_ready(self, pilot: Pilot, watch: BoxWatch, grid: OccupancyGrid, map_from_start: Pose) -> Ready:
        """Lay cells on the map, look into every corner for boxes, and stand in the middle of a cell."""
        walls = grid.occupied_points()
        if not len(walls):
            raise InputError("map", "", "has no walls to lay cells along")
        frame = lay_cells(walls, self._order.cell_size)
        plan = plan_of_map(grid, frame, pilot.body.radius)
        self._search(pilot, watch, grid, frame, plan)
        watch.stop()
        boxes = standing_free(watch.boxes, grid, pilot.body.box_radius)
        # A box that was seen well only now still stands on the map.
        grid = without_boxes(grid, boxes, pilot.body.box_radius)
        plan = plan_of_map(grid, frame, pilot.body.radius)
        self._localize(pilot, grid)
        boxes = tuple(box for box in boxes if plan.is_open(Cell(*frame.cell_at(box.x, box.y))))
        self._say(pilot, "survey", f"I found {len(boxes)} {'box' if len(boxes) == 1 else 'boxes'}.")
        tiles = frame.cells_at(map_from_start.transform(self._order.warehouse))
        warehouse = {Cell(int(x), int(y)) for x, y in tiles}
        site = Site.of_plan(replace(plan, warehouse=frozenset(warehouse & set(plan.cells()))))
        self._centre(pilot, grid, boxes, frame, plan)
        return Ready(RobotEnvironment(pilot, frame, site, boxes), grid, frame, plan)

    def _search(self, pilot: Pilot, watch: BoxWatch, grid: OccupancyGrid, frame: CellFrame, plan: FloorPlan) -> None:
        """Drive to where boxes may stand that were never looked at from nearby."""
        occupied = occupied_cells(grid, frame, plan)
        seen = SeenCells(watch, frame, plan)
        given_up: set[Cell] = set()
        announced = False
        while True:
            here = Cell(*frame.cell_at(pilot.pose.x, pilot.pose.y))
            steps = plan.distances(here)
            suspects = {cell for cell in occupied if any(cell.towards(way) in steps for way in Direction)}
            candidates = suspects | set(steps)
            unseen = candidates - given_up - seen.cells()
            if not unseen:
                return
            if not announced:
                self._say(pilot, "survey", "There are corners that I have not looked into from nearby: I go there.")
                announced = True
            target = min(unseen, key=lambda cell: (steps.get(cell, 0), cell))
            lookouts = seen.lookouts(target, grid, sorted(steps, key=lambda cell: (steps[cell], cell)))
            goals = [(frame.centre(cell.x, cell.y), 0.3) for cell in lookouts[:MOST_LOOKOUTS]]
            goals.append((frame.centre(target.x, target.y), 1.0))
            costmap, position = self._costmap(grid, pilot, watch.boxes), _position(pilot.pose)
            paths = (shortest_path(costmap, position, goal, within=within) for goal, within in goals)
            path = next((path for path in paths if path is not None), None)
            if path is None or not self._ride(pilot, path):
                pilot.look(LOOK_EVERY * ENOUGH_LOOKS)
                given_up.add(target)

    def _centre(
        self, pilot: Pilot, grid: OccupancyGrid, boxes: tuple[Box, ...], frame: CellFrame, plan: FloorPlan
    ) -> None:
        """Drive to the middle of the nearest cell without a box."""
        taken = {Cell(*frame.cell_at(box.x, box.y)) for box in boxes}
        free = [cell for cell in plan.distances(Cell(*frame.cell_at(pilot.pose.x, pilot.pose.y))) if cell not in taken]
        costmap = self._costmap(grid, pilot, boxes)
        for cell in free:  # the nearest first
            middle = frame.centre(cell.x, cell.y)
            path = shortest_path(costmap, _position(pilot.pose), middle)
            if path is not None and pilot.follow(path) is Ride.ARRIVED:
                pilot.go_to(Pose(float(middle[0]), float(middle[1]), frame.heading(1, 0)))
                return
        raise RuntimeError("the robot stands where it can drive nowhere")

    def _costmap(self, grid: OccupancyGrid, pilot: Pilot, boxes: tuple[Box, ...]) -> Costmap:
        """Where the robot may drive: not into boxes, and surely where it stands."""
        discs = np.array([(box.x, box.y, pilot.body.box_radius) for box in boxes if box.certain]).reshape(-1, 3)
        here = np.array([[pilot.pose.x, pilot.pose.y, OWN_PLACE]])
        return Costmap.of(grid, pilot.body.radius, obstacles=discs, known_free=here)

    def _say(self, pilot: Pilot, phase: str, text: str) -> None:
        self._sink(Said(pilot.time, phase, text))


def _position(pose: Pose) -> Floats:
    """[2] m."""
    return np.array([pose.x, pose.y])
