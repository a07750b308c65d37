"""Coverage of the search for boxes: the cells in which a box would have been detected."""

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

MIN_OBSERVATIONS = MIN_DETECTIONS + 2  # scans that observe a covered cell; a box in it would be a confirmed track
BACKGROUND_OFFSET = 1.8  # distance from a cell's centre of the beams that must pass on both sides ÷ box radius


class BoxCoverage:
    """Counts, for each cell, the scans in which a box at its centre would have been detected.

    Args:
        tracker: Source of the observations; later ones are counted too.
        frame: The cell frame on the map.
        plan: The cells.
    """

    def __init__(self, tracker: BoxTracker, frame: CellFrame, plan: FloorPlan) -> None:
        self._tracker = tracker
        self._cells = [Cell(x, y) for y in range(plan.height) for x in range(plan.width)]
        self._centres = np.array([frame.centre(cell.x, cell.y) for cell in self._cells])
        self._counts = np.zeros(len(self._cells), dtype=np.int64)
        self._processed = 0

    def covered_cells(self) -> set[Cell]:
        """The cells that at least `MIN_OBSERVATIONS` scans observe within detection range and without occlusion."""
        for lidar, scan in self._tracker.observations[self._processed :]:
            self._counts += self._observed_cells(lidar, scan)
        self._processed = len(self._tracker.observations)
        return {cell for cell, count in zip(self._cells, self._counts, strict=True) if count >= MIN_OBSERVATIONS}

    def _observed_cells(self, lidar: Pose, scan: Scan) -> NDArray[np.bool_]:
        """[C] True for the cells whose centre a beam reaches while beams pass it on both sides.

        Args:
            lidar: The lidar in the map frame.
            scan: The scan.
        """
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
        """The candidates from whose centre a box in the target cell would be detected, according to the map.

        Args:
            target: The cell to observe.
            grid: The map.
            candidates: Cells to observe it from, in order of preference.
        """
        index_of = {cell: index for index, cell in enumerate(self._cells)}
        positions = self._centres[[index_of[cell] for cell in candidates]]
        offsets = self._centres[index_of[target]] - positions
        distances = np.hypot(offsets[:, 0], offsets[:, 1])
        in_range = np.flatnonzero((distances > 0.0) & (distances < MAX_DETECTION_RANGE))
        found = []
        for index in in_range:
            half_angle = float(_half_angle(distances[index], self._tracker.box_radius))
            pose = np.array([[*positions[index], np.arctan2(offsets[index, 1], offsets[index, 0])]])
            directions = np.array([-half_angle, 0.0, half_angle])
            left, middle, right = cast_rays(
                grid.occupied, grid.resolution, grid.origin, pose, directions, MAX_DETECTION_RANGE + grid.resolution
            )[0]
            if middle > distances[index] - 2 * self._tracker.box_radius and min(left, right) > distances[index]:
                found.append(candidates[int(index)])
        return found


def _half_angle(distances: Floats, radius: float) -> Floats:
    """[N] angles, rad, between the beam to a cell's centre and the beams that must pass on both sides of it.

    Args:
        distances: [N] distances of the centres from the lidar, m.
        radius: Radius of a box, m.
    """
    angles: Floats = np.arcsin(np.minimum(BACKGROUND_OFFSET * radius / np.maximum(distances, radius), 1.0))
    return angles
