"""Protocols of the messages that `wherry.ros.decoding` accepts: attributes named and typed as in ROS 2.

Our own classes (`wherry.ros.messages`) satisfy these protocols, and so do the classes with which rosbags reads bags of
ROS 1 and ROS 2.
"""

# ruff: noqa: D102 - the attributes are documented in ROS's message definitions

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray


class TimeLike(Protocol):
    """builtin_interfaces/Time."""

    @property
    def sec(self) -> int: ...
    @property
    def nanosec(self) -> int: ...


class HeaderLike(Protocol):
    """std_msgs/Header."""

    @property
    def stamp(self) -> TimeLike: ...
    @property
    def frame_id(self) -> str: ...


class VectorLike(Protocol):
    """geometry_msgs/Point and geometry_msgs/Vector3."""

    @property
    def x(self) -> float: ...
    @property
    def y(self) -> float: ...
    @property
    def z(self) -> float: ...


class QuaternionLike(VectorLike, Protocol):
    """geometry_msgs/Quaternion."""

    @property
    def w(self) -> float: ...


class PoseLike(Protocol):
    """geometry_msgs/Pose."""

    @property
    def position(self) -> VectorLike: ...
    @property
    def orientation(self) -> QuaternionLike: ...


class PoseWithCovarianceLike(Protocol):
    """geometry_msgs/PoseWithCovariance, whose covariance is not used."""

    @property
    def pose(self) -> PoseLike: ...


class PoseWithCovarianceStampedLike(Protocol):
    """geometry_msgs/PoseWithCovarianceStamped."""

    @property
    def header(self) -> HeaderLike: ...
    @property
    def pose(self) -> PoseWithCovarianceLike: ...


class TransformLike(Protocol):
    """geometry_msgs/Transform."""

    @property
    def translation(self) -> VectorLike: ...
    @property
    def rotation(self) -> QuaternionLike: ...


class TransformStampedLike(Protocol):
    """geometry_msgs/TransformStamped."""

    @property
    def header(self) -> HeaderLike: ...
    @property
    def child_frame_id(self) -> str: ...
    @property
    def transform(self) -> TransformLike: ...


class TFMessageLike(Protocol):
    """tf2_msgs/TFMessage."""

    @property
    def transforms(self) -> Sequence[TransformStampedLike]: ...


class TwistLike(Protocol):
    """geometry_msgs/Twist."""

    @property
    def linear(self) -> VectorLike: ...
    @property
    def angular(self) -> VectorLike: ...


class TwistWithCovarianceLike(Protocol):
    """geometry_msgs/TwistWithCovariance, whose covariance is not used."""

    @property
    def twist(self) -> TwistLike: ...


class OdometryLike(Protocol):
    """nav_msgs/Odometry."""

    @property
    def header(self) -> HeaderLike: ...
    @property
    def child_frame_id(self) -> str: ...
    @property
    def pose(self) -> PoseWithCovarianceLike: ...
    @property
    def twist(self) -> TwistWithCovarianceLike: ...


class LaserScanLike(Protocol):
    """sensor_msgs/LaserScan, without the fields that are not used."""

    @property
    def header(self) -> HeaderLike: ...
    @property
    def angle_min(self) -> float: ...
    @property
    def angle_max(self) -> float: ...
    @property
    def angle_increment(self) -> float: ...
    @property
    def time_increment(self) -> float: ...
    @property
    def range_min(self) -> float: ...
    @property
    def range_max(self) -> float: ...
    @property
    def ranges(self) -> NDArray[np.float32]: ...


class MapMetaDataLike(Protocol):
    """nav_msgs/MapMetaData."""

    @property
    def resolution(self) -> float: ...
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def origin(self) -> PoseLike: ...


class OccupancyGridLike(Protocol):
    """nav_msgs/OccupancyGrid."""

    @property
    def header(self) -> HeaderLike: ...
    @property
    def info(self) -> MapMetaDataLike: ...
    @property
    def data(self) -> NDArray[np.int8]: ...
