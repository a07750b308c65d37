"""How well a robot and its agent are connected, as a third party hears it: rates, losses, and the time to an answer."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass, field

import numpy as np

from wherry.ros import messages as ros
from wherry.ros.decoding import MessageError, decode_stamp
from wherry.ros.names import RosNames
from wherry.ros.transports.protocol import Transport

MILLISECONDS = 1e3
TOO_LONG = 1.5  # periods between two stamps, from which on a message is missing
FEWEST = 3  # messages from which a period can be told


@dataclass
class Stream:
    """The messages of a topic.

    Attributes:
        stamps: s, the robot's clock.
        arrivals: s, monotonic clock.
    """

    stamps: list[float] = field(default_factory=list)
    arrivals: list[float] = field(default_factory=list)

    @property
    def missing(self) -> int:
        """How many messages did not arrive, if they are sent at a steady rate."""
        if len(self.stamps) < FEWEST:
            return 0
        gaps = np.diff(self.stamps)
        period = float(np.median(gaps))
        long = gaps[gaps > TOO_LONG * period]
        return int(np.round(long / period - 1).sum()) if period > 0 else 0


class Monitor:
    """Listens to a robot and its agent.

    Args:
        transport: ROS.
        names: What everything is called.
    """

    def __init__(self, transport: Transport, names: RosNames) -> None:
        self.scans, self.odometry = Stream(), Stream()
        self.commands: list[float] = []  # s, monotonic clock
        self._lock = threading.Lock()
        topics = names.topics
        transport.subscribe(topics.scan, lambda message: self._hear(self.scans, message.header))
        transport.subscribe(topics.odom, lambda message: self._hear(self.odometry, message.header))
        transport.subscribe(topics.cmd_vel, self._hear_command)
        if transport.ros_version == 2:
            transport.subscribe(topics.cmd_vel_stamped, self._hear_command)

    def _hear(self, stream: Stream, header: ros.Header) -> None:
        now = time.monotonic()
        try:
            stamp = decode_stamp(header.stamp)
        except MessageError:
            return  # it shows as missing
        with self._lock:
            stream.stamps.append(stamp)
            stream.arrivals.append(now)

    def _hear_command(self, message: ros.Twist | ros.TwistStamped) -> None:
        del message
        with self._lock:
            self.commands.append(time.monotonic())

    def figures(self) -> dict[str, float | int | None]:
        """What was heard; a scan is answered by the first velocity before the next scan."""
        with self._lock:
            scans, commands = np.array(self.scans.arrivals), np.array(self.commands)
            answers = np.searchsorted(commands, scans)
            following = np.append(scans[1:], np.inf)
            has_answer = answers < len(commands)
            latency = np.full(len(scans), np.inf)
            latency[has_answer] = commands[answers[has_answer]] - scans[has_answer]
            answered = latency[latency < np.minimum(following - scans, 1.0)] * MILLISECONDS
            return {
                "scans": len(scans),
                "scans missing": self.scans.missing,
                "odometry": len(self.odometry.stamps),
                "odometry missing": self.odometry.missing,
                "velocities": len(commands),
                "scans answered": len(answered),
                "scan to velocity, median, ms": float(np.median(answered)) if len(answered) else None,
                "scan to velocity, 99 %, ms": float(np.quantile(answered, 0.99)) if len(answered) else None,
            }
