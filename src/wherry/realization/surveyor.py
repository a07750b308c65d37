"""Survey of a building: frontier exploration until the map is complete, then a search of all cells for boxes.

The removal of a blocking box makes more cells reachable. A surveyor therefore keeps its coverage, and can survey again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wherry.errors import InputError
from wherry.floorplan.plan import Cell, Direction, FloorPlan
from wherry.navigation.exploration import Viewpoint, frontier_cells, next_viewpoint, visible_unknown_area
from wherry.navigation.path import Costmap, shortest_path
from wherry.realization.box_coverage import MIN_OBSERVATIONS, BoxCoverage
from wherry.realization.box_isolation import erase_boxes, isolated_boxes
from wherry.realization.box_tracker import DETECTION_PERIOD, BoxTracker
from wherry.realization.box_tracks import BoxTrack
from wherry.realization.cells import floor_plan_from_map, occupied_cells
from wherry.realization.pilot import Pilot
from wherry.realization.pose_estimators import Mapper
from wherry.realization.replanning import ReplanningFollower
from wherry.space.frame import CellFrame, fit_cell_frame
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats
from wherry.trace.records import MapUpdate, Narration, Phase

CLEARED_RADIUS = 0.35  # m around base_link within which unknown cells count as free
MIN_GAIN = 0.15  # m², smallest visible unknown area of a worthwhile viewpoint; less than half a cell
MAX_VIEWPOINTS = 3  # viewpoints per cell to which a path is planned
VIEWPOINT_TOLERANCE = 0.3  # m, largest distance of a path's end from its viewpoint
CELL_TOLERANCE = 1.0  # m, largest distance of a path's end from the centre of the cell to observe
FRONTIER_DEPTH = 1.0  # m, assumed depth of the unknown space behind frontiers, for the explored fraction
OCCLUSION_RADIUS = 1.0  # m around a removed box within which viewpoints and cells are tried again
SEARCH_TIMEOUT = 120.0  # s, robot's clock, without a newly covered cell after which the present target is abandoned
MAX_SEARCH_TIMEOUTS = 3  # timeouts after which a finished map is refused


@dataclass(frozen=True)
class CellMap:
    """A map discretized into cells.

    Attributes:
        grid: The map, without boxes.
        frame: The cell frame on the map.
        plan: The cells and the walls between them.
    """

    grid: OccupancyGrid
    frame: CellFrame
    plan: FloorPlan


class Surveyor:
    """Drives a robot until it has observed all reachable cells.

    Args:
        pilot: Drives the robot.
        cell_size: Side of the cells, m.
        mapper: Builds the map; None for a finished map.
        grid: The finished map; None with a mapper.

    Attributes:
        pilot: Drives the robot.
        tracker: Tracks boxes during the survey.
        mapper: Builds the map; None for a finished map.
    """

    def __init__(
        self, pilot: Pilot, cell_size: float, mapper: Mapper | None = None, grid: OccupancyGrid | None = None
    ) -> None:
        self.pilot = pilot
        self.tracker = BoxTracker(pilot)
        self.mapper = mapper
        self._grid = grid
        self._cell_size = cell_size
        self._follower = ReplanningFollower(pilot)
        self._removed: tuple[BoxTrack, ...] = ()
        self._visited_viewpoints: list[Floats] = []  # viewpoints of exploration, m, map frame
        self._abandoned_cells: list[Floats] = []  # centres of cells that could not be reached or observed, m, map frame
        self._search_area: tuple[CellMap, BoxCoverage] | None = None
        self._search_timeouts = 0

    def survey(self) -> None:
        """Explore until no reachable frontier is left, then search every reachable cell for boxes.

        Raises:
            InputError: The map has no walls to align cells with, or it is finished and shows free space where the robot
                cannot drive.
        """
        self.tracker.start()
        self.pilot.wait_for_scan()
        if self.mapper is not None:
            self._explore()
        self._search_for_boxes()
        self.tracker.stop()

    def boxes(self) -> tuple[BoxTrack, ...]:
        """The boxes found on the floor."""
        return isolated_boxes(self.tracker.tracks, self._map(), self.pilot.body.box_radius)

    def cell_map(self) -> CellMap:
        """The map so far, discretized into cells.

        Raises:
            InputError: There are no walls to align cells with.
        """
        grid = erase_boxes(self._map(), self.boxes(), self.pilot.body.box_radius)
        walls = grid.occupied_points()
        if not len(walls):
            raise InputError("map", "", "has no walls to align cells with")
        frame = fit_cell_frame(walls, self._cell_size)
        return CellMap(grid, frame, floor_plan_from_map(grid, frame, self.pilot.body.radius))

    def update_boxes(self, on_floor: Sequence[BoxTrack], removed: Sequence[BoxTrack]) -> None:
        """Replace the boxes; viewpoints and cells that a removed box may have occluded are tried again.

        Args:
            on_floor: Tracks of all known boxes on the floor.
            removed: Tracks of all boxes that were picked up so far.
        """
        newly_removed = [np.array([track.x, track.y]) for track in removed if track not in self._removed]
        self._visited_viewpoints = [
            point for point in self._visited_viewpoints if not _may_have_been_occluded(point, newly_removed)
        ]
        self._abandoned_cells = [
            point for point in self._abandoned_cells if not _may_have_been_occluded(point, newly_removed)
        ]
        self._removed = tuple(removed)
        self.tracker.tracks = tuple(on_floor)

    def has_more_to_observe(self, *, without: BoxTrack | None = None) -> bool:
        """Whether a survey would observe more area.

        Args:
            without: Box that is assumed to be removed; None for none.
        """
        boxes = [track for track in self.tracker.tracks if track != without]
        grid = self._map()
        if without is not None:
            grid = erase_boxes(grid, [without], self.pilot.body.box_radius)
        if self._next_viewpoint(grid, boxes) is not None:
            return True
        return self._search_area is not None and bool(self._uncovered_cells(*self._search_area, boxes))

    def _explore(self) -> None:
        """Drive from viewpoint to viewpoint until no reachable one is worthwhile."""
        goal: Floats | None = None
        while True:
            grid = self._map()
            boxes = self.tracker.publish(grid)
            if goal is None or visible_unknown_area(grid, goal) < MIN_GAIN:
                viewpoint = self._next_viewpoint(grid, boxes)
                if viewpoint is None:
                    break
                goal = viewpoint.position
            self._record_progress(grid)
            costmap = costmap_around(self.pilot, grid, boxes)
            path = shortest_path(costmap, self._position(), goal)
            if path is None or not self._follower.follow(path, costmap):
                self._visited_viewpoints.append(goal)
                goal = None
        self.pilot.stop()
        self._say(Phase.EXPLORE, "No reachable frontier is left: the map is complete.")

    def _next_viewpoint(self, grid: OccupancyGrid, boxes: Sequence[BoxTrack]) -> Viewpoint | None:
        """The best viewpoint during mapping; None if none is worthwhile or the map is finished."""
        if self.mapper is None:
            return None
        visited = np.array(self._visited_viewpoints).reshape(-1, 2)
        costmap = costmap_around(self.pilot, grid, boxes)
        return next_viewpoint(grid, costmap, self.pilot.pose, visited, min_gain=MIN_GAIN)

    def _search_for_boxes(self) -> None:
        """Drive to viewpoints of uncovered cells, the nearest first, until all are covered or abandoned."""
        cell_map = self.cell_map()
        coverage = BoxCoverage(self.tracker, cell_map.frame, cell_map.plan)
        self._search_area = cell_map, coverage
        has_announced = False
        covered, deadline = 0, self.pilot.time + SEARCH_TIMEOUT
        while True:
            boxes = self.tracker.publish(cell_map.grid)
            uncovered = self._uncovered_cells(cell_map, coverage, boxes)
            if not uncovered:
                return
            if not has_announced:
                self._say(Phase.SURVEY, "Some cells were never observed from nearby: I search them for boxes.")
                has_announced = True
            target = min(uncovered, key=lambda cell: (uncovered[cell], cell))
            costmap = costmap_around(self.pilot, cell_map.grid, boxes)
            path = self._path_to_observe(target, cell_map, coverage, boxes, costmap)
            if len(coverage.covered_cells()) > covered:
                covered, deadline = len(coverage.covered_cells()), self.pilot.time + SEARCH_TIMEOUT
            is_late = self.pilot.time > deadline
            if is_late or path is None or not self._follower.follow(path, costmap):
                self.pilot.wait_for_scan(DETECTION_PERIOD * MIN_OBSERVATIONS)
                self._abandoned_cells.append(cell_map.frame.centre(target.x, target.y))
            if is_late:
                self._count_timeout()
                deadline = self.pilot.time + SEARCH_TIMEOUT

    def _count_timeout(self) -> None:
        """Count a timeout of the search.

        Raises:
            InputError: There were too many for a finished map, which is probably of another place.
        """
        self._search_timeouts += 1
        if self.mapper is None and self._search_timeouts >= MAX_SEARCH_TIMEOUTS:
            self.pilot.stop()
            reason = f"it shows free space that was not reached in {MAX_SEARCH_TIMEOUTS * SEARCH_TIMEOUT:g} s"
            raise InputError("map", "", f"does not fit what the lidar sees: {reason}")

    def _uncovered_cells(self, cell_map: CellMap, coverage: BoxCoverage, boxes: Sequence[BoxTrack]) -> dict[Cell, int]:
        """Cells in which a box may be undetected, each with its number of moves from the robot, 0 if not reachable.

        These are the reachable cells and their occupied neighbours, except covered and abandoned ones.
        """
        moves = self._moves_to_cells(cell_map, boxes)
        occupied = occupied_cells(cell_map.grid, cell_map.frame, cell_map.plan)
        candidates = {cell for cell in occupied if any(cell.neighbour(direction) in moves for direction in Direction)}
        abandoned = {Cell(*cell_map.frame.cell_at(x, y)) for x, y in self._abandoned_cells}
        return {cell: moves.get(cell, 0) for cell in (candidates | set(moves)) - abandoned - coverage.covered_cells()}

    def _moves_to_cells(self, cell_map: CellMap, boxes: Sequence[BoxTrack]) -> dict[Cell, int]:
        """Number of moves to each cell that the robot can reach without entering a box's cell."""
        blocked = {Cell(*cell_map.frame.cell_at(track.x, track.y)) for track in boxes}
        start = Cell(*cell_map.frame.cell_at(self.pilot.pose.x, self.pilot.pose.y))
        return cell_map.plan.distances(start, blocked)

    def _path_to_observe(
        self, target: Cell, cell_map: CellMap, coverage: BoxCoverage, boxes: Sequence[BoxTrack], costmap: Costmap
    ) -> Floats | None:
        """[N, 2] path to the nearest viewpoint of a cell, or else to the cell, m, map frame; None if there is none."""
        moves = self._moves_to_cells(cell_map, boxes)
        viewpoints = coverage.viewpoints(target, cell_map.grid, sorted(moves, key=lambda cell: (moves[cell], cell)))
        goals = [(cell_map.frame.centre(cell.x, cell.y), VIEWPOINT_TOLERANCE) for cell in viewpoints[:MAX_VIEWPOINTS]]
        goals.append((cell_map.frame.centre(target.x, target.y), CELL_TOLERANCE))
        paths = (shortest_path(costmap, self._position(), goal, snap_distance=tolerance) for goal, tolerance in goals)
        return next((path for path in paths if path is not None), None)

    def _map(self) -> OccupancyGrid:
        """The map so far, from which removed boxes are erased."""
        if self.mapper is not None:
            self._grid = self.mapper.grid()
        if self._grid is None:
            raise ValueError("a surveyor needs a map or a mapper")
        return erase_boxes(self._grid, self._removed, self.pilot.body.box_radius)

    def _position(self) -> Floats:
        """[2] position of base_link, m, map frame."""
        return np.array([self.pilot.pose.x, self.pilot.pose.y])

    def _record_progress(self, grid: OccupancyGrid) -> None:
        """Record the map so far and the explored fraction."""
        frontier_length = float(np.count_nonzero(frontier_cells(grid))) * grid.resolution  # m
        free_area = float(np.count_nonzero(grid.free)) * grid.resolution**2  # m²
        fraction = free_area / (free_area + frontier_length * FRONTIER_DEPTH)
        self.pilot.sink(MapUpdate(self.pilot.time, grid, fraction, frontier_length))

    def _say(self, phase: Phase, text: str) -> None:
        self.pilot.sink(Narration(self.pilot.time, phase, text))


def costmap_around(pilot: Pilot, grid: OccupancyGrid, boxes: Sequence[BoxTrack]) -> Costmap:
    """The costmap of a map, with boxes as obstacles and free space around the robot."""
    obstacles = np.array([(track.x, track.y, pilot.body.box_radius) for track in boxes]).reshape(-1, 3)
    cleared = np.array([[pilot.pose.x, pilot.pose.y, CLEARED_RADIUS]])
    return Costmap.from_grid(grid, pilot.body.radius, obstacles=obstacles, known_free=cleared)


def _may_have_been_occluded(point: Floats, removed: Sequence[Floats]) -> bool:
    """Whether a point, [2] m, map frame, is near one of the removed boxes, at positions [2] m, map frame."""
    return any(float(np.hypot(*(point - other))) < OCCLUSION_RADIUS for other in removed)
