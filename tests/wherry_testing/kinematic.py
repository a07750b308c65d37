"""A robot without physics: it moves exactly as commanded, and its scans are exact."""

from __future__ import annotations

import math

import numpy as np

from wherry.floorplan.plan import Cell, FloorPlan
from wherry.realization.pose_tracker import SinglePoseEstimator
from wherry.robot import Body, Odometry, Scan, Velocity
from wherry.simulation.model import BODY
from wherry.space.pose import IDENTITY, Pose
from wherry_testing.perfect_worlds import MovableLidar, centre, heading_of

ODOMETRY_PERIOD = 0.05  # s; every second odometry is followed by a scan
LATCH_REACH = 0.05  # m from base_link to the centre of a box that the latch can hold


class KinematicRobot:
    """A `Robot` without collisions, which can drive through walls; `nearest_wall` is then less than its radius.

    Args:
        plan: The world with its boxes, which stand in the centres of their cells.
        odom_from_world: The world frame in the odom frame.
    """

    def __init__(self, plan: FloorPlan, odom_from_world: Pose = IDENTITY) -> None:
        self.pose = Pose(*centre(plan, plan.start), heading_of(plan))
        self.boxes = [centre(plan, cell) for cell in plan.boxes]
        self.time = 0.0
        self.nearest_wall = math.inf  # m, smallest distance of base_link from a wall so far
        self._plan, self._lidar, self._odom_from_world = plan, MovableLidar(plan), odom_from_world
        self._velocity, self._held, self._scan_next = Velocity(), -1, False
        self._tick = 0

    @property
    def body(self) -> Body:
        return BODY

    def receive(self) -> Scan | Odometry:
        if self._scan_next:
            self._scan_next = False
            scan = self._lidar.scan(self.pose, np.array(self.boxes).reshape(-1, 2))
            return Scan(self.time, scan.ranges, scan.angle_min, scan.angle_increment, scan.range_min, scan.range_max)
        self._tick += 1
        self.time = self._tick * ODOMETRY_PERIOD
        self._scan_next = self._tick % 2 == 0
        self._move()
        return Odometry(self.time, self._odom_from_world @ self.pose, self._velocity)

    def command(self, velocity: Velocity) -> None:
        self._velocity = velocity

    def close_latch(self) -> bool:
        for number, box in enumerate(self.boxes):
            if self._held < 0 and math.hypot(box[0] - self.pose.x, box[1] - self.pose.y) < LATCH_REACH:
                self._held = number
        return self._held >= 0

    def open_latch(self) -> bool:
        size = self._plan.cell_size
        if self._held >= 0 and Cell(int(self.pose.x // size), int(self.pose.y // size)) in self._plan.warehouse:
            del self.boxes[self._held]
            self._held = -1
        return self._held < 0

    def _move(self) -> None:
        middle = Pose(theta=self._velocity.angular * ODOMETRY_PERIOD / 2)
        step = self._velocity.linear * ODOMETRY_PERIOD
        self.pose = self.pose @ middle @ Pose(step) @ middle
        if self._held >= 0:
            self.boxes[self._held] = np.array([self.pose.x, self.pose.y])
        ends = (self.pose @ BODY.lidar).transform(self._lidar.scan(self.pose).points()) - (self.pose.x, self.pose.y)
        self.nearest_wall = min(self.nearest_wall, float(np.hypot(ends[:, 0], ends[:, 1]).min()))


class OdometryPoseEstimator(SinglePoseEstimator):
    """A `PoseEstimator` that uses odometry alone.

    Args:
        odom_from_map: The map frame in the odom frame.
    """

    def __init__(self, odom_from_map: Pose = IDENTITY) -> None:
        self.updates = 0
        self._map_from_odom = odom_from_map.inverse

    def update(self, odometry: Odometry, scan: Scan) -> Pose:
        self.updates += 1
        return self._map_from_odom @ odometry.pose
