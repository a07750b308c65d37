"""ROS 1's message classes: where they come from, and how ours become theirs and back.

rospy and the messages come from the system's package manager, never from pip. Debian installs them for its own Python
in a folder that a virtual environment does not look into; `ros1_module` adds that folder at the very end of
``sys.path``, so that everything that the environment has itself (numpy, yaml) stays the one that is used.
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
from wherry.ros.messages import ARRAY_TYPES, Duration, Field, M, Message, Time, cached, fields_of

DEBIAN = Path("/usr/lib/python3/dist-packages")
DEBIAN_PYTHON = Path("/usr/bin/python3")
PACKAGES = (
    "python3-rospy python3-std-msgs python3-sensor-msgs python3-nav-msgs python3-geometry-msgs python3-tf2-msgs "
    "python3-visualization-msgs python3-diagnostic-msgs"
)
TIMES = {Time: "Time", Duration: "Duration"}  # primitives in ROS 1, of the module genpy
ROS2_ONLY = {
    *("texture_resource", "texture", "uv_coordinates", "mesh_file"),  # of a marker
    "structure_needs_at_least_one_member",  # of an empty message
}

Convert = Callable[[Any], Any]


def ros1_module(name: str) -> ModuleType:
    """Import rospy, or a package of ROS 1's messages such as "sensor_msgs.msg".

    A sourced ROS environment (``PYTHONPATH``) comes first, then Debian's packages, if they are for this version.

    Raises:
        InputError: It is not installed, or only for another version of Python.
    """
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        folder = str(DEBIAN)
        if folder in sys.path or not _is_debians_python():
            raise _not_installed(error) from error
        sys.path.append(folder)
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        sys.path.remove(folder)
        raise _not_installed(error) from error


def _is_debians_python() -> bool:
    """Whether this Python is of the version that Debian's packages are for."""
    return DEBIAN_PYTHON.resolve().name == f"python{sys.version_info.major}.{sys.version_info.minor}"


def _not_installed(error: ModuleNotFoundError) -> InputError:
    """What is missing, and how to get it."""
    ours, system = f"{sys.version_info.major}.{sys.version_info.minor}", DEBIAN_PYTHON.resolve().name
    reason = f"ROS 1 needs it; on Debian: apt install {PACKAGES}"
    if DEBIAN.joinpath("rospy").is_dir() and not _is_debians_python():
        reason = (
            f"ROS 1 is installed for {system}, but this is Python {ours}: make the environment with {DEBIAN_PYTHON}"
        )
    return InputError("ROS 1", f"Python module {error.name}", reason)


@cached
def ros1_class(message_type: type[Message]) -> Any:
    """The class that rospy sends for one of our messages.

    Raises:
        InputError: Its package is not installed.
    """
    if message_type in TIMES:
        return getattr(ros1_module("genpy"), TIMES[message_type])
    package, _, name = message_type.type_name.split("/")
    return getattr(ros1_module(f"{package}.msg"), name)


@cached
def ros1_reader(message_type: type[Message]) -> Any:
    """The same, but that it reads sequences of numbers as arrays at once: a map may have millions."""
    ros1 = ros1_class(message_type)

    def deserialize(self: Any, data: bytes) -> Any:
        return self.deserialize_numpy(data, np)

    return type(ros1.__name__, (ros1,), {"deserialize": deserialize})


def to_ros1(message: Message) -> Any:
    """The message as rospy sends it; its sequence number is set by rospy, and what only ROS 2 has is left out."""
    return _to_ros1(type(message))(message)


def from_ros1(message: Any, message_type: type[M]) -> M:
    """The message as we have it; what only ROS 2 has keeps its default."""
    converted: M = _from_ros1(message_type)(message)
    return converted


@cached
def _to_ros1(message_type: type[Message]) -> Convert:
    """How messages of a type become ROS 1's."""
    ros1 = ros1_class(message_type)
    if message_type in TIMES:
        return lambda time: ros1(time.sec, time.nanosec)
    plan = [(field.name, _field_to_ros1(field)) for field in _shared_fields(message_type)]

    def convert(message: Message) -> Any:
        converted = ros1()
        for name, field in plan:
            setattr(converted, name, field(getattr(message, name)))
        return converted

    return convert


def _field_to_ros1(field: Field) -> Convert:
    """How a field's value becomes ROS 1's."""
    if not isinstance(field.kind, str):
        element = _to_ros1(field.kind)
        return element if field.length is None else lambda values: [element(value) for value in values]
    if field.length is None:
        return _unchanged
    if field.kind == "uint8":
        return bytes
    return list if field.kind == "string" else np.ndarray.tolist


@cached
def _from_ros1(message_type: type[Message]) -> Convert:
    """How ROS 1's messages become ours."""
    if message_type in TIMES:
        return lambda time: message_type(time.secs, time.nsecs)  # type: ignore[call-arg]
    plan = [(field.name, _field_from_ros1(field)) for field in _shared_fields(message_type)]

    def convert(message: Any) -> Message:
        return message_type(**{name: field(getattr(message, name)) for name, field in plan})

    return convert


def _field_from_ros1(field: Field) -> Convert:
    """How ROS 1's value of a field becomes ours."""
    if not isinstance(field.kind, str):
        element = _from_ros1(field.kind)
        return element if field.length is None else lambda values: tuple(element(value) for value in values)
    if field.length is None:
        return _unchanged
    if field.kind == "string":
        return tuple
    dtype = ARRAY_TYPES[field.kind]
    if field.kind == "uint8":  # rospy reads these as bytes
        return lambda values: np.frombuffer(bytes(values), np.uint8)
    return lambda values: np.asarray(values, dtype)


def _shared_fields(message_type: type[Message]) -> list[Field]:
    """The fields that both generations have; anything else that ROS 1 lacks is an error of ours."""
    theirs = set(ros1_class(message_type).__slots__)
    missing = {field.name for field in fields_of(message_type)} - theirs - ROS2_ONLY
    if missing:
        raise TypeError(f"{message_type.type_name} has no {', '.join(sorted(missing))} in ROS 1")
    return [field for field in fields_of(message_type) if field.name in theirs]


def _unchanged(value: Any) -> Any:
    return value
