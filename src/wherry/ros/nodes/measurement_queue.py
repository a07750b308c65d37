"""Scans and odometry of a robot, queued from the transport's thread to the agent's."""

from __future__ import annotations

import math
import time
from collections import Counter, deque
from dataclasses import dataclass, replace

from wherry.logs.beam_times import SWEEP_TOLERANCE
from wherry.robot import Odometry, Scan
from wherry.ros import messages as ros
from wherry.ros.decoding import TIMES_IGNORED, decode_laser_scan, decode_odometry
from wherry.ros.names import RosNames
from wherry.ros.nodes.errors import TimeMovedBackwardsError
from wherry.ros.nodes.measurements import MeasurementSequencer, StampValidator
from wherry.ros.nodes.robot_clock import RobotClock
from wherry.ros.nodes.subscriptions import Subscriptions
from wherry.ros.transforms import Mount
from wherry.space.pose import Pose

MAX_STAMP_LAG = 1.0  # s between the newest stamps of scans and odometry; more is a difference of clocks
MAX_QUEUED_SCANS = 10  # scans queued for the agent; with more, only the latest one is kept
SCAN_MAX_AGE = 0.4  # s, of the agent's last scan; with an older one the robot must not drive


@dataclass(frozen=True, slots=True)
class _SweptScan:
    """A scan as the lidar sent it, and the motion of base_link from its first beam to its last one."""

    scan: Scan
    motion: Pose


class MeasurementQueue:
    """Validates scans and odometry, and queues them in the order of their times.

    Call its methods with the lock of ``subscriptions`` held.

    Args:
        subscriptions: Subscriptions of the agent's node.
        names: Names of topics and frames.
        clock: Clock that each measurement advances.

    Attributes:
        mount: The lidar's mount; scans are corrected by it when they are popped.
        remarks: What was corrected in scans, with the numbers of scans.
        odometry: Latest odometry that was popped; before that, the first one received.
        newest_odometry: Latest odometry received, which may not have been popped yet.
        dropped_scans: Number of scans that were dropped because the agent fell behind.
        clock_reset: The error to raise, once the robot's clock was set back; otherwise None.
    """

    def __init__(self, subscriptions: Subscriptions, names: RosNames, clock: RobotClock) -> None:
        topics, self._frames = names.topics, names.frames
        self._scan_topic, self._odometry_topic = topics.scan.name, topics.odom.name
        self._clock = clock
        self._sequencer = MeasurementSequencer()
        self._scan_stamps, self._odometry_stamps = StampValidator(topics.scan.name), StampValidator(topics.odom.name)
        self._queue: deque[Odometry | _SweptScan] = deque()
        self._scan_received_at = math.inf  # s, monotonic clock
        self._scan_queued_at = math.inf  # s, monotonic clock
        self._newest_scan_time = -math.inf  # s, robot's clock
        self._popped_scan_time = -math.inf  # s, robot's clock
        self.mount = Mount()
        self.remarks: Counter[str] = Counter()
        self.odometry: Odometry | None = None
        self.newest_odometry: Odometry | None = None
        self.dropped_scans = 0
        self.clock_reset: TimeMovedBackwardsError | None = None
        subscriptions.add(topics.odom, self._on_odometry)
        subscriptions.add(topics.scan, self._on_scan)

    @property
    def is_empty(self) -> bool:
        """Whether no measurement is queued."""
        return not self._queue

    @property
    def has_received_scan(self) -> bool:
        """Whether a valid scan has been received."""
        return self._scan_received_at < math.inf

    @property
    def seconds_without_scan(self) -> float:
        """Time since the last valid scan was received, s; −inf before the first one."""
        return time.monotonic() - self._scan_received_at

    @property
    def has_queued_scan(self) -> bool:
        """Whether a scan has been queued, with odometry of its time."""
        return self._scan_queued_at < math.inf

    @property
    def seconds_without_queued_scan(self) -> float:
        """Time since a scan was queued with odometry of its time, s; −inf before the first one."""
        return time.monotonic() - self._scan_queued_at

    @property
    def stamp_conflict(self) -> str:
        """The odometry that scans wait for, with the difference of the stamps if it is that of two clocks."""
        missing = f"{self._odometry_topic} at the times of {self._scan_topic}"
        last = self.newest_odometry
        gap = 0.0 if last is None else self._newest_scan_time - last.time
        if abs(gap) <= MAX_STAMP_LAG:
            return missing
        side = "after" if gap > 0.0 else "before"
        return f"{missing}, which another clock stamps {abs(gap):.1f} s {side} odometry"

    @property
    def is_scan_stale(self) -> bool:
        """Whether the agent's last scan is too old for driving: the lidar is silent, or the agent fell behind."""
        age = self._clock.time - self._popped_scan_time
        silence = 0.0 if self._clock.is_simulated else self.seconds_without_scan
        return max(age, silence) > SCAN_MAX_AGE

    def pop(self) -> Scan | Odometry:
        """Remove and return the earliest measurement."""
        self._drop_outdated_scans()
        measurement = self._queue.popleft()
        if isinstance(measurement, Odometry):
            self.odometry = measurement
            return measurement
        self._popped_scan_time = measurement.scan.time
        return self.mount.upright(measurement.scan).deskewed(self.mount.pose, measurement.motion)

    def _drop_outdated_scans(self) -> None:
        scans = [measurement for measurement in self._queue if isinstance(measurement, _SweptScan)]
        if len(scans) > MAX_QUEUED_SCANS:
            self.dropped_scans += len(scans) - 1
            self._queue = deque(item for item in self._queue if isinstance(item, Odometry) or item is scans[-1])

    def _on_odometry(self, message: ros.Odometry) -> None:
        odometry = decode_odometry(message, self._frames.odom, self._frames.base_link)
        if not self._accept(odometry.time, self._odometry_stamps):
            return
        self.newest_odometry = odometry
        if self.odometry is None:
            self.odometry = odometry
        self._clock.advance_to(odometry.time)
        for item in self._sequencer.add_odometry(odometry):
            self._append(item, item.time)

    def _on_scan(self, message: ros.LaserScan) -> None:
        scan = decode_laser_scan(message, self._frames.laser, self._remark)
        if not self._accept(scan.time, self._scan_stamps):
            return
        scan = self._with_possible_times(scan)
        self._newest_scan_time = scan.time
        self._scan_received_at = time.monotonic()
        self._clock.advance_to(scan.time)
        for item in self._sequencer.add_scan(scan):
            self._append(item, scan.time)

    def _with_possible_times(self, scan: Scan) -> Scan:
        """The scan, without the times of its beams if it would take longer than the time since the scan before."""
        longest = (1.0 + SWEEP_TOLERANCE) * (scan.time - self._newest_scan_time)
        if scan.time_increment == 0.0 or scan.duration <= longest:
            return scan
        self._remark(TIMES_IGNORED)
        return replace(scan, time_increment=0.0)

    def _append(self, measurement: Odometry | Scan, began: float) -> None:
        """Queue a measurement; a scan with the robot's motion during its sweep, which began at a time, s."""
        if isinstance(measurement, Odometry):
            self._queue.append(measurement)
            return
        self._scan_queued_at = time.monotonic()
        self._queue.append(_SweptScan(measurement, self._sequencer.motion(began, measurement.duration)))

    def _remark(self, text: str) -> None:
        self.remarks[text] += 1

    def _accept(self, stamp: float, stamps: StampValidator) -> bool:
        try:
            stamps.check(stamp)
        except TimeMovedBackwardsError as error:
            self.clock_reset = error
            return False
        return True
