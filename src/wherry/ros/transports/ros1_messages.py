"""ROS 1's message classes: importing them, and converting our messages to them and back.

rospy and the messages come from the system's package manager, never from pip. Debian installs them for its own Python
in a folder that virtual environments do not search; `ros1_module` appends that folder to ``sys.path``, so that the
environment's own packages (numpy, yaml) keep precedence.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from wherry.errors import InputError
from wherry.ros.message_fields import ARRAY_TYPES, Field, Message, MessageT, cached, fields_of
from wherry.ros.messages import Duration, Time

DEBIAN_PACKAGES = Path("/usr/lib/python3/dist-packages")
DEBIAN_PYTHON = Path("/usr/bin/python3")
PACKAGES = (
    "python3-rospy python3-std-msgs python3-sensor-msgs python3-nav-msgs python3-geometry-msgs python3-tf2-msgs "
    "python3-visualization-msgs python3-diagnostic-msgs"
)
GENPY_CLASSES = {Time: "Time", Duration: "Duration"}  # primitives of ROS 1, defined in the module genpy
ROS2_ONLY_FIELDS = {
    *("texture_resource", "texture", "uv_coordinates", "mesh_file"),  # of Marker
    "structure_needs_at_least_one_member",  # of Empty
}

Converter = Callable[[Any], Any]


def ros1_module(name: str) -> ModuleType:
    """Import rospy, or a package of ROS 1's messages such as "sensor_msgs.msg".

    A sourced ROS environment (``PYTHONPATH``) comes first, then Debian's packages, if they are for this Python version.

    Raises:
        InputError: It is not installed, or only for another Python version.
    """
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        folder = str(DEBIAN_PACKAGES)
        if folder in sys.path or not _is_debians_python():
            raise _not_installed(error) from error
        sys.path.append(folder)
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        sys.path.remove(folder)
        raise _not_installed(error) from error


def _is_debians_python() -> bool:
    """Whether this Python has the version for which Debian's packages are built."""
    return DEBIAN_PYTHON.resolve().name == f"python{sys.version_info.major}.{sys.version_info.minor}"


def _not_installed(error: ModuleNotFoundError) -> InputError:
    """The error that names what is missing and how to install it."""
    ours, system = f"{sys.version_info.major}.{sys.version_info.minor}", DEBIAN_PYTHON.resolve().name
    reason = f"ROS 1 needs it; on Debian: apt install {PACKAGES}"
    if DEBIAN_PACKAGES.joinpath("rospy").is_dir() and not _is_debians_python():
        reason = (
            f"ROS 1 is installed for {system}, but this is Python {ours}: make the environment with {DEBIAN_PYTHON}"
        )
    return InputError("ROS 1", f"Python module {error.name}", reason)


@cached
def ros1_class(message_type: type[Message]) -> Any:
    """The class of rospy that corresponds to one of our message classes.

    Raises:
        InputError: Its package is not installed.
    """
    if message_type in GENPY_CLASSES:
        return getattr(ros1_module("genpy"), GENPY_CLASSES[message_type])
    package, _, name = message_type.type_name.split("/")
    return getattr(ros1_module(f"{package}.msg"), name)


@cached
def ros1_reader(message_type: type[Message]) -> Any:
    """`ros1_class`, but deserializing number sequences straight into arrays: a map may have millions of cells."""
    ros1 = ros1_class(message_type)

    def deserialize(self: Any, data: bytes) -> Any:
        return self.deserialize_numpy(data, np)

    return type(ros1.__name__, (ros1,), {"deserialize": deserialize})


def to_ros1(message: Message) -> Any:
    """Convert a message for rospy, which sets the sequence number; fields that only ROS 2 has are dropped."""
    return _to_ros1(type(message))(message)


def from_ros1(message: Any, message_type: type[MessageT]) -> MessageT:
    """Convert a message of rospy; fields that only ROS 2 has keep their defaults."""
    converted: MessageT = _from_ros1(message_type)(message)
    return converted


@cached
def _to_ros1(message_type: type[Message]) -> Converter:
    """The converter of a message class to rospy's."""
    ros1 = ros1_class(message_type)
    if message_type in GENPY_CLASSES:
        return lambda time: ros1(time.sec, time.nanosec)
    plan = [(field.name, _field_to_ros1(field)) for field in _shared_fields(message_type)]

    def convert(message: Message) -> Any:
        converted = ros1()
        for name, field in plan:
            setattr(converted, name, field(getattr(message, name)))
        return converted

    return convert


def _field_to_ros1(field: Field) -> Converter:
    """The converter of a field's value to rospy's."""
    if not isinstance(field.type, str):
        element = _to_ros1(field.type)
        return element if field.length is None else lambda values: [element(value) for value in values]
    if field.length is None:
        return _unchanged
    if field.type == "uint8":
        return bytes
    return list if field.type == "string" else np.ndarray.tolist


@cached
def _from_ros1(message_type: type[Message]) -> Converter:
    """The converter of rospy's messages to a message class."""
    if message_type in GENPY_CLASSES:
        return lambda time: message_type(time.secs, time.nsecs)  # type: ignore[call-arg]
    plan = [(field.name, _field_from_ros1(field)) for field in _shared_fields(message_type)]

    def convert(message: Any) -> Message:
        return message_type(**{name: field(getattr(message, name)) for name, field in plan})

    return convert


def _field_from_ros1(field: Field) -> Converter:
    """The converter of a field's value from rospy's."""
    if not isinstance(field.type, str):
        element = _from_ros1(field.type)
        return element if field.length is None else lambda values: tuple(element(value) for value in values)
    if field.length is None:
        return _unchanged
    if field.type == "string":
        return tuple
    dtype = ARRAY_TYPES[field.type]
    if field.type == "uint8":  # rospy deserializes these as bytes
        return lambda values: np.frombuffer(bytes(values), np.uint8)
    return lambda values: np.asarray(values, dtype)


def _shared_fields(message_type: type[Message]) -> list[Field]:
    """The fields that ROS 1 has too.

    Raises:
        TypeError: ROS 1 lacks a field that is not known to be of ROS 2 only.
    """
    available = set(ros1_class(message_type).__slots__)
    missing = {field.name for field in fields_of(message_type)} - available - ROS2_ONLY_FIELDS
    if missing:
        raise TypeError(f"{message_type.type_name} has no {', '.join(sorted(missing))} in ROS 1")
    return [field for field in fields_of(message_type) if field.name in available]


def _unchanged(value: Any) -> Any:
    return value
