"""The fields of message classes: names, types and order of serialization.

A message class is a frozen dataclass whose annotations carry the ROS type (`Float32`, `UInt32`, …). `fields_of` reads
them once per class; transports and bags convert any message field by field with the result.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import cache
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, TypeVar, cast, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class RosType:
    """The ROS type of a field, attached to its annotation.

    Attributes:
        type: Name of the primitive in ROS's .msg files, such as "float64".
        length: None for one value, 0 for a sequence of any length, otherwise the length of the fixed-size array.
    """

    type: str
    length: int | None = None


Int32 = Annotated[int, RosType("int32")]
UInt32 = Annotated[int, RosType("uint32")]
UInt8 = Annotated[int, RosType("uint8")]
Byte = Annotated[int, RosType("byte")]
Float32 = Annotated[float, RosType("float32")]
Float64 = Annotated[float, RosType("float64")]
Text = Annotated[str, RosType("string")]
Flag = Annotated[bool, RosType("bool")]
Texts = Annotated[tuple[str, ...], RosType("string", 0)]
Bytes = Annotated[NDArray[np.uint8], RosType("uint8", 0)]
Int8s = Annotated[NDArray[np.int8], RosType("int8", 0)]
Float32s = Annotated[NDArray[np.float32], RosType("float32", 0)]
Float64s = Annotated[NDArray[np.float64], RosType("float64", 0)]
Covariance = Annotated[NDArray[np.float64], RosType("float64", 36)]

ARRAY_TYPES: Mapping[str, Any] = MappingProxyType(
    {"uint8": np.uint8, "int8": np.int8, "float32": np.float32, "float64": np.float64}
)
"""NumPy type of the arrays that hold sequences of a primitive."""


class Message:
    """Base class of all messages.

    Attributes:
        type_name: ROS 2's name of the type, such as "sensor_msgs/msg/LaserScan".
    """

    type_name: ClassVar[str]


MessageT = TypeVar("MessageT", bound=Message)
F = TypeVar("F", bound=Callable[..., Any])


def cached(function: F) -> F:
    """`functools.cache` that keeps the function's type; mypy takes message classes for unhashable."""
    return cast(F, cache(function))


@dataclass(frozen=True, slots=True)
class Field:
    """One field of a message class.

    Attributes:
        name: Name of the field.
        type: Name of a primitive, such as "float64", or the class of a nested message.
        length: None for one value, 0 for a sequence of any length, otherwise the length of the fixed-size array.
    """

    name: str
    type: str | type[Message]
    length: int | None


@cached
def fields_of(message_type: type[Message]) -> tuple[Field, ...]:
    """The fields of a message class in the order in which they are serialized."""
    hints = get_type_hints(message_type, include_extras=True)
    return tuple(_field(entry.name, hints[entry.name]) for entry in fields(message_type))  # type: ignore[arg-type]


def _field(name: str, hint: Any) -> Field:
    if get_origin(hint) is Annotated:
        ros_type: RosType = get_args(hint)[1]
        return Field(name, ros_type.type, ros_type.length)
    if get_origin(hint) is tuple:
        return Field(name, get_args(hint)[0], 0)
    return Field(name, hint, None)
