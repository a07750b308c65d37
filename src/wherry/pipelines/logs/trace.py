"""Trace records of a recorded log that is mapped or localized."""

from __future__ import annotations

from collections.abc import Sequence
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from wherry.localization.parameters import LOST_PROBABILITY_THRESHOLD
from wherry.logs.lidar_log import LidarLog
from wherry.mapping.loop_closure import LoopClosure
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry.trace.records import MapUpdate, Narration, Phase, RobotSnapshot, RunStarted, Sink

DRAWN_RADIUS = 0.25  # m, radius of the drawn robot, since a log does not contain the robot's size
OPENINGS = MappingProxyType(
    {
        Phase.MAP: "I build a map from the log's laser scans.",
        Phase.LOCALIZE: "I estimate my trajectory on the map.",
    }
)
NO_PARTICLES = np.empty((0, 3))
NO_POINTS = np.empty((0, 2), np.float32)


class LogTrace:
    """Emits the trace records of a run over a log, with times relative to the first scan.

    Args:
        phase: What is done with the log, `Phase.MAP` or `Phase.LOCALIZE`.
        name: Displayed name of the log.
        log: The log.
        sink: Called with every record.
    """

    def __init__(self, phase: Phase, name: str, log: LidarLog, sink: Sink) -> None:
        self._log = log
        self._sink = sink
        self._phase = phase
        self._is_lost = False
        self._closures_reported = 0
        self._start = log.scans[0].time
        sink(RunStarted(phase.value, name, robot_radius=DRAWN_RADIUS))
        self.say(0, OPENINGS[phase])

    def map(self, grid: OccupancyGrid, index: int = 0, *, fraction: float = 1.0) -> None:
        """Emit the map at a scan.

        Args:
            grid: The map.
            index: Index of the scan.
            fraction: Fraction of the log that has been mapped, 0 to 1.
        """
        self._sink(MapUpdate(self._time(index), grid, fraction, 0.0))

    def scan(self, index: int, pose: Pose, particles: NDArray[np.float64] = NO_PARTICLES) -> None:
        """Emit a scan at the estimated pose.

        Args:
            index: Index of the scan.
            pose: Pose of base_link at the scan, map frame.
            particles: [N, 3] m, m, rad, map frame; none by default.
        """
        lidar = pose @ self._log.lidar
        points = lidar.transform(self._log.deskewed(index).points()).astype(np.float32)
        samples = particles.astype(np.float32)
        self._sink(RobotSnapshot(self._time(index), pose, lidar, points, samples, NO_POINTS, NO_POINTS, has_load=False))

    def loop_closures(self, index: int, candidates: Sequence[LoopClosure]) -> None:
        """Narrate the numbers of accepted and rejected loop closures up to a scan, if there are new candidates."""
        if len(candidates) == self._closures_reported:
            return
        self._closures_reported = len(candidates)
        accepted = sum(closure.is_accepted for closure in candidates)
        self.say(index, f"Loop closures so far: {accepted} accepted, {len(candidates) - accepted} rejected.")

    def lost_probability(self, index: int, probability: float) -> None:
        """Narrate when the robot gets lost and when it is localized again.

        Args:
            index: Index of the scan.
            probability: Probability of being lost, 0 to 1.
        """
        is_lost = probability > LOST_PROBABILITY_THRESHOLD
        if is_lost != self._is_lost:
            self._is_lost = is_lost
            self.say(index, "I am lost." if is_lost else "I am localized again.")

    def say(self, index: int, text: str) -> None:
        """Emit a narration at a scan."""
        self._sink(Narration(self._time(index), self._phase, text))

    def _time(self, index: int) -> float:
        """Time of a scan since the first one, s."""
        return self._log.scans[index].time - self._start
