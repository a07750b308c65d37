"""A simulated robot on a random walk that depends on its scans alone, so that no estimate influences its path."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from wherry.navigation.controller import safe_velocity
from wherry.robot import Odometry, Scan, Velocity
from wherry.simulation import Simulation
from wherry.space.pose import Pose

SPEED = 0.4  # m/s, while driving
TURN_RATE = 1.2  # rad/s, while turning
TURN_RATE_DEVIATION = 0.3  # rad/s, standard deviation of the turn rate while driving
TURN_PROBABILITY = 0.02  # probability per scan of starting a turn although the way is clear
CLEAR_RANGE = 0.45  # m, clearance ahead above which the robot drives
CLEAR_HYSTERESIS = 0.15  # m, additional clearance ahead that ends a turn
AHEAD_HALF_ANGLE = math.radians(35.0)  # rad, half angle of the sector ahead


class RandomWalk:
    """A controller that drives ahead while the way is clear, and otherwise turns until it is.

    Args:
        rng: Source of all randomness.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._turn_rate = 0.0

    def velocity(self, scan: Scan) -> Velocity:
        """The next velocity command after a scan."""
        is_ahead = np.abs(scan.angles) < AHEAD_HALF_ANGLE
        clearance = float(np.min(np.where(scan.valid & is_ahead, scan.ranges, np.inf), initial=np.inf))
        if (
            clearance > CLEAR_RANGE + (CLEAR_HYSTERESIS if self._turn_rate else 0.0)
            and self._rng.random() > TURN_PROBABILITY
        ):
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
