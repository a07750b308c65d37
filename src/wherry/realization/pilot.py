"""The pilot: receives measurements, tracks the pose, and executes turns, approaches and paths."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, auto

import numpy as np

from wherry.navigation.controller import drive_line, follow_path, go_to, safe_velocity, turn_to
from wherry.realization.load import mask_load
from wherry.realization.pose_tracker import PoseTracker
from wherry.robot import Odometry, Robot, Scan, Velocity
from wherry.space.occupancy import NO_DISCS
from wherry.space.pose import Floats, Pose
from wherry.trace.records import TIME_TOLERANCE, Narration, Phase, RobotSnapshot, Sink

ZERO_VELOCITY = Velocity()
RECOVERY_VELOCITY = Velocity(0.0, 0.6)  # m/s, rad/s, of the turn on the spot while lost
RECOVERY_TIMEOUT = 30.0  # s, longest turn on the spot while lost
DRIVE_TIMEOUT = 60.0  # s; a goal may never be reached if the pose estimate jumps back and forth
MAX_BLOCKED_STEPS = 20  # consecutive control steps, one per measurement, after which a blocked drive ends
STANDSTILL_SPEED = 0.005  # m/s and rad/s, below which the robot counts as standing still
RECORD_PERIOD = 0.2  # s from one `RobotSnapshot` record to the next
NO_POINTS = np.empty((0, 2))


class DriveStatus(Enum):
    """How a drive ended.

    Attributes:
        ARRIVED: The robot is at the goal.
        BLOCKED: An obstacle in the scan is in the way, or the drive timed out.
        PREEMPTED: The caller ended the drive.
        LOST: The pose became unreliable.
    """

    ARRIVED = auto()
    BLOCKED = auto()
    PREEMPTED = auto()
    LOST = auto()


Controller = Callable[[Pose], Velocity | None]
"""Maps base_link in the map frame to the velocity to command now; None at the goal."""

ScanCallback = Callable[[Scan, Pose], None]
"""Called with each scan and with base_link in the map frame at the scan's time."""


@dataclass(frozen=True, slots=True)
class KnownBoxes:
    """The boxes on the floor and the load, as far as driving and recording depend on them.

    Attributes:
        positions: [B, 2] centres of the boxes on the floor, m, map frame.
        is_holding: Whether the latch holds a box.
    """

    positions: Floats
    is_holding: bool


