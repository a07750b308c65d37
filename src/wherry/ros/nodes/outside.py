"""An outside stack's map and pose in place of our own: gmapping, slam_toolbox, map_server, amcl, nav2."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from wherry.errors import InputError
from wherry.robot import Odometry, Scan
from wherry.ros import messages as ros
from wherry.ros.decoding import MessageError, decode_occupancy_grid, decode_pose_estimate, transforms_between
from wherry.ros.diagnostics import RejectedMessages
from wherry.ros.names import RosNames
from wherry.ros.transports.protocol import Transport
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose

POLL = 0.05  # s
MARGIN = 1.0  # m of what nobody knows around a map, for exploration to look into
NEAR = 0.3  # m and rad; a pose that is farther from what was told has not come of it
OLDEST = 2.0  # s; a pose that nobody has confirmed for so long is not relied upon


class OutsideMap:
    """The last usable message on ``/map``.

    Args:
        transport: ROS.
        names: What everything is called.
    """

    def __init__(self, transport: Transport, names: RosNames) -> None:
        self.refusals = RejectedMessages()
        self._topic, self._frame = names.topics.map, names.frames.map
        self._news = threading.Condition()
        self._grid: OccupancyGrid | None = None
        transport.subscribe(self._topic, self._hear)

    def wait(self, patience: float) -> None:
        """Wait for a map.

        Raises:
            InputError: None came within ``patience`` seconds; the error says what was wrong with those refused.
        """
        _wait(self._news, lambda: self._grid is not None, patience, self._topic.name, self.refusals)

    def grid(self) -> OccupancyGrid:
        """The map now; call `wait` before."""
        with self._news:
            if self._grid is None:
                raise RuntimeError("there is no map yet")
            return self._grid

    def _hear(self, message: ros.OccupancyGrid) -> None:
        with self._news:
            try:
                self._grid = decode_occupancy_grid(message, self._frame, margin=MARGIN)
            except MessageError as error:
                self.refusals.add(self._topic.name, error)
            self._news.notify_all()


class OutsidePose:
    """A `PoseEstimator` that believes an outside localization: map → odom on ``/tf``, else ``/amcl_pose``.

    Args:
        transport: ROS.
        names: What everything is called.
        odometry: The robot's last odometry; with it, a pose becomes map → odom.
    """

    def __init__(self, transport: Transport, names: RosNames, odometry: Callable[[], Odometry | None]) -> None:
        self.refusals = RejectedMessages()
        self._topics, self._frames = names.topics, names.frames
        self._odometry = odometry
        self._news = threading.Condition()
        self._map_from_odom: Pose | None = None
        self._has_transforms = False
        self._confirmed = -math.inf  # s
        self._now = -math.inf  # s
        transport.subscribe(self._topics.tf, self._hear_transforms)
        transport.subscribe(self._topics.amcl_pose, self._hear_estimate)

    def wait(self, patience: float) -> None:
        """Wait for a pose.

        Raises:
            InputError: None came within ``patience`` seconds.
        """
        what = f"{self._frames.map} → {self._frames.odom} on {self._topics.tf.name}, or {self._topics.amcl_pose.name}"
        _wait(self._news, lambda: self._map_from_odom is not None, patience, what, self.refusals)

    def wait_until_near(self, pose: Pose, odometry: Odometry, patience: float) -> bool:
        """Wait up to ``patience`` seconds; returns whether it has the robot about there."""
        deadline = time.monotonic() + patience
        with self._news:
            while not (self._map_from_odom is not None and self.pose(odometry).is_near(pose, NEAR, NEAR)):
                if time.monotonic() > deadline:
                    return False
                self._news.wait(POLL)
            return True

    def pose(self, odometry: Odometry) -> Pose:
        """base_link in the map frame; call `wait` before."""
        with self._news:
            if self._map_from_odom is None:
                raise RuntimeError("there is no pose yet")
            return self._map_from_odom @ odometry.pose

    def update(self, odometry: Odometry, scan: Scan) -> Pose:
        """As `PoseEstimator.update`."""
        self._now = scan.time
        return self.pose(odometry)

    @property
    def particles(self) -> NDArray[np.float64]:
        """None: they are somebody else's, who shows them."""
        return np.empty((0, 3))

    @property
    def is_lost(self) -> bool:
        """Whether nobody has said for a while where the robot is."""
        return self._now - self._confirmed > OLDEST

    def _hear_transforms(self, message: ros.TFMessage) -> None:
        with self._news:
            try:
                for link in transforms_between(message, self._frames.map, self._frames.odom):
                    self._map_from_odom, self._confirmed, self._has_transforms = link.pose, link.time, True
            except MessageError as error:
                self.refusals.add(self._topics.tf.name, error)
            self._news.notify_all()

    def _hear_estimate(self, message: ros.PoseWithCovarianceStamped) -> None:
        odometry = self._odometry()
        if self._has_transforms or odometry is None:
            return  # transforms say it better: they come with every scan
        with self._news:
            try:
                _, pose = decode_pose_estimate(message, self._frames.map)
            except MessageError as error:
                self.refusals.add(self._topics.amcl_pose.name, error)
            else:
                # amcl tells its pose only after movement: what it does not take back holds.
                self._map_from_odom, self._confirmed = pose @ odometry.pose.inverse, math.inf
            self._news.notify_all()


class OutsideMapper:
    """A map of somebody else's, and the robot's pose on it, as exploring needs them; both have been waited for.

    Args:
        grid: The map now; it may grow, or be finished.
        pose: Where the robot is.
        odometry: Of now.
    """

    def __init__(self, grid: Callable[[], OccupancyGrid], pose: OutsidePose, odometry: Odometry) -> None:
        self.grid = grid
        self.pose_estimator = pose
        self.start = pose.pose(odometry)

    def resume(self, pose: Pose) -> None:
        """As `Mapper.resume`: whoever maps and localizes here has never stopped."""


def _wait(
    news: threading.Condition, happened: Callable[[], bool], patience: float, what: str, refusals: RejectedMessages
) -> None:
    deadline = time.monotonic() + patience
    with news:
        while not happened():
            if time.monotonic() > deadline:
                refused = f"; refused {refusals.last}" if refusals.last else ""
                raise InputError("ROS", what, f"not heard within {patience:g} s{refused}")
            news.wait(POLL)
