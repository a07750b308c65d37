"""The ROS messages that wherry sends and receives, in ROS 2's field layout.

These are plain dataclasses rather than classes generated from .msg files, for three reasons. Type checkers and editors
see their fields. Live ROS works without rosbags, which has the .msg files and is optional. And one class serves ROS 1,
ROS 2 and bags: ROS 1 differs only in names (``secs``, ``nsecs``), in ``Header.seq``, and in fields of `Marker` that it
lacks. The definitions are therefore repeated here; a test compares every field and every constant with ROS's
own.

Units and frames follow REP 103: m, rad, s; x forward, y left, z up.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from wherry.ros.message_fields import (
    Byte,
    Bytes,
    Covariance,
    Flag,
    Float32,
    Float32s,
    Float64,
    Float64s,
    Int8s,
    Int32,
    Message,
    Text,
    Texts,
    UInt8,
    UInt32,
)


def message_types() -> dict[str, type[Message]]:
    """All message classes of this module by their `type_name`."""
    return {message_type.type_name: message_type for message_type in Message.__subclasses__()}


S = TypeVar("S", bound=np.generic)


def _empty(dtype: type[S]) -> Callable[[], NDArray[S]]:
    """A factory of empty arrays, the defaults of sequences."""
    return lambda: np.empty(0, dtype)


def _unknown_covariance() -> NDArray[np.float64]:
    """Zeros, which by convention mean that a covariance is unknown."""
    return np.zeros(36)


# ---- builtin_interfaces, std_msgs, rosgraph_msgs


@dataclass(frozen=True)
class Time(Message):
    """A time stamp."""

    type_name = "builtin_interfaces/msg/Time"
    sec: Int32 = 0
    nanosec: UInt32 = 0


@dataclass(frozen=True)
class Duration(Message):
    """A duration."""

    type_name = "builtin_interfaces/msg/Duration"
    sec: Int32 = 0
    nanosec: UInt32 = 0


@dataclass(frozen=True)
class Header(Message):
    """Time stamp and coordinate frame of the data that follow."""

    type_name = "std_msgs/msg/Header"
    stamp: Time = Time()
    frame_id: Text = ""


@dataclass(frozen=True)
class ColorRGBA(Message):
    """Red, green, blue and opacity, 0 to 1."""

    type_name = "std_msgs/msg/ColorRGBA"
    r: Float32 = 0.0
    g: Float32 = 0.0
    b: Float32 = 0.0
    a: Float32 = 0.0


@dataclass(frozen=True)
class Bool(Message):
    """A Boolean."""

    type_name = "std_msgs/msg/Bool"
    data: Flag = False


@dataclass(frozen=True)
class Empty(Message):
    """A signal without data; ROS 2 serializes one dummy byte, ROS 1 none."""

    type_name = "std_msgs/msg/Empty"
    structure_needs_at_least_one_member: UInt8 = 0


@dataclass(frozen=True)
class String(Message):
    """A string."""

    type_name = "std_msgs/msg/String"
    data: Text = ""


@dataclass(frozen=True)
class Clock(Message):
    """Simulated time (``/clock``)."""

    type_name = "rosgraph_msgs/msg/Clock"
    clock: Time = Time()


# ---- geometry_msgs, tf2_msgs


@dataclass(frozen=True)
class Vector3(Message):
    """A free vector: a displacement, velocity or size."""

    type_name = "geometry_msgs/msg/Vector3"
    x: Float64 = 0.0
    y: Float64 = 0.0
    z: Float64 = 0.0


@dataclass(frozen=True)
class Point(Message):
    """A position, m."""

    type_name = "geometry_msgs/msg/Point"
    x: Float64 = 0.0
    y: Float64 = 0.0
    z: Float64 = 0.0


@dataclass(frozen=True)
class Quaternion(Message):
    """A rotation as a unit quaternion."""

    type_name = "geometry_msgs/msg/Quaternion"
    x: Float64 = 0.0
    y: Float64 = 0.0
    z: Float64 = 0.0
    w: Float64 = 1.0


@dataclass(frozen=True)
class Pose(Message):
    """A position and an orientation."""

    type_name = "geometry_msgs/msg/Pose"
    position: Point = Point()
    orientation: Quaternion = Quaternion()


@dataclass(frozen=True)
class PoseStamped(Message):
    """A pose with time stamp and frame."""

    type_name = "geometry_msgs/msg/PoseStamped"
    header: Header = Header()
    pose: Pose = Pose()


@dataclass(frozen=True)
class PoseWithCovariance(Message):
    """A pose and its covariance: [6, 6] row by row, over x, y, z and the rotations about x, y, z."""

    type_name = "geometry_msgs/msg/PoseWithCovariance"
    pose: Pose = Pose()
    covariance: Covariance = field(default_factory=_unknown_covariance)


@dataclass(frozen=True)
class PoseWithCovarianceStamped(Message):
    """An estimated pose (``/amcl_pose``)."""

    type_name = "geometry_msgs/msg/PoseWithCovarianceStamped"
    header: Header = Header()
    pose: PoseWithCovariance = field(default_factory=PoseWithCovariance)


@dataclass(frozen=True)
class PoseArray(Message):
    """Many poses (``/particlecloud``)."""

    type_name = "geometry_msgs/msg/PoseArray"
    header: Header = Header()
    poses: tuple[Pose, ...] = ()


@dataclass(frozen=True)
class Twist(Message):
    """Velocities along and about the axes, m/s and rad/s (``/cmd_vel``)."""

    type_name = "geometry_msgs/msg/Twist"
    linear: Vector3 = Vector3()
    angular: Vector3 = Vector3()


@dataclass(frozen=True)
class TwistStamped(Message):
    """Velocities with time stamp and frame."""

    type_name = "geometry_msgs/msg/TwistStamped"
    header: Header = Header()
    twist: Twist = Twist()


@dataclass(frozen=True)
class TwistWithCovariance(Message):
    """Velocities and their covariance, laid out as in `PoseWithCovariance`."""

    type_name = "geometry_msgs/msg/TwistWithCovariance"
    twist: Twist = Twist()
    covariance: Covariance = field(default_factory=_unknown_covariance)


@dataclass(frozen=True)
class Transform(Message):
    """A translation, m, and a rotation."""

    type_name = "geometry_msgs/msg/Transform"
    translation: Vector3 = Vector3()
    rotation: Quaternion = Quaternion()


@dataclass(frozen=True)
class TransformStamped(Message):
    """Pose of ``child_frame_id`` in the header's frame."""

    type_name = "geometry_msgs/msg/TransformStamped"
    header: Header = Header()
    child_frame_id: Text = ""
    transform: Transform = Transform()