class Pilot:
    """Drives a robot, receives its measurements and tracks its pose.

    Args:
        robot: The robot; nothing else may command it or receive its measurements.
        tracker: Tracks the pose.
        sink: Called with snapshots of the robot and narration.

    Attributes:
        robot: The robot.
        body: The robot's shape and limits.
        tracker: Tracks the pose.
        sink: Called with snapshots of the robot and narration.
        time: Time of the last measurement, s, robot's clock.
        boxes: The known boxes on the floor, and whether the latch holds one.
        scan_callbacks: Functions called with each scan and the pose at its time.
        times_lost: Number of times that the pose became unreliable.
    """

    def __init__(self, robot: Robot, tracker: PoseTracker, sink: Sink) -> None:
        self.robot = robot
        self.body = robot.body
        self.tracker = tracker
        self.sink = sink
        self.time = 0.0
        self.boxes = KnownBoxes(NO_POINTS, is_holding=False)
        self.scan_callbacks: list[ScanCallback] = []
        self.times_lost = 0
        self._scan: Scan | None = None
        self._odometry: Odometry | None = None
        self._path = NO_POINTS
        self._next_record = 0.0

    @property
    def pose(self) -> Pose:
        """base_link in the map frame at the last measurement's time."""
        return self.tracker.pose

    @property
    def odometry(self) -> Odometry:
        """The last odometry; waits for the first one."""
        while self._odometry is None:
            self.receive()
        return self._odometry

    @property
    def scan(self) -> Scan:
        """The last scan; waits for the first one."""
        while self._scan is None:
            self.receive()
        return self._scan

    def use_tracker(self, tracker: PoseTracker) -> None:
        """Replace the pose tracker; the new one starts at the last odometry."""
        tracker.add_odometry(self.odometry)
        self.tracker = tracker

    def receive(self) -> None:
        """Wait for the next measurement and process it."""
        measurement = self.robot.receive()
        self.time = measurement.time
        if isinstance(measurement, Odometry):
            self._odometry = measurement
            self.tracker.add_odometry(measurement)
            return
        self._scan = measurement
        self.tracker.add_scan(mask_load(measurement, self.body))
        for callback in self.scan_callbacks:
            callback(measurement, self.pose)
        if self.time >= self._next_record:
            self._next_record = self.time + RECORD_PERIOD - TIME_TOLERANCE
            self._record(measurement)

    def wait_for_scan(self, count: int = 1) -> Scan:
        """Wait for a number of new scans and return the last one."""
        for _ in range(count):
            previous = self._scan
            while self._scan is previous:
                self.receive()
        return self.scan

    def stop(self) -> None:
        """Stop, and wait until the wheels stand still."""
        self.robot.command(ZERO_VELOCITY)
        self.receive()
        velocity = self.odometry.velocity
        while abs(velocity.linear) > STANDSTILL_SPEED or abs(velocity.angular) > STANDSTILL_SPEED:
            self.robot.command(ZERO_VELOCITY)
            self.receive()
            velocity = self.odometry.velocity

    def turn_to(self, heading: float) -> None:
        """Turn on the spot to a heading, rad, map frame; a round footprint cannot collide during a turn."""
        self._drive(lambda pose: turn_to(pose, heading, self.body))

    def follow(
        self, path: Floats, *, reverse: bool = False, is_preempted: Callable[[], bool] = lambda: False
    ) -> DriveStatus:
        """Follow a path until its end, an obstacle, or preemption.

        Args:
            path: [N, 2] waypoints, m, map frame.
            reverse: Whether to drive backwards.
            is_preempted: Called before each command; the drive ends when it returns True.
        """
        self._path = path
        status = self._drive(
            lambda pose: follow_path(pose, path, self.body, reverse=reverse), is_preempted=is_preempted
        )
        self._path = NO_POINTS
        return status

    def approach(self, goal: Pose, *, reverse: bool, ignore: Floats = NO_DISCS, speed: float = math.inf) -> bool:
        """Drive along the line through a goal until level with it, or until the robot is blocked.

        Args:
            goal: Where to stop, and the heading there, map frame.
            reverse: Whether to drive backwards.
            ignore: [K, 3] x, y, radius, m, map frame, of discs in which readings are ignored, such as the box to dock
                on.
            speed: Largest speed, m/s.

        Returns:
            Whether the robot arrived.
        """
        self._path = np.array([[self.pose.x, self.pose.y], [goal.x, goal.y]])
        status = self._drive(
            lambda pose: drive_line(pose, goal, self.body, reverse=reverse, speed=speed), ignore=ignore
        )
        self._path = NO_POINTS
        return status is DriveStatus.ARRIVED

    def go_to(self, goal: Pose, *, reverse: bool = False) -> bool:
        """Drive straight to a near pose, turn to its heading there, and return whether the robot arrived."""
        return self._drive(lambda pose: go_to(pose, goal, self.body, reverse=reverse)) is DriveStatus.ARRIVED

    def _drive(
        self, controller: Controller, *, ignore: Floats = NO_DISCS, is_preempted: Callable[[], bool] = lambda: False
    ) -> DriveStatus:
        """Command the controller's velocity, limited by obstacles in the scan, until the drive ends."""
        blocked, deadline = 0, self.time + DRIVE_TIMEOUT
        while blocked < MAX_BLOCKED_STEPS and self.time < deadline:
            if self.tracker.is_lost:
                self._recover()
                return DriveStatus.LOST
            if is_preempted():
                return DriveStatus.PREEMPTED  # without a stop, since the caller continues with another drive
            desired = controller(self.pose)
            if desired is None:
                self.stop()
                return DriveStatus.ARRIVED
            velocity = safe_velocity(desired, self.scan, self.body, ignore=self._in_base_frame(ignore))
            is_blocked = desired.linear != 0.0 and abs(velocity.linear) < STANDSTILL_SPEED
            blocked = blocked + 1 if is_blocked else 0
            self.robot.command(velocity)
            self.receive()
        self.stop()
        return DriveStatus.BLOCKED

    def _recover(self) -> None:
        """Stop, and turn on the spot until the pose is reliable again or the recovery times out."""
        self.stop()
        self.times_lost += 1
        self.sink(
            Narration(self.time, Phase.LOCALIZE, "I am lost: I stop and turn on the spot until I am localized again.")
        )
        deadline = self.time + RECOVERY_TIMEOUT
        while self.tracker.is_lost and self.time < deadline:
            self.robot.command(RECOVERY_VELOCITY)
            self.receive()
        self.stop()
        text = "I could not localize myself." if self.tracker.is_lost else "I am localized again."
        self.sink(Narration(self.time, Phase.LOCALIZE, text))

    def _in_base_frame(self, discs: Floats) -> Floats:
        """[K, 3] x, y, radius, m: discs transformed from the map frame to the base_link frame."""
        if not len(discs):
            return discs
        return np.column_stack([self.pose.inverse.transform(discs[:, :2]), discs[:, 2]])

    def _record(self, scan: Scan) -> None:
        """Record a snapshot of scan, pose, particles, path and boxes."""
        lidar = self.pose @ self.body.lidar
        self.sink(
            RobotSnapshot(
                time=self.time,
                pose=self.pose,
                lidar=lidar,
                points=lidar.transform(scan.points()).astype(np.float32),
                particles=self.tracker.estimator.particles.astype(np.float32),
                path=_remaining_path(self._path, self.pose).astype(np.float32),
                boxes=self.boxes.positions.astype(np.float32),
                has_load=self.boxes.is_holding,
            )
        )


def _remaining_path(path: Floats, pose: Pose) -> Floats:
    """[M, 2] the part of a path after its point nearest to the robot, m, map frame; empty for fewer than two points."""
    if len(path) < 2:
        return NO_POINTS
    position, starts, segments = np.array([pose.x, pose.y]), path[:-1], np.diff(path, axis=0)
    squared_lengths = np.maximum((segments**2).sum(axis=1), np.finfo(float).tiny)
    fractions = np.clip(((position - starts) * segments).sum(axis=1) / squared_lengths, 0.0, 1.0)
    projections = starts + fractions[:, None] * segments
    nearest = int(np.argmin(np.hypot(*(projections - position).T)))
    return np.vstack([projections[nearest], path[nearest + 1 :]])
