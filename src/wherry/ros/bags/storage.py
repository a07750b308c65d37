"""How bags lie on the disk, by rosbags: as rosbag's file, as rosbag2's folder with SQLite, or as its one MCAP file.

What a storage has been told to save is there even if the process is killed by force.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from os import SEEK_CUR, SEEK_END
from pathlib import Path
from struct import Struct
from types import SimpleNamespace
from typing import Any, BinaryIO, Protocol

from wherry.ros import messages as ros
from wherry.ros.messages import Header, Message, cached, fields_of
from wherry.ros.transports.transport import Quality, Topic

ROS1_MAGIC = b"#ROSBAG V2.0\n"
NUMBER = Struct("<L")
HEADER_SHORTAGE = 8  # bytes
TF2_MESSAGE = "geometry_msgs/TransformStamped[] transforms\n"  # rosbags' types of ROS 1 lack it


class Storage(Protocol):
    """A kind of bag."""

    def connect(self, topic: Topic[Any]) -> Any:
        """Open a topic."""
        ...

    def write(self, connection: Any, message: Message, nanoseconds: int) -> None:
        """Add a message."""
        ...

    def save(self) -> None:
        """Hand over to the system what was added; not to the disk, for nothing waits until that has it."""
        ...

    def close(self) -> None:
        """Write what makes it a whole bag."""
        ...

    @property
    def finished(self) -> Path:
        """Where the whole bag is then."""
        ...


class Ros1Bag:
    """A file of format 2.0, as rosbag writes it."""

    def __init__(self, path: Path, unfinished: Path) -> None:
        from rosbags.rosbag1 import Writer  # noqa: PLC0415 - optional
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415

        self._types = get_typestore(Stores.ROS1_NOETIC)
        self._types.register(get_types_from_msg(TF2_MESSAGE, ros.TFMessage.type_name))
        self._numbers: dict[Any, int] = {}
        self._writer = Writer(unfinished)
        self._writer.open()
        self._file.flush()
        _lengthen_header(unfinished)
        self._file.seek(0, SEEK_END)
        self.finished = unfinished

    @property
    def _file(self) -> BinaryIO:
        """What rosbags writes to."""
        file: BinaryIO | None = self._writer.bio
        assert file is not None  # noqa: S101 - it is open
        return file

    def connect(self, topic: Topic[Any]) -> Any:
        """As `Storage.connect`."""
        latching = int(topic.quality is Quality.LATCHED)
        kind = topic.message_type.type_name
        return self._writer.add_connection(topic.name, kind, typestore=self._types, latching=latching)

    def write(self, connection: Any, message: Message, nanoseconds: int) -> None:
        """As `Storage.write`."""
        number = self._numbers.get(connection.id, 0)
        self._numbers[connection.id] = number + 1
        numbered = self._numbered(message, number)
        self._writer.write(connection, nanoseconds, self._types.serialize_ros1(numbered, message.type_name))

    def save(self) -> None:
        """As `Storage.save`."""
        self._writer.write_chunk(self._writer.chunks[-1])
        self._file.flush()

    def close(self) -> None:
        """As `Storage.close`."""
        self._writer.close()
        _lengthen_header(self.finished)

    def _numbered(self, message: Any, number: int) -> Any:
        """The message with ROS 1's sequence numbers in its headers."""
        if isinstance(message, Header):
            return SimpleNamespace(seq=number, stamp=message.stamp, frame_id=message.frame_id)
        if isinstance(message, tuple):
            return [self._numbered(element, number) for element in message]
        if not isinstance(message, Message) or not _has_header(type(message)):
            return message
        names = (field.name for field in fields_of(type(message)))
        return SimpleNamespace(**{name: self._numbered(getattr(message, name), number) for name in names})


