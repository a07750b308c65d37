"""Map and pose of an external navigation stack: gmapping, slam_toolbox, map_server, amcl, nav2."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from wherry.robot import Odometry, Scan
from wherry.ros import messages as ros
from wherry.ros.decoding import decode_occupancy_grid, decode_pose_estimate, transforms_between
from wherry.ros.diagnostics import RejectedMessages
from wherry.ros.names import RosNames
from wherry.ros.nodes.subscriptions import POLL_PERIOD, Subscriptions
from wherry.ros.transports.protocol import Transport
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose

UNKNOWN_MARGIN = 1.0  # m of unknown space kept around a map, so that it has frontiers
POSE_TOLERANCE = 0.3  # m and rad, between an initial pose and the estimate of a localization that accepted it
POSE_MAX_AGE = 2.0  # s, of the last transform; with an older one the robot counts as lost


class ExternalMap:
    """The latest valid message on ``/map``.

    Args:
        transport: Connection to ROS.
        names: Names of topics and frames.
    """

    def __init__(self, transport: Transport, names: RosNames) -> None:
        self._topic, self._frame = names.topics.map, names.frames.map
        self._subscriptions = Subscriptions(transport)
        self._grid: OccupancyGrid | None = None
        self._subscriptions.add(self._topic, self._on_map)

    def wait(self, timeout: float) -> None:
        """Wait for a map.

        Args:
            timeout: Maximum waiting time, s.

        Raises:
            InputError: No valid map was received within ``timeout``.
        """
        self._subscriptions.wait_for(lambda: [self._topic.name] if self._grid is None else [], timeout)

    def grid(self) -> OccupancyGrid:
        """The latest map; call `wait` before."""
        with self._subscriptions.changed:
            if self._grid is None:
                raise RuntimeError("there is no map yet")
            return self._grid

    def _on_map(self, message: ros.OccupancyGrid) -> None:
        self._grid = decode_occupancy_grid(message, self._frame, margin=UNKNOWN_MARGIN)


class ExternalPose:
    """A `PoseEstimator` that takes the pose of an external localization: map → odom on ``/tf``, else ``/amcl_pose``.

    Args:
        transport: Connection to ROS.
        names: Names of topics and frames.
        odometry: Returns the robot's latest odometry, which turns a pose into map → odom.
    """

    def __init__(self, transport: Transport, names: RosNames, odometry: Callable[[], Odometry | None]) -> None:
        self._topics, self._frames = names.topics, names.frames
        self._odometry = odometry
        self._subscriptions = Subscriptions(transport)
        self._map_from_odom: Pose | None = None
        self._has_transforms = False
        self._confirmed_at = -math.inf  # s, robot's clock
        self._now = -math.inf  # s, robot's clock
        self._subscriptions.add(self._topics.tf, self._on_transforms)
        self._subscriptions.add(self._topics.amcl_pose, self._on_estimate)

    @property
    def rejected(self) -> RejectedMessages:
        """Counts of rejected messages by topic."""
        return self._subscriptions.rejected

    def wait(self, timeout: float) -> None:
        """Wait for a pose.

        Args:
            timeout: Maximum waiting time, s.

        Raises:
            InputError: No valid pose was received within ``timeout``.
        """
        source = f"{self._frames.map} → {self._frames.odom} on {self._topics.tf.name}, or {self._topics.amcl_pose.name}"
        self._subscriptions.wait_for(lambda: [source] if self._map_from_odom is None else [], timeout)

    def wait_until_near(self, pose: Pose, odometry: Odometry, timeout: float) -> bool:
        """Wait up to ``timeout`` seconds; returns whether the pose is within `POSE_TOLERANCE` of ``pose``."""
        deadline = time.monotonic() + timeout
        changed = self._subscriptions.changed
        with changed:
            while not (self._map_from_odom is not None and self._is_near(pose, odometry)):
                if time.monotonic() > deadline:
                    return False
                changed.wait(POLL_PERIOD)
            return True

    def _is_near(self, pose: Pose, odometry: Odometry) -> bool:
        return self.pose(odometry).is_near(pose, POSE_TOLERANCE, POSE_TOLERANCE)

    def pose(self, odometry: Odometry) -> Pose:
        """base_link in the map frame; call `wait` before."""
        with self._subscriptions.changed:
            if self._map_from_odom is None:
                raise RuntimeError("there is no pose yet")
            return self._map_from_odom @ odometry.pose

    def update(self, odometry: Odometry, scan: Scan) -> Pose:
        """As `PoseEstimator.update`."""
        self._now = scan.time
        return self.pose(odometry)

    @property
    def particles(self) -> NDArray[np.float64]:
        """[0, 3]: the external localization publishes its own particles."""
        return np.empty((0, 3))

    @property
    def is_lost(self) -> bool:
        """Whether the last pose is older than `POSE_MAX_AGE`."""
        return self._now - self._confirmed_at > POSE_MAX_AGE

    def _on_transforms(self, message: ros.TFMessage) -> None:
        for transform in transforms_between(message, self._frames.map, self._frames.odom):
            self._map_from_odom, self._confirmed_at = transform.pose, transform.time
            self._has_transforms = True

    def _on_estimate(self, message: ros.PoseWithCovarianceStamped) -> None:
        odometry = self._odometry()
        if self._has_transforms or odometry is None:
            return  # transforms are more accurate, since there is one for every scan
        _, pose = decode_pose_estimate(message, self._frames.map)
        # amcl publishes its pose only after motion, so an old estimate stays valid.
        self._map_from_odom, self._confirmed_at = pose @ odometry.pose.inverse, math.inf


class ExternalMapper:
    """An external map and the robot's pose on it as a `Mapper` for exploration.

    Args:
        grid: Returns the latest map, which may still grow.
        pose: Estimates the robot's pose; it must have received one.
        odometry: The robot's latest odometry.
    """

    def __init__(self, grid: Callable[[], OccupancyGrid], pose: ExternalPose, odometry: Odometry) -> None:
        self.grid = grid
        self.pose_estimator = pose
        self.start = pose.pose(odometry)

    def resume(self, pose: Pose) -> None:
        """As `Mapper.resume`; the external stack has never stopped."""
