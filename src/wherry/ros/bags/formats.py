"""The formats of bags, written with rosbags: ROS 1's file, ROS 2's folder with SQLite, and a single MCAP file.

Everything that was flushed survives when the process is killed.
"""

from __future__ import annotations

import sqlite3
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from os import SEEK_CUR, SEEK_END
from pathlib import Path
from struct import Struct
from types import SimpleNamespace
from typing import Any, BinaryIO, Protocol, cast

from wherry.ros import messages as ros
from wherry.ros.message_fields import Message, cached, fields_of
from wherry.ros.messages import Header
from wherry.ros.topics import QosProfile, Topic

ROS1_MAGIC = b"#ROSBAG V2.0\n"
UINT32 = Struct("<L")
MISSING_PADDING = 8  # bytes by which rosbags' bag header record is shorter than rosbag's
TF2_MESSAGE = "geometry_msgs/TransformStamped[] transforms\n"  # missing among rosbags' ROS 1 types


class BagFormat(Protocol):
    """A bag that is being written, in one of the formats."""

    def connect(self, topic: Topic[Any]) -> Any:
        """Add a topic; the result is given to `write`."""
        ...

    def write(self, connection: Any, message: Message, nanoseconds: int) -> None:
        """Add a message."""
        ...

    def flush(self) -> None:
        """Hand buffered messages to the operating system, without waiting until they are on the disk."""
        ...

    def close(self) -> None:
        """Complete the bag."""
        ...

    @property
    def finished_path(self) -> Path:
        """Path of the complete bag after `close`."""
        ...


class Ros1Bag:
    """A file of rosbag's format 2.0."""

    def __init__(self, path: Path, unfinished_path: Path) -> None:
        from rosbags.rosbag1 import Writer  # noqa: PLC0415 - optional
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415

        self._types = get_typestore(Stores.ROS1_NOETIC)
        self._types.register(get_types_from_msg(TF2_MESSAGE, ros.TFMessage.type_name))
        self._counts: dict[Any, int] = {}
        self._writer = Writer(unfinished_path)
        self._writer.open()
        self._file.flush()
        _pad_header(unfinished_path)
        self._file.seek(0, SEEK_END)
        self.finished_path = unfinished_path

    @property
    def _file(self) -> BinaryIO:
        """The file that rosbags writes to."""
        return cast(BinaryIO, self._writer.bio)  # None only before `open`

    def connect(self, topic: Topic[Any]) -> Any:
        """As `BagFormat.connect`."""
        latching = int(topic.qos is QosProfile.LATCHED)
        type_name = topic.message_type.type_name
        return self._writer.add_connection(topic.name, type_name, typestore=self._types, latching=latching)

    def write(self, connection: Any, message: Message, nanoseconds: int) -> None:
        """As `BagFormat.write`."""
        count = self._counts.get(connection.id, 0)
        self._counts[connection.id] = count + 1
        numbered = self._numbered(message, count)
        self._writer.write(connection, nanoseconds, self._types.serialize_ros1(numbered, message.type_name))

    def flush(self) -> None:
        """As `BagFormat.flush`."""
        self._writer.write_chunk(self._writer.chunks[-1])
        self._file.flush()

    def close(self) -> None:
        """As `BagFormat.close`."""
        self._writer.close()
        _pad_header(self.finished_path)

    def _numbered(self, message: Any, count: int) -> Any:
        """The message with ROS 1's sequence number in all of its headers."""
        if isinstance(message, Header):
            return SimpleNamespace(seq=count, stamp=message.stamp, frame_id=message.frame_id)
        if isinstance(message, tuple):
            return [self._numbered(element, count) for element in message]
        if not isinstance(message, Message) or not _has_header(type(message)):
            return message
        names = (field.name for field in fields_of(type(message)))
        return SimpleNamespace(**{name: self._numbered(getattr(message, name), count) for name in names})


def _pad_header(path: Path) -> None:
    """Pad a bag's first record to the length that rosbag gives it.

    ``rosbag reindex`` rewrites that record in place, and would overwrite the beginning of the next one.
    """
    with path.open("r+b") as file:
        file.seek(len(ROS1_MAGIC))
        file.seek(_read_uint32(file), SEEK_CUR)  # past the record's header
        padding = _read_uint32(file)
        file.seek(-UINT32.size, SEEK_CUR)
        file.write(UINT32.pack(padding + MISSING_PADDING))
        file.seek(padding, SEEK_CUR)
        file.write(b" " * MISSING_PADDING)


