"""Connection quality between a robot and its agent: message rates, losses, and latency from scan to velocity."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass, field

import numpy as np

from wherry.ros import messages as ros
from wherry.ros.decoding import MessageError, decode_stamp
from wherry.ros.names import RosNames
from wherry.ros.transports.protocol import Transport
from wherry.space.pose import Floats

MILLISECONDS = 1e3  # per second
MISSING_GAP = 1.5  # periods between two stamps beyond which messages are missing
MIN_MESSAGES = 3  # messages needed to estimate a period
MAX_LATENCY = 1.0  # s from a scan to a velocity that counts as its answer


@dataclass
class TopicLog:
    """Times of the messages of one topic.

    Attributes:
        stamps: Stamps on the robot's clock, s.
        arrivals: Times of arrival on the monotonic clock, s.
    """

    stamps: list[float] = field(default_factory=list)
    arrivals: list[float] = field(default_factory=list)

    @property
    def missing(self) -> int:
        """Number of messages that did not arrive, assuming a constant rate."""
        if len(self.stamps) < MIN_MESSAGES:
            return 0
        gaps = np.diff(self.stamps)
        period = float(np.median(gaps))
        long = gaps[gaps > MISSING_GAP * period]
        return int(np.round(long / period - 1).sum()) if period > 0 else 0


class Monitor:
    """Records when scans, odometry and velocities arrive.

    Args:
        transport: Connection to ROS.
        names: Names of the topics.
    """

    def __init__(self, transport: Transport, names: RosNames) -> None:
        self.scans, self.odometry = TopicLog(), TopicLog()
        self.commands: list[float] = []  # s, monotonic clock
        self._lock = threading.Lock()
        topics = names.topics
        transport.subscribe(topics.scan, lambda message: self._on_measurement(self.scans, message.header))
        transport.subscribe(topics.odom, lambda message: self._on_measurement(self.odometry, message.header))
        transport.subscribe(topics.cmd_vel, self._on_velocity)
        if transport.ros_version == 2:
            transport.subscribe(topics.cmd_vel_stamped, self._on_velocity)

    def _on_measurement(self, log: TopicLog, header: ros.Header) -> None:
        now = time.monotonic()
        try:
            stamp = decode_stamp(header.stamp)
        except MessageError:
            return  # a message without a valid stamp counts as missing
        with self._lock:
            log.stamps.append(stamp)
            log.arrivals.append(now)

    def _on_velocity(self, message: ros.Twist | ros.TwistStamped) -> None:
        del message
        with self._lock:
            self.commands.append(time.monotonic())

    def statistics(self) -> dict[str, float | int | None]:
        """Counts and latencies so far; a scan is answered by the first velocity before the next scan."""
        with self._lock:
            latencies = _latencies(np.array(self.scans.arrivals), np.array(self.commands)) * MILLISECONDS
            return {
                "scans": len(self.scans.arrivals),
                "scans missing": self.scans.missing,
                "odometry": len(self.odometry.stamps),
                "odometry missing": self.odometry.missing,
                "velocities": len(self.commands),
                "scans answered": len(latencies),
                "scan to velocity, median, ms": float(np.median(latencies)) if len(latencies) else None,
                "scan to velocity, 99 %, ms": float(np.quantile(latencies, 0.99)) if len(latencies) else None,
            }


def _latencies(scans: Floats, commands: Floats) -> Floats:
    """Times from each answered scan to its velocity, s.

    Args:
        scans: [N] s, arrival times.
        commands: [M] s, arrival times.
    """
    first = np.searchsorted(commands, scans)
    next_scan = np.append(scans[1:], np.inf)
    has_command = first < len(commands)
    latency = np.full(len(scans), np.inf)
    latency[has_command] = commands[first[has_command]] - scans[has_command]
    return latency[latency < np.minimum(next_scan - scans, MAX_LATENCY)]
