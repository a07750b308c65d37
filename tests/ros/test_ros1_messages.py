"""Conversion of our messages to ROS 1's classes and their bytes, with the packages that Debian installs."""

from __future__ import annotations

import io
import math
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.ros import messages as ros
from wherry.ros.message_fields import Field, Message, fields_of
from wherry.ros.messages import message_types
from wherry.ros.transports import ros1_messages
from wherry_testing.ros1_system import require

ROS2_ONLY_TYPES = {"visualization_msgs/msg/UVCoordinate", "visualization_msgs/msg/MeshFile"}
SHARED = sorted(set(message_types()) - ROS2_ONLY_TYPES)


@pytest.fixture(autouse=True)
def installed() -> None:
    require("roscore")


def example(message_type: type[Message], rng: np.random.Generator) -> Message:
    """A message in which every field differs from its default, but for those that ROS 1 lacks."""
    shared = [field for field in fields_of(message_type) if field.name not in ros1_messages.ROS2_ONLY_FIELDS]
    values = {field.name: example_value(field, rng) for field in shared}
    return message_type(**values)


def example_value(field: Field, rng: np.random.Generator) -> Any:
    count = 3 if field.length == 0 else field.length
    if isinstance(field.type, type):
        one = [example(field.type, rng) for _ in range(count or 1)]
        return one[0] if count is None else tuple(one)
    if field.type == "string":
        return "text" if count is None else ("a", "b", "ü")
    if field.type == "bool":
        return True
    if field.type.startswith("float"):
        array = rng.normal(size=count or 1).astype(field.type)
    else:
        dtype = "uint8" if field.type == "byte" else field.type
        array = rng.integers(1, 100, count or 1).astype(dtype)
    return array[0].item() if count is None else array


def same(one: Any, other: Any) -> bool:
    if isinstance(one, Message):
        pairs = [(getattr(one, field.name), getattr(other, field.name)) for field in fields_of(type(one))]
        return type(one) is type(other) and all(same(*pair) for pair in pairs)
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other, equal_nan=True)
    if isinstance(one, tuple):
        return len(one) == len(other) and all(same(*pair) for pair in zip(one, other, strict=True))
    return bool(one == other)


def through_bytes(message: Message) -> Message:
    sent = ros1_messages.to_ros1(message)
    buffer = io.BytesIO()
    sent.serialize(buffer)
    received = ros1_messages.ros1_reader(type(message))()
    assert isinstance(received, type(sent))
    received.deserialize(buffer.getvalue())
    return ros1_messages.from_ros1(received, type(message))


@pytest.mark.parametrize("name", [name for name in SHARED if not name.startswith("builtin_interfaces")])
def test_every_field_of_every_message_survives_serialization(name: str) -> None:
    message = example(message_types()[name], np.random.default_rng(0))
    assert same(through_bytes(message), message)


def test_fields_that_ros1_names_differently_are_converted() -> None:
    header = ros.Header(ros.Time(12, 345), "laser")
    sent = ros1_messages.to_ros1(ros.Marker(header, lifetime=ros.Duration(1, 5)))
    assert (sent.header.stamp.secs, sent.header.stamp.nsecs, sent.header.frame_id) == (12, 345, "laser")
    assert (sent.lifetime.secs, sent.lifetime.nsecs) == (1, 5)
    assert sent._type == "visualization_msgs/Marker"


def test_nan_and_infinity_survive_serialization() -> None:
    ranges = np.array([math.nan, math.inf, -math.inf, 1.5], np.float32)
    scan = through_bytes(ros.LaserScan(ranges=ranges))
    assert isinstance(scan, ros.LaserScan)
    assert np.array_equal(scan.ranges, ranges, equal_nan=True)


def test_an_unknown_difference_to_ros1_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ros1_messages, "ROS2_ONLY_FIELDS", {"texture"})
    with pytest.raises(TypeError, match="Marker has no mesh_file, texture_resource, uv_coordinates in ROS 1"):
        ros1_messages._shared_fields(ros.Marker)


def test_rospy_does_not_shadow_packages_of_the_environment() -> None:
    code = """
from wherry.ros.transports.ros1_messages import ros1_module
ros1_module("rospy")
import numpy, yaml, sys
print(any(module.__file__.startswith("/usr/lib/python3") for module in (numpy, yaml)))
print(sys.path.index("/usr/lib/python3/dist-packages") == len(sys.path) - 1)
"""
    output = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert output == ["False", "True"]


def test_without_rospy_the_error_names_the_packages(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    monkeypatch.setattr(ros1_messages, "DEBIAN_PACKAGES", tmp_path)
    with pytest.raises(InputError, match=r"Python module no_such_module: .* apt install python3-rospy"):
        ros1_messages.ros1_module("no_such_module")
    assert str(tmp_path) not in sys.path


def test_the_error_in_another_python_version_names_debians(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    (tmp_path / "rospy").mkdir()
    (tmp_path / "python3.9").touch()
    monkeypatch.setattr(ros1_messages, "DEBIAN_PACKAGES", tmp_path)
    monkeypatch.setattr(ros1_messages, "DEBIAN_PYTHON", tmp_path / "python3.9")
    with pytest.raises(InputError, match=r"installed for python3\.9, but this is Python 3\.\d+: make the environment"):
        ros1_messages.ros1_module("no_such_module")