def _lengthen_header(path: Path) -> None:
    """Make a bag's first record as long as rosbag's own; rosbags' is 8 bytes shorter.

    ``rosbag reindex`` writes that record anew, and would write over the beginning of what comes next.
    """
    with path.open("r+b") as file:
        file.seek(len(ROS1_MAGIC))
        file.seek(_number(file), SEEK_CUR)  # past the record's header
        padding = _number(file)
        file.seek(-NUMBER.size, SEEK_CUR)
        file.write(NUMBER.pack(padding + HEADER_SHORTAGE))
        file.seek(padding, SEEK_CUR)
        file.write(b" " * HEADER_SHORTAGE)


def _number(file: BinaryIO) -> int:
    """The next number in a ROS 1 bag."""
    number: int = NUMBER.unpack(file.read(NUMBER.size))[0]
    return number


@cached
def _has_header(message_type: type[Message]) -> bool:
    """Whether there is a header anywhere in messages of a type."""
    kinds = [field.kind for field in fields_of(message_type) if not isinstance(field.kind, str)]
    return any(kind is Header or _has_header(kind) for kind in kinds)


class Ros2Bag(ABC):
    """A bag as rosbag2 writes it; message definitions are in it.

    Args:
        folder: Where to.
        plugin: The kind of storage, of rosbags' `StoragePlugin`.
    """

    finished: Path

    def __init__(self, folder: Path, plugin: str) -> None:
        from rosbags.rosbag2 import StoragePlugin, Writer  # noqa: PLC0415 - optional
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415

        self._types = get_typestore(Stores.ROS2_JAZZY)
        self._writer = Writer(folder, version=9, storage_plugin=StoragePlugin[plugin])
        self._writer.open()
        self._file: Any = self._writer.storage

    def connect(self, topic: Topic[Any]) -> Any:
        """As `Storage.connect`."""
        kind = topic.message_type.type_name
        return self._writer.add_connection(topic.name, kind, typestore=self._types, offered_qos_profiles=[_qos(topic)])

    def write(self, connection: Any, message: Message, nanoseconds: int) -> None:
        """As `Storage.write`."""
        self._writer.write(connection, nanoseconds, self._types.serialize_cdr(message, message.type_name))

    @abstractmethod
    def save(self) -> None:
        """As `Storage.save`."""

    def close(self) -> None:
        """As `Storage.close`."""
        self._writer.close()


class McapFile(Ros2Bag):
    """The one MCAP file out of a ROS 2 bag's folder."""

    def __init__(self, path: Path, unfinished: Path) -> None:
        folder = unfinished / path.stem
        super().__init__(folder, "MCAP")
        self.finished = folder / f"{folder.name}.mcap"

    def save(self) -> None:
        """As `Storage.save`."""
        if self._file.chunk.bio.tell():
            self._file.close_chunk()
        self._file.bio.flush()


class SqliteFolder(Ros2Bag):
    """A ROS 2 bag's folder with SQLite in it."""

    def __init__(self, path: Path, unfinished: Path) -> None:
        self.finished = unfinished / path.name
        super().__init__(self.finished, "SQLITE3")
        self._file.conn.execute("PRAGMA synchronous = OFF")

    def save(self) -> None:
        """As `Storage.save`."""
        self._file.conn.commit()


def _qos(topic: Topic[Any]) -> Any:
    """A topic's QoS as rosbag2 keeps it, so that a replay offers the same."""
    from rosbags.interfaces import (  # noqa: PLC0415 - optional
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    never = QosTime(sec=0, nsec=0)
    latched, best_effort = topic.quality is Quality.LATCHED, topic.quality is Quality.SENSOR
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=1 if latched else 10,
        reliability=QosReliability.BEST_EFFORT if best_effort else QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
        deadline=never,
        lifespan=never,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=never,
        avoid_ros_namespace_conventions=False,
    )


FORMATS: Mapping[str, Callable[[Path, Path], Storage]] = {
    ".bag": Ros1Bag,
    ".mcap": McapFile,
    "": SqliteFolder,
}
"""By the path's suffix: ROS 1, ROS 2 as one MCAP file, ROS 2 as a folder with SQLite, which every ROS 2 reads."""
