"""Cyclone DDS's message classes: generated from ours, and converting our messages to them and back.

The DDS type of ``sensor_msgs/msg/LaserScan`` is ``sensor_msgs::msg::dds_::LaserScan_``, serialized as plain CDR.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType, new_class
from typing import Any

import numpy as np
from cyclonedds.idl import IdlStruct, types
from cyclonedds.idl.annotations import autoid, final

from wherry.ros.message_fields import ARRAY_TYPES, Field, Message, MessageT, cached, fields_of

IDL_TYPES: Mapping[str, Any] = MappingProxyType(
    {
        "bool": bool,
        "byte": types.uint8,
        "string": str,
        **{name: getattr(types, name) for name in ("uint8", "int8", "int32", "uint32", "float32", "float64")},
    }
)
"""Cyclone DDS's types of ROS's primitives."""


@cached
def idl_class(message_type: type[Message]) -> Any:
    """The Cyclone DDS class of a message class: the same fields, and the type name that ROS 2 uses on the wire."""
    package, _, name = message_type.type_name.split("/")
    annotations = {entry.name: _idl_type(entry) for entry in fields_of(message_type)}
    members = {"__annotations__": annotations, "__module__": __name__}
    created = new_class(
        name, (IdlStruct,), {"typename": f"{package}.msg.dds_.{name}_"}, lambda body: body.update(members)
    )
    finished: Any = dataclass(created)
    for annotate in (autoid("sequential"), final):
        finished = annotate(finished)
    return finished


def _idl_type(entry: Field) -> Any:
    inner = IDL_TYPES[entry.type] if isinstance(entry.type, str) else idl_class(entry.type)
    if entry.length is None:
        return inner
    sequence: Any = types.sequence
    array: Any = types.array
    return sequence[inner] if entry.length == 0 else array[inner, entry.length]


def to_idl(message: Message) -> Any:
    """Convert a message to its `idl_class`."""
    message_type = type(message)
    values = [_value_to_idl(entry, getattr(message, entry.name)) for entry in fields_of(message_type)]
    return idl_class(message_type)(*values)


def _value_to_idl(entry: Field, value: Any) -> Any:
    if isinstance(entry.type, str):
        return value.tolist() if isinstance(value, np.ndarray) else value
    return to_idl(value) if entry.length is None else [to_idl(item) for item in value]


def from_idl(message_type: type[MessageT], sample: Any) -> MessageT:
    """Convert a sample of the `idl_class` of a message class."""
    return message_type(*(_value_from_idl(entry, getattr(sample, entry.name)) for entry in fields_of(message_type)))


def _value_from_idl(entry: Field, value: Any) -> Any:
    if not isinstance(entry.type, str):
        inner = entry.type
        return from_idl(inner, value) if entry.length is None else tuple(from_idl(inner, item) for item in value)
    if entry.length is None:
        return value
    return tuple(value) if entry.type == "string" else np.array(value, ARRAY_TYPES[entry.type])
