"""The ROS messages that wherry speaks, each written once, in ROS 2's field layout.

Transports and bags convert them field by field with `fields_of`; ROS 1 differs only in names (``secs``, ``nsecs``), in
``Header.seq``, and in the fields of `Marker` that it lacks. A test compares every field with the real definitions.
Units and frames are REP 103's: m, rad, s, x forward, y left, z up.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from functools import cache
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, TypeVar, cast, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Wire:
    """How a value travels.

    Attributes:
        kind: The primitive's name in ROS's message files, such as "float64".
        length: None for one value, 0 for a sequence of any length, else an array's length.
    """

    kind: str
    length: int | None = None


Int32 = Annotated[int, Wire("int32")]
UInt32 = Annotated[int, Wire("uint32")]
UInt8 = Annotated[int, Wire("uint8")]
Byte = Annotated[int, Wire("byte")]
Float32 = Annotated[float, Wire("float32")]
Float64 = Annotated[float, Wire("float64")]
Text = Annotated[str, Wire("string")]
Flag = Annotated[bool, Wire("bool")]
Texts = Annotated[tuple[str, ...], Wire("string", 0)]
Bytes = Annotated[NDArray[np.uint8], Wire("uint8", 0)]
Int8s = Annotated[NDArray[np.int8], Wire("int8", 0)]
Float32s = Annotated[NDArray[np.float32], Wire("float32", 0)]
Float64s = Annotated[NDArray[np.float64], Wire("float64", 0)]
Covariance = Annotated[NDArray[np.float64], Wire("float64", 36)]

ARRAY_TYPES: Mapping[str, Any] = MappingProxyType(
    {"uint8": np.uint8, "int8": np.int8, "float32": np.float32, "float64": np.float64}
)
"""Of the primitives whose sequences are arrays."""


class Message:
    """What every message is.

    Attributes:
        type_name: Package, "msg" and name, as ROS 2 and rosbags write it.
    """

    type_name: ClassVar[str]


M = TypeVar("M", bound=Message)
F = TypeVar("F", bound=Callable[..., Any])


def cached(function: F) -> F:
    """`functools.cache`, keeping the function's type; mypy takes classes of messages for unhashable."""
    return cast(F, cache(function))


@dataclass(frozen=True, slots=True)
class Field:
    """One field of a message.

    Attributes:
        name: Its name.
        kind: A primitive's name, such as "float64", or the class of the message in it.
        length: None for one value, 0 for a sequence of any length, else an array's length.
    """

    name: str
    kind: str | type[Message]
    length: int | None


@cached
def fields_of(message_type: type[Message]) -> tuple[Field, ...]:
    """A message type's fields in the order in which they travel."""
    hints = get_type_hints(message_type, include_extras=True)
    return tuple(_field(entry.name, hints[entry.name]) for entry in fields(message_type))  # type: ignore[arg-type]


def _field(name: str, hint: Any) -> Field:
    if get_origin(hint) is Annotated:
        wire: Wire = get_args(hint)[1]
        return Field(name, wire.kind, wire.length)
    if get_origin(hint) is tuple:
        return Field(name, get_args(hint)[0], 0)
    return Field(name, hint, None)


def message_types() -> dict[str, type[Message]]:
    """Every message here by its `type_name`."""
    return {message_type.type_name: message_type for message_type in Message.__subclasses__()}


def _no_bytes() -> NDArray[np.uint8]:
    return np.empty(0, np.uint8)


def _no_int8s() -> NDArray[np.int8]:
    return np.empty(0, np.int8)


def _no_float32s() -> NDArray[np.float32]:
    return np.empty(0, np.float32)


def _no_float64s() -> NDArray[np.float64]:
    return np.empty(0)


def _no_covariance() -> NDArray[np.float64]:
    return np.zeros(36)


# ---- builtin_interfaces, std_msgs, rosgraph_msgs


@dataclass(frozen=True)
class Time(Message):
    """An instant on the one clock of a system."""

    type_name = "builtin_interfaces/msg/Time"
    sec: Int32 = 0
    nanosec: UInt32 = 0


@dataclass(frozen=True)
class Duration(Message):
    """A span of time."""

    type_name = "builtin_interfaces/msg/Duration"
    sec: Int32 = 0
    nanosec: UInt32 = 0


@dataclass(frozen=True)
class Header(Message):
    """When and in which frame."""

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
    """Yes or no."""

    type_name = "std_msgs/msg/Bool"
    data: Flag = False


@dataclass(frozen=True)
class Empty(Message):
    """A signal; the wire's one byte says nothing, and ROS 1 has none."""

    type_name = "std_msgs/msg/Empty"
    structure_needs_at_least_one_member: UInt8 = 0


@dataclass(frozen=True)
class String(Message):
    """A text."""

    type_name = "std_msgs/msg/String"
    data: Text = ""


@dataclass(frozen=True)
class Clock(Message):
    """What time it is in a simulation (``/clock``)."""

    type_name = "rosgraph_msgs/msg/Clock"
    clock: Time = Time()


# ---- geometry_msgs, tf2_msgs


@dataclass(frozen=True)
class Vector3(Message):
    """A vector, without a place."""

    type_name = "geometry_msgs/msg/Vector3"
    x: Float64 = 0.0
    y: Float64 = 0.0
    z: Float64 = 0.0


@dataclass(frozen=True)
class Point(Message):
    """A place, m."""

    type_name = "geometry_msgs/msg/Point"
    x: Float64 = 0.0
    y: Float64 = 0.0
    z: Float64 = 0.0


