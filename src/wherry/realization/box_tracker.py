"""Tracking of boxes while the robot drives."""

from __future__ import annotations

import numpy as np

from wherry.realization.box_isolation import isolated_boxes, isolated_boxes_on_partial_map
from wherry.realization.box_tracks import BoxTrack, update_tracks
from wherry.realization.load import mask_load
from wherry.realization.pilot import KnownBoxes, Pilot
from wherry.robot import Scan
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose

DETECTION_PERIOD = 3  # scans from one that is searched for boxes to the next


class BoxTracker:
    """A scan callback of the pilot that updates box tracks and keeps the scans for `BoxCoverage`.

    Attributes:
        tracks: The box tracks so far.
        observations: Every scan that was searched for boxes, with the lidar's pose in the map frame at its time.
        box_radius: Radius of a box, m.
    """

    def __init__(self, pilot: Pilot) -> None:
        self.tracks: tuple[BoxTrack, ...] = ()
        self.observations: list[tuple[Pose, Scan]] = []
        self.box_radius = pilot.body.box_radius
        self._pilot = pilot
        self._scan_count = 0

    def start(self) -> None:
        """Receive the pilot's scans from now on."""
        self._pilot.scan_callbacks.append(self)

    def stop(self) -> None:
        """Receive no more scans."""
        self._pilot.scan_callbacks.remove(self)

    def __call__(self, scan: Scan, pose: Pose) -> None:
        """Update the tracks with a scan, taken with base_link at a pose in the map frame."""
        self._scan_count += 1
        if self._scan_count % DETECTION_PERIOD:
            return
        body = self._pilot.body
        scan = mask_load(scan, body)
        self.tracks = update_tracks(self.tracks, scan, pose, body)
        self.observations.append((pose @ body.lidar, scan))

    def publish(self, grid: OccupancyGrid) -> tuple[BoxTrack, ...]:
        """Give the pilot the boxes that no later scan can turn into walls; return all that are isolated on the map."""
        shown = isolated_boxes_on_partial_map(self.tracks, grid, self.box_radius)
        positions = np.array([(track.x, track.y) for track in shown]).reshape(-1, 2)
        self._pilot.boxes = KnownBoxes(positions, is_holding=self._pilot.boxes.is_holding)
        return isolated_boxes(self.tracks, grid, self.box_radius)
