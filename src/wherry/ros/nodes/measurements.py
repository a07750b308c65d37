"""Odometry and scans that arrive on two topics, put into one row: times never decrease, and each scan has odometry.

Real robots' sensors do not share their instants. A scan therefore goes on with odometry interpolated to its time. One
that comes when later odometry has already gone on gets the last time, with the pose that belongs to it: what moved
between two scans stays right, and only its time is late by what the lidar's driver took.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

from wherry.robot import Odometry, Scan
from wherry.ros.decoding import MessageError
from wherry.space.pose import Pose, wrap

SAME_INSTANT = 1e-6  # s
REMEMBERED = 2.0  # s of odometry
MOST_WAITING = 10  # scans that wait for odometry
LONGEST_GAP = 1.0  # s, after which a message has to be confirmed by others
CONFIRMATIONS = 5  # messages in a row that must agree that time has jumped


class TimeWentBackError(Exception):
    """A robot's clock was set back, as when it is started anew; what is known of the past no longer holds."""


class StampGuard:
    """Lets a topic's stamps through as long as they go on; a single one from far off is refused.

    Args:
        topic: For the error's text.
    """

    def __init__(self, topic: str) -> None:
        self._topic = topic
        self._last = -math.inf
        self._strange: list[float] = []

    def check(self, stamp: float) -> None:
        """Accept a stamp, s.

        Raises:
            MessageError: It is before the last one, or far after it, and not confirmed by others yet.
            TimeWentBackError: Several in a row agree that it is earlier now.
        """
        if self._last == -math.inf or 0.0 <= stamp - self._last <= LONGEST_GAP:
            self._last = stamp
            self._strange.clear()
            return
        if self._strange and not 0.0 <= stamp - self._strange[-1] <= LONGEST_GAP:
            self._strange.clear()
        self._strange.append(stamp)
        if len(self._strange) < CONFIRMATIONS:
            raise MessageError(f"has the stamp {stamp:.3f} s after {self._last:.3f} s")
        if stamp < self._last:
            raise TimeWentBackError(f"{self._topic}: time went back from {self._last:.3f} s to {stamp:.3f} s")
        self._last = stamp
        self._strange.clear()


class Row:
    """Puts measurements of two sources into one row."""

    def __init__(self) -> None:
        self._past: deque[Odometry] = deque()
        self._waiting: deque[Scan] = deque(maxlen=MOST_WAITING)

    def hear_odometry(self, odometry: Odometry) -> tuple[Odometry | Scan, ...]:
        """Take in odometry, later than any before; returns what may go on now."""
        row: list[Odometry | Scan] = []
        while self._waiting and self._waiting[0].time < odometry.time - SAME_INSTANT:
            scan = self._waiting.popleft()
            if self._past:
                row += [_between(self._past[-1], odometry, scan.time), scan]
        row.append(odometry)
        while self._waiting and self._waiting[0].time < odometry.time + SAME_INSTANT:
            row.append(self._waiting.popleft())
        self._past.append(odometry)
        while self._past[0].time < odometry.time - REMEMBERED:
            self._past.popleft()
        return tuple(row)

    def hear_scan(self, scan: Scan) -> tuple[Odometry | Scan, ...]:
        """Take in a scan, later than any before; returns what may go on now.

        Raises:
            MessageError: There is no odometry that is old enough.
        """
        if not self._past or scan.time > self._past[-1].time + SAME_INSTANT:
            self._waiting.append(scan)
            return ()
        last = self._past[-1]
        if abs(scan.time - last.time) <= SAME_INSTANT:
            return (scan,)
        if scan.time < self._past[0].time:
            raise MessageError(f"is of {scan.time:.3f} s, and odometry begins at {self._past[0].time:.3f} s")
        after = next(i for i, odometry in enumerate(self._past) if odometry.time >= scan.time)
        then = self._past[0] if after == 0 else _between(self._past[after - 1], self._past[after], scan.time)
        return replace(then, time=last.time), replace(scan, time=last.time), last


def _between(first: Odometry, second: Odometry, time: float) -> Odometry:
    """Odometry at an instant between two."""
    share = (time - first.time) / (second.time - first.time)
    a, b = first.pose, second.pose
    turned = wrap(b.theta - a.theta)
    pose = Pose(a.x + share * (b.x - a.x), a.y + share * (b.y - a.y), wrap(a.theta + share * turned))
    return Odometry(time, pose, first.velocity if share < 0.5 else second.velocity)
