"""Which cells of the map the robot has already searched for boxes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from wherry.floorplan.plan import Cell, FloorPlan
from wherry.realization.box_detection import MAX_DETECTION_RANGE
from wherry.realization.box_tracker import BoxTracker
from wherry.realization.box_tracks import MIN_DETECTIONS
from wherry.robot import Scan
from wherry.space.frame import CellFrame
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose
from wherry.space.raycast import cast_rays

MIN_OBSERVATIONS = MIN_DETECTIONS + 2  # scans of a cell after which a box in it would be a confirmed track
BACKGROUND_OFFSET = 1.8  # box radii from a cell's centre at which beams must pass it for a box to stand out


class BoxCoverage:
    """Counts, for each cell, the scans in which a box at its centre would have been detected.

    Args:
        tracker: Source of the observations; it may add more.
        frame: Where the cells lie on the map.
        plan: The cells.
    """

    def __init__(self, tracker: BoxTracker, frame: CellFrame, plan: FloorPlan) -> None:
        self._tracker = tracker
        self._cells = [Cell(x, y) for y in range(plan.height) for x in range(plan.width)]
        self._centres = np.array([frame.centre(cell.x, cell.y) for cell in self._cells])
        self._counts = np.zeros(len(self._cells), dtype=np.int64)
        self._processed = 0

    def covered_cells(self) -> set[Cell]:
        """The cells observed in at least `MIN_OBSERVATIONS` scans, from detection range and without occlusion."""
        for lidar, scan in self._tracker.observations[self._processed :]:
            self._counts += self._is_observed(lidar, scan)
        self._processed = len(self._tracker.observations)
        return {cell for cell, count in zip(self._cells, self._counts, strict=True) if count >= MIN_OBSERVATIONS}

    def _is_observed(self, lidar: Pose, scan: Scan) -> NDArray[np.bool_]:
        """[C] which cells a scan observes: a beam reaches the centre, and beams pass beyond it on both sides."""
        offsets = lidar.inverse.transform(self._centres)
        distances = np.hypot(offsets[:, 0], offsets[:, 1])
        bearings = np.arctan2(offsets[:, 1], offsets[:, 0])
        ranges = np.where(np.isnan(scan.ranges), 0.0, scan.ranges)

        def range_at(directions: Floats) -> Floats:
            beams = np.round((directions - scan.angle_min) / scan.angle_increment).astype(np.int64)
            return ranges[beams % len(ranges)]

        half_angle = _half_angle(distances, self._tracker.box_radius)
        is_passed = np.minimum(range_at(bearings - half_angle), range_at(bearings + half_angle)) > distances
        is_reached: NDArray[np.bool_] = range_at(bearings) > distances - 2 * self._tracker.box_radius
        return is_reached & is_passed & (distances < MAX_DETECTION_RANGE)

    def viewpoints(self, target: Cell, grid: OccupancyGrid, candidates: Sequence[Cell]) -> list[Cell]:
        """The candidates, in their order, from whose centre the map predicts that a box in the target is detected."""
        index = {cell: at for at, cell in enumerate(self._cells)}
        positions = self._centres[[index[cell] for cell in candidates]]
        offsets = self._centres[index[target]] - positions
        distances = np.hypot(offsets[:, 0], offsets[:, 1])
        near = np.flatnonzero((distances > 0.0) & (distances < MAX_DETECTION_RANGE))
        found = []
        for at in near:
            half_angle = float(_half_angle(distances[at], self._tracker.box_radius))
            pose = np.array([[*positions[at], np.arctan2(offsets[at, 1], offsets[at, 0])]])
            directions = np.array([-half_angle, 0.0, half_angle])
            left, middle, right = cast_rays(
                grid.occupied, grid.resolution, grid.origin, pose, directions, MAX_DETECTION_RANGE + grid.resolution
            )[0]
            if middle > distances[at] - 2 * self._tracker.box_radius and min(left, right) > distances[at]:
                found.append(candidates[int(at)])
        return found


def _half_angle(distances: Floats, radius: float) -> Floats:
    """Angle between the beam to a cell's centre and a beam that passes a box there, rad."""
    angles: Floats = np.arcsin(np.minimum(BACKGROUND_OFFSET * radius / np.maximum(distances, radius), 1.0))
    return angles
