"""Seeing all that a robot can get to: the whole map, and every corner of it in which a box may stand.

What a robot can get to changes when a box goes that stood in the only way; a survey remembers where it has looked, so
that it can be asked again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wherry.errors import InputError
from wherry.floorplan.plan import Cell, Direction, FloorPlan
from wherry.navigation.exploration import Viewpoint, frontier_cells, next_viewpoint, visible_unknown
from wherry.navigation.path import Costmap, shortest_path
from wherry.realization.box_watch import ENOUGH_LOOKS, LOOK_EVERY, BoxWatch, SeenCells
from wherry.realization.boxes import Box, standing_free, without_boxes
from wherry.realization.cells import occupied_cells, plan_of_map
from wherry.realization.correctors import Mapper
from wherry.realization.pilot import Pilot, Ride
from wherry.space.frame import CellFrame, lay_cells
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose
from wherry.trace.records import MapUpdate, Narration, Phase

REPLAN = 1.5  # s of driving after which the growing map is looked at again
OWN_PLACE = 0.35  # m around itself that a robot knows to be free although its lidar cannot see it
WORTHWHILE = 0.15  # m² of the unknown, less than half a cell, for which the robot drives to see them
MOST_LOOKOUTS = 3  # places that are tried to look into a cell from
BEHIND_FRONTIER = 1.0  # m of unknown that are expected behind a frontier, to tell how far a map has come
STEP_BACK = 0.3  # m, how far the robot steps back at most from where the laser has stopped it
IN_SHADOW = 1.0  # m from a box that has gone: what was looked at from or in there is looked at anew


@dataclass(frozen=True)
class Chart:
    """A map with cells laid on it.

    Attributes:
        grid: The map, without boxes.
        frame: Where the cells lie on it.
        plan: The map in cells.
    """

    grid: OccupancyGrid
    frame: CellFrame
    plan: FloorPlan


class Survey:
    """Drives a robot to where there is something to see, and knows what it has seen.

    Args:
        pilot: Drives the robot.
        cell_size: m, the side of the cells.
        mapper: Makes the map; None if it is finished.
        grid: The finished map; may be left out if there is a mapper.
    """

    def __init__(
        self, pilot: Pilot, cell_size: float, mapper: Mapper | None = None, grid: OccupancyGrid | None = None
    ) -> None:
        self.pilot = pilot
        self.watch = BoxWatch(pilot)
        self.mapper = mapper
        self._grid = grid
        self._cell_size = cell_size
        self._gone: tuple[Box, ...] = ()
        self._looked: list[Floats] = []
        self._given_up: list[Floats] = []
        self._stepped_back = False
        self._searched: tuple[Chart, SeenCells] | None = None

    def begin_anew(self, standing: Sequence[Box], gone: Sequence[Box]) -> None:
        """Take in where boxes stand now, before it is asked what there is to see.

        Args:
            standing: All boxes on the floor that are known.
            gone: All that were there once.
        """
        places = [np.array([box.x, box.y]) for box in gone if box not in self._gone]
        self._looked = [place for place in self._looked if not _is_near(place, places)]
        self._given_up = [place for place in self._given_up if not _is_near(place, places)]
        self._gone = tuple(gone)
        self.watch.boxes = tuple(standing)

    def boxes(self) -> tuple[Box, ...]:
        """The boxes that stand on the floor, as far as they have been seen."""
        return standing_free(self.watch.boxes, self._map(), self.pilot.body.box_radius)

    def chart(self) -> Chart:
        """The map as it is now, and cells on it.

        Raises:
            InputError: There are no walls to lay cells along.
        """
        grid = without_boxes(self._map(), self.boxes(), self.pilot.body.box_radius)
        walls = grid.occupied_points()
        if not len(walls):
            raise InputError("map", "", "has no walls to lay cells along")
        frame = lay_cells(walls, self._cell_size)
        return Chart(grid, frame, plan_of_map(grid, frame, self.pilot.body.radius))

    def would_show_more(self, *, without: Box | None = None) -> bool:
        """Whether there is something to see that the robot can get to, or could if a box had gone."""
        boxes = [box for box in self.watch.boxes if box != without]
        grid = self._map()
        if without is not None:
            grid = without_boxes(grid, [without], self.pilot.body.box_radius)
        if self._next_viewpoint(grid, boxes) is not None:
            return True
        return self._searched is not None and bool(self._unseen(*self._searched, boxes))

    def run(self) -> None:
        """See everything: explore, then look into every corner."""
        self.watch.start()
        self.pilot.look()
        if self.mapper is not None:
            self._explore(self.mapper)
        self._search()
        self.watch.stop()

    def _explore(self, mapper: Mapper) -> None:
        """Drive to where most is unknown, until nothing reachable is."""
        goal: Floats | None = None
        while True:
            grid = self._map()
            boxes = self.watch.show(grid)
            if goal is None or visible_unknown(grid, goal) < WORTHWHILE:
                viewpoint = self._next_viewpoint(grid, boxes)
                if viewpoint is None:
                    break
                goal = viewpoint.position
            self._tell_progress(grid)
            costmap = self._costmap(grid, boxes)
            path = shortest_path(costmap, _position(self.pilot.pose), goal)
            if path is None or not self._ride(path, costmap):
                self._looked.append(goal)
                goal = None
        self.pilot.stand()
        self._say(Phase.EXPLORE, "Nothing that I can reach is unknown any more.")

    def _next_viewpoint(self, grid: OccupancyGrid, boxes: Sequence[Box]) -> Viewpoint | None:
        """Where to look next while the map grows; None if that would show nothing."""
        if self.mapper is None:
            return None
        looked = np.array(self._looked).reshape(-1, 2)
        costmap = self._costmap(grid, boxes)
        return next_viewpoint(grid, costmap, self.pilot.pose, looked, least_gain=WORTHWHILE)

    def _search(self) -> None:
        """Drive to where boxes may stand that were never looked at from nearby."""
        chart = self.chart()
        grid, frame = chart.grid, chart.frame
        seen = SeenCells(self.watch, frame, chart.plan)
        self._searched = chart, seen
        announced = False
        while True:
            boxes = self.watch.show(grid)
            unseen = self._unseen(chart, seen, boxes)
            if not unseen:
                return
            if not announced:
                self._say(Phase.SURVEY, "There are corners that I have not looked into from nearby: I go there.")
                announced = True
            target = min(unseen, key=lambda cell: (unseen[cell], cell))
            steps = self._steps(chart, boxes)
            lookouts = seen.lookouts(target, grid, sorted(steps, key=lambda cell: (steps[cell], cell)))
            goals = [(frame.centre(cell.x, cell.y), 0.3) for cell in lookouts[:MOST_LOOKOUTS]]
            goals.append((frame.centre(target.x, target.y), 1.0))
            costmap, position = self._costmap(grid, boxes), _position(self.pilot.pose)
            paths = (shortest_path(costmap, position, goal, within=within) for goal, within in goals)
            path = next((path for path in paths if path is not None), None)
            if path is None or not self._ride(path, costmap):
                self.pilot.look(LOOK_EVERY * ENOUGH_LOOKS)
                self._given_up.append(frame.centre(target.x, target.y))

    def _unseen(self, chart: Chart, seen: SeenCells, boxes: Sequence[Box]) -> dict[Cell, int]:
        """The cells that boxes may stand in unseen, and how many steps away they are."""
        steps = self._steps(chart, boxes)
        occupied = occupied_cells(chart.grid, chart.frame, chart.plan)
        suspects = {cell for cell in occupied if any(cell.neighbour(way) in steps for way in Direction)}
        given_up = {Cell(*chart.frame.cell_at(x, y)) for x, y in self._given_up}
        return {cell: steps.get(cell, 0) for cell in (suspects | set(steps)) - given_up - seen.cells()}

    def _steps(self, chart: Chart, boxes: Sequence[Box]) -> dict[Cell, int]:
        """How many steps away the cells are that the robot can get to without passing a box."""
        barred = {Cell(*chart.frame.cell_at(box.x, box.y)) for box in boxes}
        return chart.plan.distances(Cell(*chart.frame.cell_at(self.pilot.pose.x, self.pilot.pose.y)), barred)

    def _map(self) -> OccupancyGrid:
        """The map as it is now; boxes that stand on the floor are on it, but not those that have gone."""
        if self.mapper is not None:
            self._grid = self.mapper.grid()
        if self._grid is None:
            raise ValueError("a survey needs a map, or someone who makes one")
        return without_boxes(self._grid, self._gone, self.pilot.body.box_radius)

    def _costmap(self, grid: OccupancyGrid, boxes: Sequence[Box]) -> Costmap:
        """Where the robot may drive: not into boxes, and surely where it stands."""
        return costmap_of(grid, self.pilot, boxes)

    def _ride(self, path: Floats, costmap: Costmap) -> bool:
        """Follow a path for a while; whether it is worth going on, for the robot is neither there nor held up for good.

        Where the laser stops it for the first time on its way to a goal, it steps back to where there is more room:
        paths lead closer past jambs than the laser allows.
        """
        pilot, reverse = self.pilot, self.pilot.load.held
        deadline = pilot.time + REPLAN
        ride = pilot.follow(path, reverse=reverse, until=lambda: pilot.time >= deadline)
        if ride is Ride.HELD_UP and not self._stepped_back:
            self._stepped_back = True
            row, column = costmap.roomiest(_position(pilot.pose), STEP_BACK)
            x, y = costmap.centres(np.array([[row, column]]))[0].tolist()
            ahead = pilot.pose.inverse.transform(np.array([[x, y]]))[0, 0] > 0.0
            return pilot.go_to(Pose(x, y, pilot.pose.theta), reverse=reverse or not ahead)
        self._stepped_back &= ride is Ride.CUT_SHORT
        return ride is Ride.CUT_SHORT

    def _tell_progress(self, grid: OccupancyGrid) -> None:
        """Tell the sink how far the map has come."""
        frontier = float(np.count_nonzero(frontier_cells(grid))) * grid.resolution  # m
        known = float(np.count_nonzero(grid.free)) * grid.resolution**2  # m²
        fraction = known / (known + frontier * BEHIND_FRONTIER)
        self.pilot.sink(MapUpdate(self.pilot.time, grid, fraction, frontier))

    def _say(self, phase: Phase, text: str) -> None:
        self.pilot.sink(Narration(self.pilot.time, phase, text))


def costmap_of(grid: OccupancyGrid, pilot: Pilot, boxes: Sequence[Box]) -> Costmap:
    """Where a robot may drive on a map without boxes: not into boxes, and surely where it stands."""
    discs = np.array([(box.x, box.y, pilot.body.box_radius) for box in boxes]).reshape(-1, 3)
    here = np.array([[pilot.pose.x, pilot.pose.y, OWN_PLACE]])
    return Costmap.of(grid, pilot.body.radius, obstacles=discs, known_free=here)


def _is_near(place: Floats, places: Sequence[Floats]) -> bool:
    return any(float(np.hypot(*(place - other))) < IN_SHADOW for other in places)


def _position(pose: Pose) -> Floats:
    """[2] m."""
    return np.array([pose.x, pose.y])
