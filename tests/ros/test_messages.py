"""Our message classes against the real definitions of ROS 1 and ROS 2."""

from __future__ import annotations

import pytest
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from wherry.ros.message_fields import Field, Message, fields_of
from wherry.ros.messages import Marker, message_types

TYPES = message_types()
ROS2_ONLY = {"visualization_msgs/msg/MeshFile", "visualization_msgs/msg/UVCoordinate"}
ROS2_MARKER_FIELDS = {"texture_resource", "texture", "uv_coordinates", "mesh_file"}


def described(message_type: type[Message]) -> list[tuple[str, str, int | None]]:
    """Name, type and length of the fields of our class."""

    def kind(entry: Field) -> str:
        return entry.type if isinstance(entry.type, str) else entry.type.type_name

    return [(entry.name, kind(entry), entry.length) for entry in fields_of(message_type)]


def defined(store: Typestore, type_name: str) -> list[tuple[str, str, int | None]]:
    """Name, type and length of the fields of the real definition."""
    found = []
    for name, (node, detail) in store.fielddefs[type_name][1]:
        if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            (inner, kind), length = detail
            found.append((name, kind[0] if inner is Nodetype.BASE else kind, length))
        else:
            found.append((name, detail[0] if node is Nodetype.BASE else detail, None))
    return found


@pytest.mark.parametrize("type_name", sorted(TYPES))
@pytest.mark.parametrize("store", [Stores.ROS2_HUMBLE, Stores.ROS2_JAZZY, Stores.ROS2_KILTED], ids=lambda s: s.value)
def test_fields_are_those_of_ros_2(type_name: str, store: Stores) -> None:
    assert described(TYPES[type_name]) == defined(get_typestore(store), type_name)


@pytest.mark.parametrize("type_name", sorted(TYPES.keys() - ROS2_ONLY))
def test_fields_are_those_of_ros_1_except_for_known_differences(type_name: str) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms\n", "tf2_msgs/msg/TFMessage"))
    ours = [entry for entry in described(TYPES[type_name]) if entry[0] not in ROS2_MARKER_FIELDS]
    theirs = [entry for entry in defined(store, type_name) if (type_name, entry[0]) != ("std_msgs/msg/Header", "seq")]
    assert ours == theirs


@pytest.mark.parametrize("type_name", sorted(TYPES))
def test_constants_have_the_real_values(type_name: str) -> None:
    real = {name: value for name, _, value in get_typestore(Stores.ROS2_JAZZY).fielddefs[type_name][0]}
    ours = {name: value for name, value in vars(TYPES[type_name]).items() if name.isupper()}
    assert ours.items() <= real.items()
    assert ours or not issubclass(TYPES[type_name], Marker)


@pytest.mark.parametrize("type_name", sorted(TYPES))
def test_every_message_has_defaults(type_name: str) -> None:
    for entry in fields_of(TYPES[type_name]):
        value = getattr(TYPES[type_name](), entry.name)
        if entry.length is not None:
            assert len(value) == entry.length
        elif not isinstance(entry.type, str):
            assert isinstance(value, entry.type)
