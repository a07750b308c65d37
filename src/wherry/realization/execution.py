"""Execution of symbolic moves: driving from cell to cell, and docking on boxes (paper, section 7)."""

from __future__ import annotations

import math

import numpy as np

from wherry.navigation.path import NO_DISCS
from wherry.realization.box_detection import detect_cylinders
from wherry.realization.pilot import Pilot
from wherry.space.pose import Floats, Pose

DOCKING_SPEED = 0.3  # m/s
MAX_DETECTION_ATTEMPTS = 8  # scans in which a box to dock on is looked for
DOCKING_GATE = 0.1  # m from the box's expected place to a detection of it
CELL_TOLERANCE = 0.05  # m from a cell's centre within which a blocked robot has arrived
BOX_CLEARANCE = 2.0  # box radii around the box to dock on in which readings are no obstacle


def move_to_cell(pilot: Pilot, home: Floats, goal: Floats, *, docking: bool, fork_full: bool, held: bool) -> bool:
    """Drive straight from one cell's centre to the next one's; if blocked, drive back.

    A robot with an empty fork drives forwards, so that it docks where a box stands. With a box in the fork it drives in
    reverse: the lidar at its back leads, and a box that is not held stays where it is.

    Args:
        pilot: Drives the robot.
        home: [2] where to return to, m, map frame.
        goal: [2] the next cell's centre, or that of the box to dock on there, m, map frame.
        docking: Whether a box stands at the goal.
        fork_full: Whether a box stands in the fork.
        held: Whether the latch holds it.

    Returns:
        Whether the robot arrived.
    """
    times_lost = pilot.times_lost
    heading = math.atan2(goal[1] - pilot.pose.y, goal[0] - pilot.pose.x) + (math.pi if fork_full else 0.0)
    pilot.turn_to(heading)
    docking = docking and _detects_box(pilot, goal)  # anything else at the goal is an obstacle
    has_arrived = pilot.approach(
        Pose(float(goal[0]), float(goal[1]), heading),
        reverse=fork_full,
        ignore=_box_disc(goal, pilot.body.box_radius) if docking else NO_DISCS,
        speed=DOCKING_SPEED if docking else math.inf,
    )
    if has_arrived or math.hypot(goal[0] - pilot.pose.x, goal[1] - pilot.pose.y) < CELL_TOLERANCE:
        return True
    if pilot.times_lost > times_lost:
        return False  # a robot that was lost does not know the way back
    box_waits_at_home = fork_full and not held
    pilot.approach(
        Pose(float(home[0]), float(home[1]), heading),
        reverse=not fork_full,
        ignore=_box_disc(home, pilot.body.box_radius) if box_waits_at_home else NO_DISCS,
        speed=DOCKING_SPEED if box_waits_at_home else math.inf,
    )
    return False


def _detects_box(pilot: Pilot, position: Floats) -> bool:
    """Whether a box is detected at a position, [2] m, map frame, in one of a few scans."""
    for _ in range(MAX_DETECTION_ATTEMPTS):
        lidar = pilot.pose @ pilot.body.lidar
        detections = lidar.transform(detect_cylinders(pilot.wait_for_scan(), pilot.body.box_radius))
        if len(detections) and np.hypot(*(detections - position).T).min() < DOCKING_GATE:
            return True
    return False


def _box_disc(centre: Floats, box_radius: float) -> Floats:
    """[1, 3] x, y, radius, m, of the disc around a box's centre in which readings are no obstacle."""
    return np.array([[centre[0], centre[1], BOX_CLEARANCE * box_radius]])
