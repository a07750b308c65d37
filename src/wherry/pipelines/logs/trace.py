"""What those who watch are told while a recorded log is mapped, or a robot localized on it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from wherry.logs.carmen import LidarLog
from wherry.mapping.closures import Closure
from wherry.pipelines.logs.localization import LOST
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry.trace.records import MapUpdate, Narration, Phase, RobotSnapshot, RunStarted, Sink

DRAWN_RADIUS = 0.25  # m; a log does not say how large its robot is
BEGINNINGS = {
    "map": "I make a map of what the log's laser saw.",
    "localize": "I find out where on the map I was.",
}
NO_PARTICLES = np.empty((0, 3))
NO_POINTS = np.empty((0, 2), np.float32)


class LogTrace:
    """Tells a sink of a log that is gone through; times count from its first scan.

    Args:
        task: "map" or "localize".
        name: What people call the log.
        log: The log.
        sink: Who is told.
    """

    def __init__(self, task: str, name: str, log: LidarLog, sink: Sink) -> None:
        self._log = log
        self._sink = sink
        self._phase = Phase(task)
        self._lost = False
        self._tried = 0
        self._first = log.scans[0].time
        sink(RunStarted(task, name, robot_radius=DRAWN_RADIUS))
        self.say(0, BEGINNINGS[task])

    def map(self, grid: OccupancyGrid, index: int = 0, *, fraction: float = 1.0) -> None:
        """Tell the map as it is at a scan, and how much of the log it is made of."""
        self._sink(MapUpdate(self._time(index), grid, fraction, 0.0))

    def scan(self, index: int, pose: Pose, particles: NDArray[np.float64] = NO_PARTICLES) -> None:
        """Tell where a scan was taken.

        Args:
            index: Of the scan.
            pose: base_link then, map frame.
            particles: [N, 3] x m, y m, θ rad, map frame.
        """
        lidar = pose @ self._log.lidar
        points = lidar.transform(self._log.scans[index].points()).astype(np.float32)
        cloud = particles.astype(np.float32)
        self._sink(RobotSnapshot(self._time(index), pose, lidar, points, cloud, NO_POINTS, NO_POINTS, has_load=False))

    def closures(self, index: int, tried: Sequence[Closure]) -> None:
        """Say how many loops were closed by a scan, and how many refused, where it is not what was said before."""
        if len(tried) == self._tried:
            return
        self._tried = len(tried)
        accepted = sum(closure.accepted for closure in tried)
        self.say(index, f"Loops so far: {accepted} closed, {len(tried) - accepted} refused.")

    def doubt(self, index: int, lost_probability: float) -> None:
        """Say when the robot gets lost, and when it is found again."""
        lost = lost_probability > LOST
        if lost != self._lost:
            self._lost = lost
            self.say(index, "I no longer know where I am." if lost else "Now I know where I am.")

    def say(self, index: int, text: str) -> None:
        """Say something after a scan."""
        self._sink(Narration(self._time(index), self._phase, text))

    def _time(self, index: int) -> float:
        """S since the first scan."""
        return self._log.scans[index].time - self._first
