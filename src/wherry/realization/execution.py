"""From an Action to motion: moves from cell to cell, and docking on boxes (paper, section 7)."""

from __future__ import annotations

import math

import numpy as np

from wherry.navigation.path import NO_DISCS
from wherry.realization.boxes import round_things
from wherry.realization.pilot import Pilot
from wherry.space.pose import Floats, Pose

DOCKING_SPEED = 0.3  # m/s
LOOKS = 8  # scans after which a box that is not seen is not there
SAME_PLACE = 0.1  # m
NEAR_ENOUGH = 0.05  # m from the middle of a cell


def move(pilot: Pilot, home: Floats, goal: Floats, *, docking: bool, fork_full: bool, held: bool) -> bool:
    """Drive straight from the middle of a cell to the middle of the next; if the laser stops the robot, drive back.

    A robot with an empty fork drives forwards, so that it docks where a box stands. With a box in the fork it drives in
    reverse: the lidar at its back leads, and a box that is not held stays where it is.

    Args:
        pilot: Drives.
        home: [2] m, map frame: where to come back to.
        goal: [2] m, map frame: the next cell's middle, or that of the box on which to dock there.
        docking: Whether a box stands at the goal.
        fork_full: Whether a box stands in the fork.
        held: Whether the latch holds it.

    Returns:
        Whether the robot got there.
    """
    times_lost = pilot.times_lost
    heading = math.atan2(goal[1] - pilot.pose.y, goal[0] - pilot.pose.x) + (math.pi if fork_full else 0.0)
    pilot.turn(heading)
    docking = docking and _shows_box(pilot, goal)  # else whatever stands there is in the way
    if pilot.approach(
        Pose(float(goal[0]), float(goal[1]), heading),
        reverse=fork_full,
        ignore=_disc(goal, pilot.body.box_radius) if docking else NO_DISCS,
        speed=DOCKING_SPEED if docking else math.inf,
    ):
        return True
    if math.hypot(goal[0] - pilot.pose.x, goal[1] - pilot.pose.y) < NEAR_ENOUGH:
        return True  # between close walls the laser may stop it just before the middle of the cell
    if pilot.times_lost > times_lost:
        return False  # the way back is not known
    # Back the way it came; a box that it had in its fork and did not hold stands there still.
    waiting = fork_full and not held
    pilot.approach(
        Pose(float(home[0]), float(home[1]), heading),
        reverse=not fork_full,
        ignore=_disc(home, pilot.body.box_radius) if waiting else NO_DISCS,
        speed=DOCKING_SPEED if waiting else math.inf,
    )
    return False


def _shows_box(pilot: Pilot, place: Floats) -> bool:
    """Whether one of a few scans shows a round thing at a place, [2] m, map frame."""
    for _ in range(LOOKS):
        lidar = pilot.pose @ pilot.body.lidar
        found = lidar.transform(round_things(pilot.look(), pilot.body.box_radius))
        if len(found) and np.hypot(*(found - place).T).min() < SAME_PLACE:
            return True
    return False


def _disc(middle: Floats, box_radius: float) -> Floats:
    """[1, 3] m: x, y and radius within which what the laser sees is the box, and not in the way."""
    return np.array([[middle[0], middle[1], 2.0 * box_radius]])