@dataclass(frozen=True)
class Quaternion(Message):
    """A rotation, of length 1."""

    type_name = "geometry_msgs/msg/Quaternion"
    x: Float64 = 0.0
    y: Float64 = 0.0
    z: Float64 = 0.0
    w: Float64 = 1.0


@dataclass(frozen=True)
class Pose(Message):
    """A place and a rotation."""

    type_name = "geometry_msgs/msg/Pose"
    position: Point = Point()
    orientation: Quaternion = Quaternion()


@dataclass(frozen=True)
class PoseStamped(Message):
    """A pose, when and in which frame."""

    type_name = "geometry_msgs/msg/PoseStamped"
    header: Header = Header()
    pose: Pose = Pose()


@dataclass(frozen=True)
class PoseWithCovariance(Message):
    """A pose and how sure it is: [6, 6] by rows, over x, y, z, and the rotations about them."""

    type_name = "geometry_msgs/msg/PoseWithCovariance"
    pose: Pose = Pose()
    covariance: Covariance = field(default_factory=_no_covariance)


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
    """Velocities, when and in which frame."""

    type_name = "geometry_msgs/msg/TwistStamped"
    header: Header = Header()
    twist: Twist = Twist()


@dataclass(frozen=True)
class TwistWithCovariance(Message):
    """Velocities and how sure they are."""

    type_name = "geometry_msgs/msg/TwistWithCovariance"
    twist: Twist = Twist()
    covariance: Covariance = field(default_factory=_no_covariance)


@dataclass(frozen=True)
class Transform(Message):
    """A shift and a rotation."""

    type_name = "geometry_msgs/msg/Transform"
    translation: Vector3 = Vector3()
    rotation: Quaternion = Quaternion()


@dataclass(frozen=True)
class TransformStamped(Message):
    """Where ``child_frame_id`` is in the header's frame."""

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
    """One turn of a lidar (``/scan``): angles in rad, ranges in m, times in s."""

    type_name = "sensor_msgs/msg/LaserScan"
    header: Header = Header()
    angle_min: Float32 = 0.0
    angle_max: Float32 = 0.0
    angle_increment: Float32 = 0.0
    time_increment: Float32 = 0.0
    scan_time: Float32 = 0.0
    range_min: Float32 = 0.0
    range_max: Float32 = 0.0
    ranges: Float32s = field(default_factory=_no_float32s)
    intensities: Float32s = field(default_factory=_no_float32s)


@dataclass(frozen=True)
class JointState(Message):
    """Positions (rad or m), velocities and efforts of named joints (``/joint_states``)."""

    type_name = "sensor_msgs/msg/JointState"
    header: Header = Header()
    name: Texts = ()
    position: Float64s = field(default_factory=_no_float64s)
    velocity: Float64s = field(default_factory=_no_float64s)
    effort: Float64s = field(default_factory=_no_float64s)


@dataclass(frozen=True)
class CompressedImage(Message):
    """A picture; here only because a ROS 2 marker has room for one."""

    type_name = "sensor_msgs/msg/CompressedImage"
    header: Header = Header()
    format: Text = ""
    data: Bytes = field(default_factory=_no_bytes)


@dataclass(frozen=True)
class Odometry(Message):
    """Where the wheels say that ``child_frame_id`` is in the header's frame; its velocity in its own (``/odom``)."""

    type_name = "nav_msgs/msg/Odometry"
    header: Header = Header()
    child_frame_id: Text = ""
    pose: PoseWithCovariance = field(default_factory=PoseWithCovariance)
    twist: TwistWithCovariance = field(default_factory=TwistWithCovariance)


@dataclass(frozen=True)
class MapMetaData(Message):
    """A grid's cell size, m, its width and height in cells, and where the outer corner of its first cell is."""

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
    data: Int8s = field(default_factory=_no_int8s)


@dataclass(frozen=True)
class Path(Message):
    """Poses to drive through (``/plan``)."""

    type_name = "nav_msgs/msg/Path"
    header: Header = Header()
    poses: tuple[PoseStamped, ...] = ()


# ---- visualization_msgs, diagnostic_msgs


@dataclass(frozen=True)
class UVCoordinate(Message):
    """A place in a texture; ROS 2 only."""

    type_name = "visualization_msgs/msg/UVCoordinate"
    u: Float32 = 0.0
    v: Float32 = 0.0


@dataclass(frozen=True)
class MeshFile(Message):
    """A mesh in a message; ROS 2 only."""

    type_name = "visualization_msgs/msg/MeshFile"
    filename: Text = ""
    data: Bytes = field(default_factory=_no_bytes)


@dataclass(frozen=True)
class Marker(Message):
    """Something to draw; ROS 1 lacks ``texture_resource``, ``texture``, ``uv_coordinates`` and ``mesh_file``."""

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
    """Things to draw (``/markers``)."""

    type_name = "visualization_msgs/msg/MarkerArray"
    markers: tuple[Marker, ...] = ()


@dataclass(frozen=True)
class KeyValue(Message):
    """A named value."""

    type_name = "diagnostic_msgs/msg/KeyValue"
    key: Text = ""
    value: Text = ""


@dataclass(frozen=True)
class DiagnosticStatus(Message):
    """How one part is doing."""

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
    """How all parts are doing (``/diagnostics``)."""

    type_name = "diagnostic_msgs/msg/DiagnosticArray"
    header: Header = Header()
    status: tuple[DiagnosticStatus, ...] = ()