def _read_uint32(file: BinaryIO) -> int:
    """Read the next number of a ROS 1 bag."""
    number: int = UINT32.unpack(file.read(UINT32.size))[0]
    return number


@cached
def _has_header(message_type: type[Message]) -> bool:
    """Whether messages of a class contain a header at any depth."""
    nested = [field.type for field in fields_of(message_type) if not isinstance(field.type, str)]
    return any(inner is Header or _has_header(inner) for inner in nested)


class Ros2Bag(ABC):
    """A bag of rosbag2's format, with the message definitions in it.

    Args:
        folder: Folder to write to.
        plugin: Name of a member of rosbags' `StoragePlugin`.
    """

    finished_path: Path

    def __init__(self, folder: Path, plugin: str) -> None:
        from rosbags.rosbag2 import StoragePlugin, Writer  # noqa: PLC0415 - optional
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415

        self._types = get_typestore(Stores.ROS2_JAZZY)
        self._writer = Writer(folder, version=9, storage_plugin=StoragePlugin[plugin])
        self._writer.open()
        self._file: Any = self._writer.storage

    def connect(self, topic: Topic[Any]) -> Any:
        """As `BagFormat.connect`."""
        type_name = topic.message_type.type_name
        return self._writer.add_connection(
            topic.name, type_name, typestore=self._types, offered_qos_profiles=[_qos(topic)]
        )

    def write(self, connection: Any, message: Message, nanoseconds: int) -> None:
        """As `BagFormat.write`."""
        self._writer.write(connection, nanoseconds, self._types.serialize_cdr(message, message.type_name))

    @abstractmethod
    def flush(self) -> None:
        """As `BagFormat.flush`."""

    def close(self) -> None:
        """As `BagFormat.close`."""
        self._writer.close()


class McapBag(Ros2Bag):
    """A single MCAP file, moved out of the folder in which rosbag2 keeps it."""

    def __init__(self, path: Path, unfinished_path: Path) -> None:
        folder = unfinished_path / path.stem
        super().__init__(folder, "MCAP")
        self.finished_path = folder / f"{folder.name}.mcap"

    def flush(self) -> None:
        """As `BagFormat.flush`."""
        if self._file.chunk.bio.tell():
            self._file.close_chunk()
        self._file.bio.flush()


class SqliteBag(Ros2Bag):
    """A folder with an SQLite database, as rosbag2 writes it; one thread at a time may write, whichever it is."""

    def __init__(self, path: Path, unfinished_path: Path) -> None:
        self.finished_path = unfinished_path / path.name
        super().__init__(self.finished_path, "SQLITE3")
        self._file.conn.close()  # rosbags' connection belongs to the thread that opened it
        self._file.conn = sqlite3.connect(self._file.path, check_same_thread=False)
        self._file.cursor = self._file.conn.cursor()
        self._file.conn.execute("PRAGMA synchronous = OFF")

    def flush(self) -> None:
        """As `BagFormat.flush`."""
        self._file.conn.commit()


def _qos(topic: Topic[Any]) -> Any:
    """A topic's QoS in rosbag2's metadata, so that a replay offers the same."""
    from rosbags.interfaces import (  # noqa: PLC0415 - optional
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    unset = QosTime(sec=0, nsec=0)
    is_latched, is_best_effort = topic.qos is QosProfile.LATCHED, topic.qos is QosProfile.SENSOR
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=1 if is_latched else 10,
        reliability=QosReliability.BEST_EFFORT if is_best_effort else QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL if is_latched else QosDurability.VOLATILE,
        deadline=unset,
        lifespan=unset,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=unset,
        avoid_ros_namespace_conventions=False,
    )


FORMATS: Mapping[str, Callable[[Path, Path], BagFormat]] = {
    ".bag": Ros1Bag,
    ".mcap": McapBag,
    "": SqliteBag,
}
"""By suffix of the path: ROS 1; ROS 2 as a single MCAP file; ROS 2 as a folder with SQLite, which every ROS 2 reads."""
