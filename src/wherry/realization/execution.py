"""Execution of symbolic moves: driving from cell to cell and docking on boxes (paper, section 7)."""

from __future__ import annotations

import math

import numpy as np

from wherry.realization.box_detection import detect_cylinders
from wherry.realization.pilot import Pilot
from wherry.space.occupancy import NO_DISCS
from wherry.space.pose import Floats, Pose

DOCKING_SPEED = 0.3  # m/s, largest speed with a box ahead
MAX_DETECTION_ATTEMPTS = 8  # scans in which the box to dock on must be detected once
DOCKING_GATE = 0.1  # m, largest distance of a detection from the box's expected position
CELL_TOLERANCE = 0.05  # m from the goal within which a blocked robot counts as arrived
BOX_CLEARANCE = 2.0  # radius of the disc around the box to dock on in which readings are ignored ÷ box radius


def move_to_cell(
    pilot: Pilot, start: Floats, goal: Floats, *, is_docking: bool, is_fork_full: bool, is_holding: bool
) -> bool:
    """Drive straight from a cell's centre to the next one's; drive back if blocked.

    A robot with an empty fork drives forwards, so that it can dock on a box. With a box in the fork it drives in
    reverse, with the lidar in front; a box that the latch does not hold stays behind.

    Args:
        pilot: Drives the robot.
        start: [2] centre of the present cell, or of the box docked on there, to return to, m, map frame.
        goal: [2] centre of the next cell, or of the box to dock on there, m, map frame.
        is_docking: Whether there is a box to dock on at the goal.
        is_fork_full: Whether a box stands in the fork.
        is_holding: Whether the latch holds a box.

    Returns:
        Whether the robot arrived at the goal.
    """
    times_lost = pilot.times_lost
    heading = math.atan2(goal[1] - pilot.pose.y, goal[0] - pilot.pose.x) + (math.pi if is_fork_full else 0.0)
    pilot.turn_to(heading)
    is_docking = is_docking and _detects_box(pilot, goal)  # without a detection, readings at the goal are obstacles
    has_arrived = pilot.approach(
        Pose(float(goal[0]), float(goal[1]), heading),
        reverse=is_fork_full,
        ignore=_box_disc(goal, pilot.body.box_radius) if is_docking else NO_DISCS,
        speed=DOCKING_SPEED if is_docking else math.inf,
    )
    if has_arrived or math.hypot(goal[0] - pilot.pose.x, goal[1] - pilot.pose.y) < CELL_TOLERANCE:
        return True
    if pilot.times_lost > times_lost:
        return False  # the start may be far from the pose at which the robot was localized again
    returns_to_box = is_fork_full and not is_holding
    pilot.approach(
        Pose(float(start[0]), float(start[1]), heading),
        reverse=not is_fork_full,
        ignore=_box_disc(start, pilot.body.box_radius) if returns_to_box else NO_DISCS,
        speed=DOCKING_SPEED if returns_to_box else math.inf,
    )
    return False


def _detects_box(pilot: Pilot, position: Floats) -> bool:
    """Whether a box is detected at a position, [2] m, map frame, in one of the next `MAX_DETECTION_ATTEMPTS` scans."""
    for _ in range(MAX_DETECTION_ATTEMPTS):
        lidar = pilot.pose @ pilot.body.lidar
        detections = lidar.transform(detect_cylinders(pilot.wait_for_scan(), pilot.body.box_radius))
        if len(detections) and np.hypot(*(detections - position).T).min() < DOCKING_GATE:
            return True
    return False


def _box_disc(centre: Floats, box_radius: float) -> Floats:
    """[1, 3] x, y, radius, m, map frame, of the disc around a box in which readings are ignored."""
    return np.array([[centre[0], centre[1], BOX_CLEARANCE * box_radius]])
