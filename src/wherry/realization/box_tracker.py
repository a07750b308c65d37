"""Tracking of boxes during a survey, as a scan callback of the pilot."""

from __future__ import annotations

import numpy as np

from wherry.realization.box_isolation import isolated_boxes, isolated_boxes_on_partial_map
from wherry.realization.box_tracks import BoxTrack, update_tracks
from wherry.realization.load import mask_load
from wherry.realization.pilot import KnownBoxes, Pilot
from wherry.robot import Scan
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose

DETECTION_PERIOD = 3  # boxes are detected in every third scan


class BoxTracker:
    """Updates box tracks with the pilot's scans, and stores these scans for `BoxCoverage`.

    Args:
        pilot: Source of the scans.

    Attributes:
        tracks: The box tracks so far.
        observations: All scans that were searched for boxes, each with the lidar's pose in the map frame.
        box_radius: Radius of a box, m.
    """

    def __init__(self, pilot: Pilot) -> None:
        self.tracks: tuple[BoxTrack, ...] = ()
        self.observations: list[tuple[Pose, Scan]] = []
        self.box_radius = pilot.body.box_radius
        self._pilot = pilot
        self._scan_count = 0

    def start(self) -> None:
        """Begin to receive the pilot's scans."""
        self._pilot.scan_callbacks.append(self)

    def stop(self) -> None:
        """Stop receiving scans."""
        self._pilot.scan_callbacks.remove(self)

    def __call__(self, scan: Scan, pose: Pose) -> None:
        """Update the tracks with every `DETECTION_PERIOD`-th scan.

        Args:
            scan: The new scan.
            pose: base_link in the map frame at the scan's time.
        """
        self._scan_count += 1
        if self._scan_count % DETECTION_PERIOD:
            return
        body = self._pilot.body
        scan = mask_load(scan, body)
        self.tracks = update_tracks(self.tracks, scan, pose, body)
        self.observations.append((pose @ body.lidar, scan))

    def publish(self, grid: OccupancyGrid) -> tuple[BoxTrack, ...]:
        """Pass the boxes that are certain on the map so far to the pilot; return all isolated boxes.

        The pilot records its boxes for the views, which must not show one that later turns out to be a wall.
        """
        certain = isolated_boxes_on_partial_map(self.tracks, grid, self.box_radius)
        positions = np.array([(track.x, track.y) for track in certain]).reshape(-1, 2)
        self._pilot.boxes = KnownBoxes(positions, is_holding=self._pilot.boxes.is_holding)
        return isolated_boxes(self.tracks, grid, self.box_radius)
