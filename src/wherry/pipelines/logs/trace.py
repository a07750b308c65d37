"""Trace records of a recorded log that is mapped or localized."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from wherry.localization.parameters import LOST_PROBABILITY_THRESHOLD
from wherry.logs.carmen import LidarLog
from wherry.mapping.closures import Closure
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry.trace.records import MapUpdate, Narration, Phase, RobotSnapshot, RunStarted, Sink

DRAWN_RADIUS = 0.25  # m, radius of the drawn robot, as a log does not contain the robot's size
OPENINGS = {
    "map": "I make a map of what the log's laser saw.",
    "localize": "I find out where on the map I was.",
}
NO_PARTICLES = np.empty((0, 3))
NO_POINTS = np.empty((0, 2), np.float32)


class LogTrace:
    """Emits the records of a run over a log; their times count from the first scan.

    Args:
        task: "map" or "localize".
        name: Displayed name of the log.
        log: The log.
        sink: Called with every record.
    """

    def __init__(self, task: str, name: str, log: LidarLog, sink: Sink) -> None:
        self._log = log
        self._sink = sink
        self._phase = Phase(task)
        self._is_lost = False
        self._closures_reported = 0
        self._start = log.scans[0].time
        sink(RunStarted(task, name, robot_radius=DRAWN_RADIUS))
        self.say(0, OPENINGS[task])

    def map(self, grid: OccupancyGrid, index: int = 0, *, fraction: float = 1.0) -> None:
        """Emit the map at a scan.

        Args:
            grid: The map.
            index: Index of the scan.
            fraction: Fraction of the log that the map was made from, 0 to 1.
        """
        self._sink(MapUpdate(self._time(index), grid, fraction, 0.0))

    def scan(self, index: int, pose: Pose, particles: NDArray[np.float64] = NO_PARTICLES) -> None:
        """Emit a scan at the estimated pose.

        Args:
            index: Index of the scan.
            pose: Pose of base_link at the scan, map frame.
            particles: [N, 3] x m, y m, θ rad, map frame.
        """
        lidar = pose @ self._log.lidar
        points = lidar.transform(self._log.scans[index].points()).astype(np.float32)
        samples = particles.astype(np.float32)
        self._sink(RobotSnapshot(self._time(index), pose, lidar, points, samples, NO_POINTS, NO_POINTS, has_load=False))

    def loop_closures(self, index: int, candidates: Sequence[Closure]) -> None:
        """Report the numbers of accepted and rejected loop closures up to a scan, if there are new candidates."""
        if len(candidates) == self._closures_reported:
            return
        self._closures_reported = len(candidates)
        accepted = sum(closure.accepted for closure in candidates)
        self.say(index, f"Loop closures so far: {accepted} accepted, {len(candidates) - accepted} rejected.")

    def lost_probability(self, index: int, probability: float) -> None:
        """Report when the robot gets lost and when it is localized again.

        Args:
            index: Index of the scan.
            probability: Probability of being lost, 0 to 1.
        """
        is_lost = probability > LOST_PROBABILITY_THRESHOLD
        if is_lost != self._is_lost:
            self._is_lost = is_lost
            self.say(index, "I no longer know where I am." if is_lost else "Now I know where I am.")

    def say(self, index: int, text: str) -> None:
        """Emit a message at a scan."""
        self._sink(Narration(self._time(index), self._phase, text))

    def _time(self, index: int) -> float:
        """Time of a scan since the first one, s."""
        return self._log.scans[index].time - self._start