@dataclass(frozen=True)
class TFMessage(Message):
    """Transforms (``/tf``, ``/tf_static``)."""

    type_name = "tf2_msgs/msg/TFMessage"
    transforms: tuple[TransformStamped, ...] = ()


# ---- sensor_msgs, nav_msgs


@dataclass(frozen=True)
class LaserScan(Message):
    """One revolution of a lidar (``/scan``): angles in rad, ranges in m, times in s."""

    type_name = "sensor_msgs/msg/LaserScan"
    header: Header = Header()
    angle_min: Float32 = 0.0
    angle_max: Float32 = 0.0
    angle_increment: Float32 = 0.0
    time_increment: Float32 = 0.0
    scan_time: Float32 = 0.0
    range_min: Float32 = 0.0
    range_max: Float32 = 0.0
    ranges: Float32s = field(default_factory=_empty(np.float32))
    intensities: Float32s = field(default_factory=_empty(np.float32))


@dataclass(frozen=True)
class JointState(Message):
    """Positions (rad or m), velocities and efforts of named joints (``/joint_states``)."""

    type_name = "sensor_msgs/msg/JointState"
    header: Header = Header()
    name: Texts = ()
    position: Float64s = field(default_factory=_empty(np.float64))
    velocity: Float64s = field(default_factory=_empty(np.float64))
    effort: Float64s = field(default_factory=_empty(np.float64))


@dataclass(frozen=True)
class CompressedImage(Message):
    """A compressed image; only used as a field of ROS 2 markers."""

    type_name = "sensor_msgs/msg/CompressedImage"
    header: Header = Header()
    format: Text = ""
    data: Bytes = field(default_factory=_empty(np.uint8))


@dataclass(frozen=True)
class Odometry(Message):
    """Pose of ``child_frame_id`` in the header's frame by odometry, and its velocity in its own frame (``/odom``)."""

    type_name = "nav_msgs/msg/Odometry"
    header: Header = Header()
    child_frame_id: Text = ""
    pose: PoseWithCovariance = field(default_factory=PoseWithCovariance)
    twist: TwistWithCovariance = field(default_factory=TwistWithCovariance)


