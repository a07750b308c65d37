"""Bags opened with rosbags: their topics, and the messages of a topic, of one file or of all parts of a recording.

Only the definitions of the messages that wherry reads are used, and those are ROS's own: a type of another package that
cannot be parsed does not matter, and neither does what a metadata.yaml says.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import cache, partial
from heapq import merge
from pathlib import Path
from typing import Any

from wherry.errors import InputError
from wherry.ros.bags.files import ROS1_SUFFIX, RecordingFiles, storage_suffix
from wherry.ros.bags.formats import TF2_MESSAGE
from wherry.ros.bags.recovery import readable_copy, zstd
from wherry.ros.decoding import MessageError
from wherry.ros.encoding import NANOSECONDS
from wherry.ros.frame_names import shown

SCAN, ODOMETRY = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry"
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")  # the second one is of the old tf of ROS 1
MAX_REASON_LENGTH = 80  # characters shown of an error of rosbags, after which a hint must fit into the line
MAX_MESSAGE_SIZE = 100_000_000  # bytes of a message that was compressed
REPAIRS = {ROS1_SUFFIX: "rosbag reindex", ".mcap": "mcap recover", ".db3": "sqlite3's .recover"}
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"


@dataclass(frozen=True, slots=True)
class BagTopic:
    """A topic of a bag.

    Attributes:
        name: Name as it stands in the bag; old bags have names without a leading slash.
        type: Type of the messages, in the form of ROS 2.
        count: Number of messages.
    """

    name: str
    type: str
    count: int

    @property
    def absolute(self) -> str:
        """Name with a leading slash."""
        return f"/{self.name.strip('/')}"

    @property
    def namespace(self) -> tuple[str, ...]:
        """Components of the name but the last one."""
        return tuple(self.absolute.split("/")[1:-1])

    @property
    def last(self) -> str:
        """Last component of the name."""
        return self.absolute.rpartition("/")[2]

    @property
    def short_type(self) -> str:
        """Name of the type without its package."""
        return self.type.rpartition("/")[2]


@dataclass(frozen=True, slots=True)
class BagMessage:
    """A message of a bag.

    Attributes:
        name: Topic and number for errors, such as "/scan, message 1".
        received: Time at which it was recorded, s, recorder's clock.
        decode: Deserializes the message; raises a `MessageError` if it is damaged.
    """

    name: str
    received: float
    decode: Callable[[], Any]


@dataclass(frozen=True)
class OpenBag:
    """A recording that is open.

    Attributes:
        path: Path of the recording as the user gave it, for errors.
        readers: Readers of rosbags, one for each file.
        is_ros1: Whether it is of ROS 1.
        types: rosbags' typestore with ROS's own definitions.
        topics: All topics in the order of their names.
    """

    path: Path
    readers: Sequence[Any]
    is_ros1: bool
    types: Any
    topics: tuple[BagTopic, ...] = field(init=False)

    def __post_init__(self) -> None:
        counts: Counter[tuple[str, str]] = Counter()
        for reader in self.readers:
            for entry in reader.connections:
                if not isinstance(entry.topic, str) or not isinstance(entry.msgtype, str):
                    raise InputError(self.path, "", "is damaged: a topic has no name or no type")
                counts[entry.topic, entry.msgtype] += entry.msgcount
        topics = tuple(BagTopic(name, kind, count) for (name, kind), count in sorted(counts.items()))
        object.__setattr__(self, "topics", topics)

    def messages(self, topic: BagTopic) -> Iterator[BagMessage]:
        """The messages of a topic in the order of their recording.

        Raises:
            InputError: The bag is damaged, or defines the type of the topic otherwise than ROS does.
        """
        number = 0
        try:
            parts = [self._part(reader, topic) for reader in self.readers]
            for number, (received, raw) in enumerate(merge(*parts, key=lambda item: item[0]), start=1):
                name = f"{shown(topic.name)}, message {number}"
                yield BagMessage(name, received / NANOSECONDS, partial(self._deserialize, raw, topic.type))
        except InputError:
            raise
        except Exception as error:  # rosbags raises errors of many types on damaged bags
            name = f"{shown(topic.name)}, message {number + 1}"
            raise InputError(self.path, name, f"the bag is damaged here: {first_line(error)}") from error

    def _part(self, reader: Any, topic: BagTopic) -> Iterator[tuple[int, bytes]]:
        """Times, ns, and contents of the messages of a topic in one file."""
        connections = [
            entry for entry in reader.connections if (entry.topic, entry.msgtype) == (topic.name, topic.type)
        ]
        for connection in connections:
            self._check_definition(connection)
        if connections:
            for _, received, raw in reader.messages(connections=connections):
                yield received, raw

    def _check_definition(self, connection: Any) -> None:
        """Refuse messages that are serialized or defined otherwise than those of ROS.

        Raises:
            InputError: They are.
        """
        if self.is_ros1:
            own = self.types.generate_msgdef(connection.msgtype)[1]
            same = connection.digest in ("", "*", own)
        else:
            encoding = connection.ext.serialization_format
            if encoding != "cdr":
                reason = f"is serialized as {shown(encoding)!r} instead of 'cdr'; rosbags-convert converts ROS 1 bags"
                raise InputError(self.path, shown(connection.topic), reason)
            is_hash = connection.digest.startswith("RIHS01_")
            same = not is_hash or connection.digest == self.types.hash_rihs01(connection.msgtype)
        if not same:
            reason = f"its {connection.msgtype} is defined otherwise than that of ROS"
            raise InputError(self.path, shown(connection.topic), reason)

    def _deserialize(self, raw: bytes, kind: str) -> Any:
        try:
            if self.is_ros1:
                return self.types.deserialize_ros1(raw, kind)
            if raw[:4] == ZSTD_MAGIC:
                raw = zstd().ZstdDecompressor().decompress(raw, MAX_MESSAGE_SIZE)
            return self.types.deserialize_cdr(raw, kind)
        except Exception as error:  # of many types, as in `messages`
            raise MessageError(f"is damaged: {first_line(error)}") from error


@contextmanager
def open_bag(path: Path, files: Sequence[Path]) -> Iterator[OpenBag]:
    """Open the files of a recording.

    Args:
        path: Path of the recording as the user gave it, for errors.
        files: As `RecordingFiles.files`.

    Raises:
        InputError: rosbags is not installed, or a file cannot be read or is damaged.
    """
    try:
        from rosbags import rosbag1, rosbag2  # noqa: PLC0415 - optional
    except ImportError as error:
        raise InputError(path, "", "is a ROS bag: pip install 'wherry[bags]' to read it") from error
    is_ros1 = storage_suffix(files[0]) == ROS1_SUFFIX
    with ExitStack() as stack:
        readers: list[Any] = []
        for file in files:
            try:
                plain = readable_copy(file, stack)
                reader: Any = rosbag1.Reader(plain) if is_ros1 else rosbag2.Reader(plain)
                stack.enter_context(reader)
            except Exception as error:  # of many types on damaged bags
                which = "" if len(files) == 1 else file.name
                reason = f"is not a bag that can be read: {first_line(error).rstrip('.')}{_repair_hint(file)}"
                raise InputError(path, which, reason) from error
            readers.append(reader)
        yield OpenBag(path, readers, is_ros1, _typestore(is_ros1=is_ros1))


@contextmanager
def open_other_parts(path: Path, recording: RecordingFiles) -> Iterator[OpenBag | None]:
    """Open the other parts of a split recording; None if there are none, or one cannot be read."""
    with ExitStack() as stack:
        bag = None
        if recording.other_parts:
            try:
                bag = stack.enter_context(open_bag(path, recording.other_parts))
            except InputError:
                bag = None  # the error about the missing transforms says what to do
        yield bag


def _repair_hint(file: Path) -> str:
    """How a damaged file may be repaired, as part of an error message."""
    tool = REPAIRS.get(storage_suffix(file))
    return f"; {tool} may repair it" if tool and file.is_file() and file.stat().st_size else ""


def first_line(error: Exception) -> str:
    """The first line of an error's text."""
    lines = str(error).splitlines()
    return (lines[0] if lines else type(error).__name__)[:MAX_REASON_LENGTH]


@cache
def _typestore(*, is_ros1: bool) -> Any:
    """ROS's own message definitions."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415 - optional

    if not is_ros1:
        return get_typestore(Stores.LATEST)
    types = get_typestore(Stores.ROS1_NOETIC)
    for name in TRANSFORMS:
        types.register(get_types_from_msg(TF2_MESSAGE, name))
    return types
