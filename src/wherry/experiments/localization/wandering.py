"""A simulated robot that wanders about by its scans alone, so that its path does not depend on any estimate."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from wherry.navigation.controller import safe_velocity
from wherry.robot import Odometry, Scan, Velocity
from wherry.simulation import Simulation
from wherry.space.pose import Pose

SPEED = 0.4  # m/s
TURN_RATE = 1.2  # rad/s
TURN_RATE_DEVIATION = 0.3  # rad/s, standard deviation while driving
TURN_PROBABILITY = 0.02  # probability of a turn at a scan although the way is clear
CLEAR_RANGE = 0.45  # m, free range ahead above which the robot drives
HYSTERESIS = 0.15  # m, additional free range that ends a turn
AHEAD = math.radians(35.0)  # rad, half width of the sector ahead


class RandomWalk:
    """A controller that drives ahead while the way is clear, and otherwise turns until it is.

    Args:
        rng: Source of all randomness.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._turn_rate = 0.0

    def velocity(self, scan: Scan) -> Velocity:
        """The next velocity command, by the scan alone."""
        is_ahead = np.abs(scan.angles) < AHEAD
        clearance = float(np.min(np.where(scan.valid & is_ahead, scan.ranges, np.inf), initial=np.inf))
        if clearance > CLEAR_RANGE + (HYSTERESIS if self._turn_rate else 0.0) and self._rng.random() > TURN_PROBABILITY:
            self._turn_rate = 0.0
            return Velocity(SPEED, TURN_RATE_DEVIATION * float(self._rng.standard_normal()))
        self._turn_rate = self._turn_rate or float(self._rng.choice([-TURN_RATE, TURN_RATE]))
        return Velocity(0.0, self._turn_rate)


class WanderingRobot:
    """A robot in a simulation that follows a random walk.

    Args:
        simulation: The world.
        walk: The controller.
    """

    def __init__(self, simulation: Simulation, walk: RandomWalk) -> None:
        self._simulation = simulation
        self._walk = walk
        self._odometry: Odometry | None = None

    def measurements(self, until: float) -> Iterator[tuple[Odometry, Scan, Pose]]:
        """Drive, and yield the odometry, the scan and the true pose of base_link at every scan.

        Args:
            until: Simulated time at which to stop, s.
        """
        robot = self._simulation.robot
        while self._simulation.time < until:
            measurement = robot.receive()
            if isinstance(measurement, Odometry):
                self._odometry = measurement
            elif self._odometry is not None:
                yield self._odometry, measurement, self._simulation.physics.robot_pose
                robot.command(safe_velocity(self._walk.velocity(measurement), measurement, robot.body))
