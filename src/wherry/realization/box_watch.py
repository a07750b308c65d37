"""Looking out for boxes while driving, and knowing where one has not looked yet."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from wherry.floorplan.plan import Cell, FloorPlan
from wherry.realization.boxes import FARTHEST, FEWEST_SIGHTINGS, Box, look_for_boxes, standing_alone, standing_free
from wherry.realization.pilot import Load, Pilot, without_load
from wherry.robot import Scan
from wherry.space.frame import CellFrame
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose
from wherry.space.raycast import cast_rays

LOOK_EVERY = 3  # scans between two that are searched for boxes
ENOUGH_LOOKS = FEWEST_SIGHTINGS + 2  # after which a box in a cell would be certain
BESIDE = 1.8  # box radii from a cell's middle to where beams must pass it, so that a box there would stand out


class BoxWatch:
    """Searches every few scans for round things, and keeps the scans for `SeenCells`.

    Attributes:
        boxes: What may be a box.
        looks: Every scan that was searched, with the lidar's pose in the map frame when it was taken.
    """

    def __init__(self, pilot: Pilot) -> None:
        self.boxes: tuple[Box, ...] = ()
        self.looks: list[tuple[Pose, Scan]] = []
        self.box_radius = pilot.body.box_radius
        self._pilot = pilot
        self._scans = 0

    def start(self) -> None:
        """Watch from now on."""
        self._pilot.watchers.append(self)

    def __call__(self, scan: Scan, pose: Pose) -> None:
        """Take in a scan."""
        self._scans += 1
        if self._scans % LOOK_EVERY:
            return
        body = self._pilot.body
        scan = without_load(scan, body)
        self.boxes = look_for_boxes(self.boxes, scan, pose, body)
        self.looks.append((pose @ body.lidar, scan))

    def show(self, grid: OccupancyGrid) -> tuple[Box, ...]:
        """Tell the pilot which of the round things are surely boxes; return those that are, as far as the map tells."""
        places = [(box.x, box.y) for box in standing_alone(self.boxes, grid, self.box_radius)]
        self._pilot.load = Load(np.array(places).reshape(-1, 2), held=self._pilot.load.held)
        return standing_free(self.boxes, grid, self.box_radius)

    def stop(self) -> None:
        """Watch no longer."""
        self._pilot.watchers.remove(self)


class SeenCells:
    """In which cells a box would have been seen by now.

    Args:
        watch: What was looked at; it may go on looking.
        frame: Where the cells lie.
        plan: Which cells there are.
    """

    def __init__(self, watch: BoxWatch, frame: CellFrame, plan: FloorPlan) -> None:
        self._watch = watch
        self._cells = [Cell(x, y) for y in range(plan.height) for x in range(plan.width)]
        self._centres = np.array([frame.centre(cell.x, cell.y) for cell in self._cells])
        self._counts = np.zeros(len(self._cells), dtype=np.int64)
        self._counted = 0

    def cells(self) -> set[Cell]:
        """The cells that were looked into several times, from near enough and with nothing in between."""
        for lidar, scan in self._watch.looks[self._counted :]:
            self._counts += self._looked_into(lidar, scan)
        self._counted = len(self._watch.looks)
        return {cell for cell, count in zip(self._cells, self._counts, strict=True) if count >= ENOUGH_LOOKS}

    def _looked_into(self, lidar: Pose, scan: Scan) -> NDArray[np.bool_]:
        """[C] the cells into whose middle a scan looked, and past it on both sides."""
        away = lidar.inverse.transform(self._centres)
        distances = np.hypot(away[:, 0], away[:, 1])
        bearings = np.arctan2(away[:, 1], away[:, 0])
        ranges = np.where(np.isnan(scan.ranges), 0.0, scan.ranges)

        def reached(directions: Floats) -> Floats:
            beams = np.round((directions - scan.angle_min) / scan.angle_increment).astype(np.int64)
            return ranges[beams % len(ranges)]

        aside = _aside(distances, self._watch.box_radius)
        passed = np.minimum(reached(bearings - aside), reached(bearings + aside)) > distances
        looked: NDArray[np.bool_] = reached(bearings) > distances - 2 * self._watch.box_radius
        return looked & passed & (distances < FARTHEST)

    def lookouts(self, target: Cell, grid: OccupancyGrid, cells: Sequence[Cell]) -> list[Cell]:
        """The cells from whose middle a box in the target would stand out, as far as the map knows, in their order."""
        index = {cell: at for at, cell in enumerate(self._cells)}
        places = self._centres[[index[cell] for cell in cells]]
        away = self._centres[index[target]] - places
        distances = np.hypot(away[:, 0], away[:, 1])
        near = np.flatnonzero((distances > 0.0) & (distances < FARTHEST))
        found = []
        for at in near:
            aside = float(_aside(distances[at], self._watch.box_radius))
            pose = np.array([[*places[at], np.arctan2(away[at, 1], away[at, 0])]])
            directions = np.array([-aside, 0.0, aside])
            left, middle, right = cast_rays(
                grid.occupied, grid.resolution, grid.origin, pose, directions, FARTHEST + grid.resolution
            )[0]
            if middle > distances[at] - 2 * self._watch.box_radius and min(left, right) > distances[at]:
                found.append(cells[int(at)])
        return found


def _aside(distances: Floats, radius: float) -> Floats:
    """rad, between the beams to a place and past a box there."""
    angles: Floats = np.arcsin(np.minimum(BESIDE * radius / np.maximum(distances, radius), 1.0))
    return angles
