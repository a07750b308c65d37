"""The one who holds the wheel: receives measurements, keeps the pose, and drives turns, lines and paths."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from wherry.navigation.controller import drive_line, follow_path, go_to, safe_velocity, turn_to
from wherry.navigation.path import NO_DISCS
from wherry.realization.tracking import PoseTracker
from wherry.robot import Body, Odometry, Robot, Scan, Velocity
from wherry.space.pose import Floats, Pose
from wherry.trace.records import TIME_TOLERANCE, Narration, Phase, RobotSnapshot, Sink

STANDSTILL = Velocity()
LOOKING_AROUND = Velocity(0.0, 0.6)
LONGEST_SEARCH = 30.0  # s
NO_POINTS = np.empty((0, 2))
SHOWN_EVERY = 0.2  # s between two records of what is seen
STILL = 0.005  # m/s and rad/s; slower than this, the robot stands
FORK_REACH = 1.5  # box radii around base_link within which a reading is of a box in the fork
LONGEST_DRIVE = 60.0  # s after which a drive is given up; where the pose jumps to and fro, a goal may never be reached
PATIENCE = 20  # odometry messages in a row that the laser may hold the robot up before a drive is given up


class Ride(Enum):
    """How a drive ended."""

    ARRIVED = "arrived"
    HELD_UP = "the laser saw something in the way, or it took too long"
    CUT_SHORT = "there was no more reason to go on"
    LOST = "the robot no longer knew where it was"


Steering = Callable[[Pose], Velocity | None]
"""From base_link in the map frame to what to command now, or None on arrival."""

Watcher = Callable[[Scan, Pose], None]
"""Told each scan, with base_link in the map frame when it was taken."""


@dataclass(frozen=True, slots=True)
class Load:
    """What the robot carries and where the boxes are, as far as driving and showing are concerned.

    Attributes:
        boxes: [B, 2] m, map frame, on the floor.
        held: Whether the latch holds a box.
    """

    boxes: Floats
    held: bool


def without_load(scan: Scan, body: Body) -> Scan:
    """The scan without the readings of a box in the fork, which say nothing of where the robot is."""
    in_fork = _of_load(scan, body)
    return replace(scan, ranges=np.where(in_fork, math.nan, scan.ranges)) if in_fork.any() else scan


def shows_load(scan: Scan, body: Body) -> bool:
    """Whether the lidar sees a box in the fork."""
    return bool(_of_load(scan, body).any())


def _of_load(scan: Scan, body: Body) -> NDArray[np.bool_]:
    """[R] which beams end where a box in the fork stands."""
    with np.errstate(invalid="ignore"):
        x, y = body.lidar.x + scan.ranges * np.cos(scan.angles), body.lidar.y + scan.ranges * np.sin(scan.angles)
        in_fork: NDArray[np.bool_] = np.hypot(x, y) < FORK_REACH * body.box_radius
    return in_fork


def _ahead(path: Floats, pose: Pose) -> Floats:
    """[M, 2] m: the path from the place on it that is nearest to the robot on; less than two points are no path."""
    if len(path) < 2:
        return NO_POINTS
    here, begins, legs = np.array([pose.x, pose.y]), path[:-1], np.diff(path, axis=0)
    lengths = np.maximum((legs**2).sum(axis=1), np.finfo(float).tiny)
    share = np.clip(((here - begins) * legs).sum(axis=1) / lengths, 0.0, 1.0)
    places = begins + share[:, None] * legs
    nearest = int(np.argmin(np.hypot(*(places - here).T)))
    return np.vstack([places[nearest], path[nearest + 1 :]])


class Pilot:
    """Drives a robot; nobody else receives from it or commands it.

    Args:
        robot: The robot.
        tracker: Keeps its pose.
        sink: Told what is seen.
    """

    def __init__(self, robot: Robot, tracker: PoseTracker, sink: Sink) -> None:
        self.robot = robot
        self.body = robot.body
        self.tracker = tracker
        self.sink = sink
        self.time = 0.0
        self.load = Load(NO_POINTS, held=False)
        self.watchers: list[Watcher] = []
        self.times_lost = 0
        self._scan: Scan | None = None
        self._odometry: Odometry | None = None
        self._path = NO_POINTS
        self._next_record = 0.0

    @property
    def pose(self) -> Pose:
        """base_link in the map frame now."""
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

    def localize_with(self, tracker: PoseTracker) -> None:
        """Go on with another way of keeping the pose."""
        tracker.hear(self.odometry)
        self.tracker = tracker

    def receive(self) -> None:
        """Wait for the next measurement and take it in."""
        measurement = self.robot.receive()
        self.time = measurement.time
        if isinstance(measurement, Odometry):
            self._odometry = measurement
            self.tracker.hear(measurement)
            return
        self._scan = measurement
        self.tracker.see(without_load(measurement, self.body))
        for watch in self.watchers:
            watch(measurement, self.pose)
        if self.time >= self._next_record:
            self._next_record = self.time + SHOWN_EVERY - TIME_TOLERANCE
            self._show(measurement)

    def look(self, scans: int = 1) -> Scan:
        """Wait for so many new scans and return the last one."""
        for _ in range(scans):
            previous = self._scan
            while self._scan is previous:
                self.receive()
        return self.scan

    def stand(self) -> None:
        """Stop, and wait until the wheels stand still."""
        self.robot.command(STANDSTILL)
        self.receive()
        velocity = self.odometry.velocity
        while abs(velocity.linear) > STILL or abs(velocity.angular) > STILL:
            self.robot.command(STANDSTILL)
            self.receive()
            velocity = self.odometry.velocity

    def turn(self, heading: float) -> None:
        """Turn on the spot to a heading, rad, map frame; the robot is round, so nothing can be in its way."""
        self._drive(lambda pose: turn_to(pose, heading, self.body))

    def follow(self, path: Floats, *, reverse: bool = False, until: Callable[[], bool] = lambda: False) -> Ride:
        """Drive along a path until its end, until the laser sees something in the way, or ``until``.

        Args:
            path: [N, 2] m, map frame.
            reverse: Whether the back leads.
            until: Asked again and again whether to leave off.
        """
        self._path = path
        ride = self._drive(lambda pose: follow_path(pose, path, self.body, reverse=reverse), until=until)
        self._path = NO_POINTS
        return ride

    def approach(self, goal: Pose, *, reverse: bool, ignore: Floats = NO_DISCS, speed: float = math.inf) -> bool:
        """Drive along the straight line through a goal until level with it, or until the laser stops the robot.

        Args:
            goal: Where to stop and which way to look there, map frame.
            reverse: Whether the back leads.
            ignore: [K, 3] m, map frame: x, y, radius of discs that are not in the way: the box to dock on.
            speed: m/s at most.

        Returns:
            Whether the robot got there.
        """
        self._path = np.array([[self.pose.x, self.pose.y], [goal.x, goal.y]])
        ride = self._drive(lambda pose: drive_line(pose, goal, self.body, reverse=reverse, speed=speed), ignore=ignore)
        self._path = NO_POINTS
        return ride is Ride.ARRIVED

    def go_to(self, goal: Pose, *, reverse: bool = False) -> bool:
        """Go straight to a pose that is near, and turn to its heading there."""
        return self._drive(lambda pose: go_to(pose, goal, self.body, reverse=reverse)) is Ride.ARRIVED

    def _drive(self, steer: Steering, *, ignore: Floats = NO_DISCS, until: Callable[[], bool] = lambda: False) -> Ride:
        """Command what the steering says until it has arrived, or the laser or ``until`` stops it."""
        held_up, deadline = 0, self.time + LONGEST_DRIVE
        while held_up < PATIENCE and self.time < deadline:
            if self.tracker.lost:
                self._find_again()
                return Ride.LOST
            if until():
                return Ride.CUT_SHORT  # whatever comes next may go on without a stop
            wanted = steer(self.pose)
            if wanted is None:
                self.stand()
                return Ride.ARRIVED
            velocity = safe_velocity(wanted, self.scan, self.body, ignore=self._in_base_frame(ignore))
            stopped = wanted.linear != 0.0 and abs(velocity.linear) < STILL  # it only ever creeps up to a wall
            held_up = held_up + 1 if stopped else 0
            self.robot.command(velocity)
            self.receive()
        self.stand()
        return Ride.HELD_UP

    def _find_again(self) -> None:
        """Stop, and turn slowly for new views until the robot knows again where it is, or has looked long enough."""
        self.stand()
        self.times_lost += 1
        self.sink(Narration(self.time, Phase.LOCALIZE, "I no longer know where I am: I stop and look around."))
        deadline = self.time + LONGEST_SEARCH
        while self.tracker.lost and self.time < deadline:
            self.robot.command(LOOKING_AROUND)
            self.receive()
        self.stand()
        words = "I do not find out where I am." if self.tracker.lost else "Now I know where I am."
        self.sink(Narration(self.time, Phase.LOCALIZE, words))

    def _in_base_frame(self, discs: Floats) -> Floats:
        """[K, 3] m: discs of the map frame, x, y, radius, as seen from the robot."""
        if not len(discs):
            return discs
        return np.column_stack([self.pose.inverse.transform(discs[:, :2]), discs[:, 2]])

    def _show(self, scan: Scan) -> None:
        lidar = self.pose @ self.body.lidar
        self.sink(
            RobotSnapshot(
                time=self.time,
                pose=self.pose,
                lidar=lidar,
                points=lidar.transform(scan.points()).astype(np.float32),
                particles=self.tracker.corrector.particles.astype(np.float32),
                path=_ahead(self._path, self.pose).astype(np.float32),
                boxes=self.load.boxes.astype(np.float32),
                has_load=self.load.held,
            )
        )
