"""Simulations for the simulator's tests, and drives by the true pose."""

from __future__ import annotations

import math

import numpy as np

from wherry.floorplan.plan import FloorPlan
from wherry.floorplan.world_files import parse_world
from wherry.robot import Odometry, Scan, Velocity
from wherry.simulation import Simulation, build
from wherry.simulation.drive import WheelOdometryErrors
from wherry.simulation.lidar import LidarSpecification

HALL = """\
wherry-world: 1
name: hall

+---+---+---+---+---+---+---+---+
|                            ###|
+   +   +   +   +   +   +   +   +
|     >           o             |
+   +   +   +   +   +   +   +   +
|                               |
+   +   +   +   +   +   +   +   +
| w   w                         |
+---+---+---+---+---+---+---+---+
"""
CELL = 0.6  # m


def hall(**changes: str) -> FloorPlan:
    """The hall; each keyword replaces a symbol of its drawing, such as ``o=" "``."""
    drawing = HALL[HALL.index("+") :]
    for old, new in changes.items():
        drawing = drawing.replace(old, new)
    return parse_world(HALL[: HALL.index("+")] + drawing, source="hall")


def noise_free(plan: FloorPlan, offsets: tuple[tuple[float, float], ...] | None = None) -> Simulation:
    """A simulation without noise, whose boxes have the given offsets, m, from their cells' centres, or none."""
    return build(
        plan,
        np.random.default_rng(0),
        lidar=LidarSpecification(noise=0.0),
        odometry_errors=WheelOdometryErrors(radius_sigma=0.0, distance_sigma=0.0),
        box_offsets=np.zeros((len(plan.boxes), 2)) if offsets is None else np.array(offsets),
    )


def drive(simulation: Simulation, linear: float, angular: float, seconds: float) -> list[Scan | Odometry]:
    """Drive with a constant velocity, m/s and rad/s, for a time, s; return the measurements."""
    end = simulation.time + seconds - 1e-9
    measurements = []
    while simulation.time < end:
        simulation.robot.command(Velocity(linear, angular))
        measurements.append(simulation.robot.receive())
    return measurements


def stop(simulation: Simulation) -> None:
    """Drive with zero velocity until the robot stands still."""
    drive(simulation, 0.0, 0.0, 1.0)


def drive_to_x(simulation: Simulation, x: float) -> None:
    """Drive straight, forwards or backwards, to an x, m, world frame, and stop."""
    pose = simulation.referee.pose
    while abs(x - pose.x) > 0.001:
        ahead = (x - pose.x) * math.copysign(1.0, math.cos(pose.theta))
        drive(simulation, max(-0.4, min(0.4, 2.0 * ahead)), 0.0, 0.05)
        pose = simulation.referee.pose
    stop(simulation)


def turn_to(simulation: Simulation, theta: float) -> None:
    """Turn on the spot to a heading, rad, world frame, and stop."""
    while abs(error := math.remainder(theta - simulation.referee.pose.theta, math.tau)) > 0.003:
        drive(simulation, 0.0, max(-1.5, min(1.5, 4.0 * error)), 0.05)
    stop(simulation)


def box_in_base(simulation: Simulation, box: int) -> np.ndarray:
    """[2] centre of a box, m, base_link frame."""
    return simulation.referee.pose.inverse.transform(simulation.physics.box_positions[box : box + 1, :2])[0]
