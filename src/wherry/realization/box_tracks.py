"""Box tracks on the map: data association, position filter, and confirmation by detection ratio."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wherry.realization.box_detection import MAX_DETECTION_RANGE, detect_cylinders
from wherry.robot import Body, Scan
from wherry.space.pose import Floats, Pose

ASSOCIATION_GATE = 0.25  # m, largest distance of a detection from the track that it is assigned to
MIN_DETECTIONS = 5  # detections that confirm a track
MIN_DETECTION_RATIO = 0.5  # smallest ratio of detections to opportunities of a confirmed track
RELIABLE_RANGE = 1.5  # m within which an unoccluded box is always detected
NEAR_RANGE = 1.0  # m within which a detection has at least the weight NEAR_WEIGHT, since errors grow with range
NEAR_WEIGHT = 0.3  # smallest weight of a near detection in the running mean of a track's position


@dataclass(frozen=True, slots=True)
class BoxTrack:
    """A hypothesis of a box at a position on the map.

    Attributes:
        track_id: Number of the track, from 0 in the order of first detection.
        x: Estimated x coordinate of the centre, m, map frame.
        y: Estimated y coordinate of the centre, m, map frame.
        detections: Number of scans in which a cylinder was detected here.
        opportunities: Number of scans in which a box here would have been detected.
    """

    track_id: int
    x: float
    y: float
    detections: int = 1
    opportunities: int = 1

    @property
    def is_confirmed(self) -> bool:
        """Whether the track has enough detections, and a high enough detection ratio, to be a box."""
        return self.detections >= MIN_DETECTIONS and self.detections >= MIN_DETECTION_RATIO * self.opportunities


def update_tracks(tracks: Sequence[BoxTrack], scan: Scan, pose: Pose, body: Body) -> tuple[BoxTrack, ...]:
    """Update the tracks with a scan.

    Each track is assigned the nearest unassigned detection within `ASSOCIATION_GATE`. Without one it counts a missed
    opportunity if a box there would have been detected. Unassigned detections start new tracks.

    Args:
        tracks: The tracks so far.
        scan: The new scan.
        pose: base_link in the map frame at the scan's time.
        body: The robot's shape.

    Returns:
        The updated tracks in the same order, then the new ones.
    """
    lidar = pose @ body.lidar
    detections = lidar.transform(detect_cylinders(scan, body.box_radius))
    unassigned = list(range(len(detections)))
    updated = []
    for track in tracks:
        distances = [math.hypot(detections[i, 0] - track.x, detections[i, 1] - track.y) for i in unassigned]
        if distances and min(distances) < ASSOCIATION_GATE:
            index = unassigned.pop(int(np.argmin(distances)))
            updated.append(_with_detection(track, detections[index], lidar))
        elif _would_be_detected(scan, lidar, track, body.box_radius):
            updated.append(replace(track, opportunities=track.opportunities + 1))
        else:
            updated.append(track)
    next_id = max((track.track_id for track in tracks), default=-1) + 1
    started = [
        BoxTrack(next_id + k, float(detections[i, 0]), float(detections[i, 1])) for k, i in enumerate(unassigned)
    ]
    return (*updated, *started)


def _with_detection(track: BoxTrack, detection: Floats, lidar: Pose) -> BoxTrack:
    """Update the running mean of a track's centre with a detection, [2] m, map frame; a near one weighs more."""
    distance = math.hypot(detection[0] - lidar.x, detection[1] - lidar.y)
    weight = max(1 / (track.detections + 1), NEAR_WEIGHT if distance < NEAR_RANGE else 0.0)
    return replace(
        track,
        x=track.x + weight * (float(detection[0]) - track.x),
        y=track.y + weight * (float(detection[1]) - track.y),
        detections=track.detections + 1,
        opportunities=track.opportunities + 1,
    )


def _would_be_detected(scan: Scan, lidar: Pose, track: BoxTrack, radius: float) -> bool:
    """Whether a box at the track's position would be detected in a scan.

    True if all beams towards the position end well beyond it, or if it is within `RELIABLE_RANGE` and not occluded.
    """
    dx, dy = track.x - lidar.x, track.y - lidar.y
    distance, bearing = math.hypot(dx, dy), math.atan2(dy, dx) - lidar.theta
    if not 3 * radius < distance < MAX_DETECTION_RANGE:
        return False
    if np.all(_ranges_around(scan, bearing, math.asin(radius / distance)) > distance + 2 * radius):
        return True
    around = _ranges_around(scan, bearing, math.asin(1.5 * radius / distance))
    return distance < RELIABLE_RANGE and bool(np.all(around > distance - 1.5 * radius))


def _ranges_around(scan: Scan, bearing: float, half_angle: float) -> Floats:
    """[N] ranges, m, of the beams within half_angle, rad, of a bearing, rad, lidar frame; 0 for NaN."""
    middle = round((bearing - scan.angle_min) / scan.angle_increment)
    half = max(int(half_angle / abs(scan.angle_increment)), 1)
    beams = np.arange(middle - half, middle + half + 1) % len(scan.ranges)
    return np.where(np.isnan(scan.ranges[beams]), 0.0, scan.ranges[beams])
