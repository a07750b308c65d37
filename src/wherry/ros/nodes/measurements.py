"""Merges odometry and scans of two topics into one sequence with nondecreasing times and odometry for each scan.

The sensors of a robot are not synchronized. A scan is therefore preceded by odometry interpolated to its time. If later
odometry was returned already, the scan gets the time of that odometry, and the pose interpolated to its own time: the
motion between scans stays exact, and only the time is late, by the latency of the lidar's driver.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

from wherry.robot import Odometry, Scan
from wherry.ros.decoding import MessageError
from wherry.ros.nodes.errors import TimeMovedBackwardsError
from wherry.space.pose import Pose, wrap

SAME_INSTANT_TOLERANCE = 1e-6  # s
ODOMETRY_BUFFER_SECONDS = 2.0  # s of odometry kept for interpolation
MIN_COVERED_SHARE = 0.5  # share of a sweep that the poses of odometry must cover to tell the motion during it
MAX_WAITING_SCANS = 10  # scans buffered until odometry of their time is received
MAX_STAMP_GAP = 1.0  # s between stamps of a topic; a larger gap needs confirmation
MIN_CONFIRMATIONS = 5  # consecutive stamps that must agree that time has jumped


class StampValidator:
    """Rejects isolated outliers among the stamps of a topic.

    Args:
        topic: Name of the topic, for error messages.
    """

    def __init__(self, topic: str) -> None:
        self._topic = topic
        self._last = -math.inf
        self._outliers: list[float] = []

    def check(self, stamp: float) -> None:
        """Accept a stamp, s.

        Raises:
            MessageError: It is earlier than the last one or more than `MAX_STAMP_GAP` later, and not confirmed yet.
            TimeMovedBackwardsError: `MIN_CONFIRMATIONS` consecutive stamps agree on an earlier time.
        """
        if self._last == -math.inf or 0.0 <= stamp - self._last <= MAX_STAMP_GAP:
            self._accept(stamp)
            return
        if self._outliers and not 0.0 <= stamp - self._outliers[-1] <= MAX_STAMP_GAP:
            self._outliers.clear()
        self._outliers.append(stamp)
        if len(self._outliers) < MIN_CONFIRMATIONS:
            raise MessageError(f"has the stamp {stamp:.3f} s after {self._last:.3f} s")
        if stamp < self._last:
            raise TimeMovedBackwardsError(
                f"{self._topic}: time moved backwards from {self._last:.3f} s to {stamp:.3f} s"
            )
        self._accept(stamp)

    def _accept(self, stamp: float) -> None:
        self._last = stamp
        self._outliers.clear()


class MeasurementSequencer:
    """Merges odometry and scans into one sequence."""

    def __init__(self) -> None:
        self._odometry: deque[Odometry] = deque()
        self._waiting: deque[Scan] = deque(maxlen=MAX_WAITING_SCANS)

    def add_odometry(self, odometry: Odometry) -> tuple[Odometry | Scan, ...]:
        """Add odometry, later than any before; returns the measurements that are complete now."""
        complete: list[Odometry | Scan] = []
        while self._waiting and self._waiting[0].time < odometry.time - SAME_INSTANT_TOLERANCE:
            scan = self._waiting.popleft()
            if self._odometry:
                complete += [_interpolated(self._odometry[-1], odometry, scan.time), scan]
        complete.append(odometry)
        while self._waiting and self._waiting[0].time < odometry.time + SAME_INSTANT_TOLERANCE:
            complete.append(self._waiting.popleft())
        self._odometry.append(odometry)
        while self._odometry[0].time < odometry.time - ODOMETRY_BUFFER_SECONDS:
            self._odometry.popleft()
        return tuple(complete)

    def add_scan(self, scan: Scan) -> tuple[Odometry | Scan, ...]:
        """Add a scan, later than any before; returns the measurements that are complete now.

        Raises:
            MessageError: The scan is older than all buffered odometry.
        """
        if not self._odometry or scan.time > self._odometry[-1].time + SAME_INSTANT_TOLERANCE:
            self._waiting.append(scan)
            return ()
        last = self._odometry[-1]
        if abs(scan.time - last.time) <= SAME_INSTANT_TOLERANCE:
            return (scan,)
        if scan.time < self._odometry[0].time:
            raise MessageError(f"is of {scan.time:.3f} s, and odometry begins at {self._odometry[0].time:.3f} s")
        return replace(self._odometry_at(scan.time), time=last.time), replace(scan, time=last.time), last

    def motion(self, began: float, duration: float) -> Pose:
        """Motion of base_link during a sweep: by the poses of odometry, or by its velocity if they do not cover it.

        Args:
            began: Time of the first beam, s.
            duration: Time from the first beam to the last one, s.
        """
        if duration == 0.0 or not self._odometry:
            return Pose()
        end = min(began + duration, self._odometry[-1].time)
        start = max(end - duration, self._odometry[0].time)
        if end - start < MIN_COVERED_SHARE * duration:
            velocity = self._odometry[-1].velocity
            return Pose(velocity.linear * duration, 0.0, velocity.angular * duration)
        moved = self._odometry_at(end).pose.relative_to(self._odometry_at(start).pose)
        ratio = duration / (end - start)
        return Pose(ratio * moved.x, ratio * moved.y, ratio * moved.theta)

    def _odometry_at(self, time: float) -> Odometry:
        """Buffered odometry, interpolated to a time, s, within the buffer."""
        after = next(i for i, odometry in enumerate(self._odometry) if odometry.time >= time)
        if after == 0:
            return self._odometry[0]
        return _interpolated(self._odometry[after - 1], self._odometry[after], time)


def _interpolated(first: Odometry, second: Odometry, time: float) -> Odometry:
    """Odometry at a time between two readings, s."""
    fraction = (time - first.time) / (second.time - first.time)
    a, b = first.pose, second.pose
    rotation = wrap(b.theta - a.theta)
    pose = Pose(a.x + fraction * (b.x - a.x), a.y + fraction * (b.y - a.y), wrap(a.theta + fraction * rotation))
    return Odometry(time, pose, first.velocity if fraction < 0.5 else second.velocity)
