"""Worlds for the simulator's tests, and a driver who sees the truth."""

from __future__ import annotations

import math

import numpy as np

from wherry.floorplan.plan import FloorPlan
from wherry.floorplan.world_files import parse_world
from wherry.robot import Odometry, Scan, Velocity
from wherry.simulation import Simulation, build
from wherry.simulation.drive import EncoderErrors
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
    """The hall; keywords replace symbols that stand for themselves, as in ``o=" "``."""
    drawing = HALL[HALL.index("+") :]
    for old, new in changes.items():
        drawing = drawing.replace(old, new)
    return parse_world(HALL[: HALL.index("+")] + drawing, source="hall")


def exact(plan: FloorPlan, offsets: tuple[tuple[float, float], ...] | None = None) -> Simulation:
    """A simulation without noise, its boxes standing in the middles of their cells or so far from them (m)."""
    return build(
        plan,
        np.random.default_rng(0),
        lidar=LidarSpecification(noise=0.0),
        encoders=EncoderErrors(scale=0.0, noise=0.0),
        box_offsets=np.zeros((len(plan.boxes), 2)) if offsets is None else np.array(offsets),
    )


def drive(simulation: Simulation, linear: float, angular: float, seconds: float) -> list[Scan | Odometry]:
    """Drive with one velocity for a while."""
    end = simulation.time + seconds - 1e-9
    measurements = []
    while simulation.time < end:
        simulation.robot.command(Velocity(linear, angular))
        measurements.append(simulation.robot.receive())
    return measurements


def stop(simulation: Simulation) -> None:
    """Come to a stand."""
    drive(simulation, 0.0, 0.0, 1.0)


def drive_to_x(simulation: Simulation, x: float) -> None:
    """Drive along the robot's heading, forwards or backwards, until its x in the world is there; then stand."""
    pose = simulation.referee.pose
    while abs(x - pose.x) > 0.001:
        ahead = (x - pose.x) * math.copysign(1.0, math.cos(pose.theta))
        drive(simulation, max(-0.4, min(0.4, 2.0 * ahead)), 0.0, 0.05)
        pose = simulation.referee.pose
    stop(simulation)


def turn_to(simulation: Simulation, theta: float) -> None:
    """Turn on the spot to a heading in the world; then stand."""
    while abs(error := math.remainder(theta - simulation.referee.pose.theta, math.tau)) > 0.003:
        drive(simulation, 0.0, max(-1.5, min(1.5, 4.0 * error)), 0.05)
    stop(simulation)


def box_in_base(simulation: Simulation, box: int) -> np.ndarray:
    """[2] m: where a box stands as seen from base_link."""
    return simulation.referee.pose.inverse.transform(simulation.physics.box_positions[box : box + 1, :2])[0]