@dataclass(frozen=True)
class MapMetaData(Message):
    """Cell size of a grid, m, its width and height in cells, and the pose of its first cell's outer corner."""

    type_name = "nav_msgs/msg/MapMetaData"
    map_load_time: Time = Time()
    resolution: Float32 = 0.0
    width: UInt32 = 0
    height: UInt32 = 0
    origin: Pose = Pose()


@dataclass(frozen=True)
class OccupancyGrid(Message):
    """A map (``/map``): per cent occupied, −1 for unknown, row by row from the smallest y."""

    type_name = "nav_msgs/msg/OccupancyGrid"
    header: Header = Header()
    info: MapMetaData = MapMetaData()
    data: Int8s = field(default_factory=_empty(np.int8))


@dataclass(frozen=True)
class Path(Message):
    """A path as a sequence of poses (``/plan``)."""

    type_name = "nav_msgs/msg/Path"
    header: Header = Header()
    poses: tuple[PoseStamped, ...] = ()


# ---- visualization_msgs, diagnostic_msgs


@dataclass(frozen=True)
class UVCoordinate(Message):
    """Texture coordinates; ROS 2 only."""

    type_name = "visualization_msgs/msg/UVCoordinate"
    u: Float32 = 0.0
    v: Float32 = 0.0


@dataclass(frozen=True)
class MeshFile(Message):
    """A mesh file; ROS 2 only."""

    type_name = "visualization_msgs/msg/MeshFile"
    filename: Text = ""
    data: Bytes = field(default_factory=_empty(np.uint8))


@dataclass(frozen=True)
class Marker(Message):
    """A shape for RViz; ROS 1 lacks ``texture_resource``, ``texture``, ``uv_coordinates`` and ``mesh_file``."""

    type_name = "visualization_msgs/msg/Marker"
    ARROW: ClassVar[int] = 0
    CUBE: ClassVar[int] = 1
    SPHERE: ClassVar[int] = 2
    CYLINDER: ClassVar[int] = 3
    LINE_STRIP: ClassVar[int] = 4
    LINE_LIST: ClassVar[int] = 5
    CUBE_LIST: ClassVar[int] = 6
    POINTS: ClassVar[int] = 8
    TEXT_VIEW_FACING: ClassVar[int] = 9
    ADD: ClassVar[int] = 0
    DELETE: ClassVar[int] = 2
    DELETEALL: ClassVar[int] = 3
    header: Header = Header()
    ns: Text = ""
    id: Int32 = 0
    type: Int32 = 0
    action: Int32 = 0
    pose: Pose = Pose()
    scale: Vector3 = Vector3()
    color: ColorRGBA = ColorRGBA()
    lifetime: Duration = Duration()
    frame_locked: Flag = False
    points: tuple[Point, ...] = ()
    colors: tuple[ColorRGBA, ...] = ()
    texture_resource: Text = ""
    texture: CompressedImage = field(default_factory=CompressedImage)
    uv_coordinates: tuple[UVCoordinate, ...] = ()
    text: Text = ""
    mesh_resource: Text = ""
    mesh_file: MeshFile = field(default_factory=MeshFile)
    mesh_use_embedded_materials: Flag = False


@dataclass(frozen=True)
class MarkerArray(Message):
    """Shapes for RViz (``/markers``)."""

    type_name = "visualization_msgs/msg/MarkerArray"
    markers: tuple[Marker, ...] = ()


@dataclass(frozen=True)
class KeyValue(Message):
    """A named value of a diagnostic status."""

    type_name = "diagnostic_msgs/msg/KeyValue"
    key: Text = ""
    value: Text = ""


@dataclass(frozen=True)
class DiagnosticStatus(Message):
    """Status of one component."""

    type_name = "diagnostic_msgs/msg/DiagnosticStatus"
    OK: ClassVar[int] = 0
    WARN: ClassVar[int] = 1
    ERROR: ClassVar[int] = 2
    STALE: ClassVar[int] = 3
    level: Byte = 0
    name: Text = ""
    message: Text = ""
    hardware_id: Text = ""
    values: tuple[KeyValue, ...] = ()


@dataclass(frozen=True)
class DiagnosticArray(Message):
    """Status of all components (``/diagnostics``)."""

    type_name = "diagnostic_msgs/msg/DiagnosticArray"
    header: Header = Header()
    status: tuple[DiagnosticStatus, ...] = ()
