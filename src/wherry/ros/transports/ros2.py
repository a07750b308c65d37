"""ROS 2 without a ROS install: its topics are DDS topics, and Eclipse Cyclone DDS comes from PyPI (``wherry[ros2]``).

A topic ``/scan`` of ``sensor_msgs/msg/LaserScan`` is the DDS topic ``rt/scan`` of the type
``sensor_msgs::msg::dds_::LaserScan_``, serialized as plain CDR. The classes that Cyclone DDS needs are made from those
in `wherry.ros.messages`.
"""

from __future__ import annotations

import os
import socket
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType, TracebackType, new_class
from typing import Any, Self
from xml.sax.saxutils import quoteattr

import numpy as np

from wherry.errors import InputError
from wherry.ros.messages import ARRAY_TYPES, Field, M, Message, cached, fields_of
from wherry.ros.transports.transport import Quality, Topic

try:
    from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription
    from cyclonedds.core import (
        GuardCondition,
        InstanceState,
        Policy,
        Qos,
        ReadCondition,
        SampleState,
        ViewState,
        WaitSet,
    )
    from cyclonedds.domain import Domain, DomainParticipant
    from cyclonedds.idl import IdlStruct, types
    from cyclonedds.idl.annotations import autoid, final
    from cyclonedds.pub import DataWriter
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic as DdsTopic
except ImportError as error:
    raise InputError("ROS 2", "cyclonedds", "is not installed: pip install 'wherry[ros2]'") from error

LOOPBACK = "lo"
HIGHEST_DOMAIN = 232  # above it, DDS runs out of ports
FIRST_PORT, PORTS = 7400, 250  # UDP, of domain 0, and how many each domain has (the DDS wire protocol, 9.6.1)
MOST_PARTICIPANTS = 60  # on one machine, that are looked for without multicast
LARGEST_TAKE = 100  # messages at a time
MOST_ENDPOINTS = 10_000
MILLISECOND = 1_000_000  # ns
LONGEST_BLOCK = 50 * MILLISECOND  # that a slow listener may hold up a publisher
DEPTHS = MappingProxyType({Quality.SENSOR: 10, Quality.RELIABLE: 100, Quality.LATCHED: 1})  # messages kept to resend
READ_DEPTH = 100  # messages kept until they are read

IDL_TYPES: Mapping[str, Any] = MappingProxyType(
    {
        "bool": bool,
        "byte": types.uint8,
        "string": str,
        **{kind: getattr(types, kind) for kind in ("uint8", "int8", "int32", "uint32", "float32", "float64")},
    }
)


@cached
def idl_class(message_type: type[Message]) -> Any:
    """The Cyclone DDS class of a message type: same fields, and the names that ROS 2 gives them on the wire."""
    package, _, name = message_type.type_name.split("/")
    annotations = {entry.name: _idl_type(entry) for entry in fields_of(message_type)}
    members = {"__annotations__": annotations, "__module__": __name__}
    made = new_class(name, (IdlStruct,), {"typename": f"{package}.msg.dds_.{name}_"}, lambda body: body.update(members))
    finished: Any = dataclass(made)
    for annotate in (autoid("sequential"), final):
        finished = annotate(finished)
    return finished


def _idl_type(entry: Field) -> Any:
    inner = IDL_TYPES[entry.kind] if isinstance(entry.kind, str) else idl_class(entry.kind)
    if entry.length is None:
        return inner
    sequence: Any = types.sequence
    array: Any = types.array
    return sequence[inner] if entry.length == 0 else array[inner, entry.length]


def to_idl(message: Message) -> Any:
    """A message as its `idl_class`."""
    message_type = type(message)
    values = [_value_to_idl(entry, getattr(message, entry.name)) for entry in fields_of(message_type)]
    return idl_class(message_type)(*values)


def _value_to_idl(entry: Field, value: Any) -> Any:
    if isinstance(entry.kind, str):
        return value.tolist() if isinstance(value, np.ndarray) else value
    return to_idl(value) if entry.length is None else [to_idl(item) for item in value]


def from_idl(message_type: type[M], sample: Any) -> M:
    """The message that a sample of its `idl_class` holds."""
    return message_type(*(_value_from_idl(entry, getattr(sample, entry.name)) for entry in fields_of(message_type)))


def _value_from_idl(entry: Field, value: Any) -> Any:
    kind = entry.kind
    if isinstance(kind, str):
        if entry.length is None:
            return value
        return tuple(value) if kind == "string" else np.array(value, ARRAY_TYPES[kind])
    return from_idl(kind, value) if entry.length is None else tuple(from_idl(kind, item) for item in value)


def domain_id() -> int:
    """ROS_DOMAIN_ID, 0 if it is not set.

    Raises:
        InputError: It is no number from 0 to 232.
    """
    text = os.environ.get("ROS_DOMAIN_ID", "") or "0"
    if not text.isascii() or not text.isdigit() or int(text) > HIGHEST_DOMAIN:
        raise InputError("ROS_DOMAIN_ID", text, f"is no whole number from 0 to {HIGHEST_DOMAIN}")
    return int(text)


def configuration(interface: str) -> str:
    """Cyclone DDS's configuration: this machine alone on the loopback interface, a whole network on any other."""
    general = f"<Interfaces><NetworkInterface name={quoteattr(interface)}/></Interfaces>"
    discovery = f"<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>{MOST_PARTICIPANTS}"
    discovery += "</MaxAutoParticipantIndex>"
    if interface == LOOPBACK:
        general += "<AllowMulticast>false</AllowMulticast>"
        discovery += '<Peers><Peer address="127.0.0.1"/></Peers>'
    return f"<CycloneDDS><Domain><General>{general}</General><Discovery>{discovery}</Discovery></Domain></CycloneDDS>"


@cache
def _domain(number: int, interface: str) -> Domain:
    """A process has one of each number, for as long as it runs."""
    domain = Domain(number, configuration(interface))
    if interface == LOOPBACK:
        _close_to_outside(number)
    return domain


def _close_to_outside(number: int) -> None:
    """Let nothing in from a network: Cyclone DDS sends by its interface alone, but listens on all of them.

    Raises:
        OSError: The system does not allow it (Linux before 5.7, without CAP_NET_RAW).
    """
    ports = range(FIRST_PORT + PORTS * number, FIRST_PORT + PORTS * (number + 1))
    for listener in _own_sockets():
        with listener:
            if listener.type == socket.SOCK_DGRAM and listener.getsockname()[1] in ports:
                listener.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, LOOPBACK.encode())


def _own_sockets() -> Iterator[socket.socket]:
    """Copies of all of this process's internet sockets."""
    for name in os.listdir("/proc/self/fd"):  # noqa: PTH208 - the names are numbers
        try:
            copy = socket.socket(fileno=os.dup(int(name)))
        except OSError:
            continue  # no socket, or closed since it was listed
        if copy.family in (socket.AF_INET, socket.AF_INET6):
            yield copy
        else:
            copy.close()


def _writer_qos(quality: Quality) -> Qos:
    """Reliable, which every listener accepts; a slow one never holds the robot up for long."""
    return Qos(
        Policy.Reliability.Reliable(LONGEST_BLOCK),
        Policy.Durability.TransientLocal if quality is Quality.LATCHED else Policy.Durability.Volatile,
        Policy.History.KeepLast(DEPTHS[quality]),
        Policy.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False),
    )


def _reader_qos(quality: Quality) -> Qos:
    """What ROS's own nodes ask for: best effort of sensors, so that every driver's messages are accepted."""
    best_effort = quality is Quality.SENSOR
    return Qos(
        Policy.Reliability.BestEffort if best_effort else Policy.Reliability.Reliable(LONGEST_BLOCK),
        Policy.Durability.TransientLocal if quality is Quality.LATCHED else Policy.Durability.Volatile,
        Policy.History.KeepLast(READ_DEPTH),
        Policy.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False),
    )


class DdsTransport:
    """ROS 2 as a `Transport`.

    Args:
        interface: The network interface to use: loopback, which leaves this machine out of every network, or another.

    Raises:
        InputError: ROS_DOMAIN_ID is wrong, or DDS cannot use the interface.
    """

    generation = 2

    def __init__(self, interface: str = LOOPBACK) -> None:
        number = domain_id()
        try:
            _domain(number, interface)
            self._participant = DomainParticipant(number)
        except Exception as error:  # cyclonedds raises DDSException, which names no cause, from deep within
            raise InputError("--interface", interface, f"cannot be used by DDS: {error}") from error
        self._key = self._participant.get_guid()
        self._topics: dict[Topic[Any], DdsTopic[Any]] = {}
        self._writers: dict[Topic[Any], DataWriter[Any]] = {}
        self._listeners: list[tuple[Callable[[], Any], Callable[[Any], None]]] = []
        self._publications = BuiltinDataReader(self._participant, BuiltinTopicDcpsPublication)
        self._subscriptions = BuiltinDataReader(self._participant, BuiltinTopicDcpsSubscription)
        self._lock = threading.Lock()
        self._closing = GuardCondition(self._participant)
        self._waitset = WaitSet(self._participant)
        self._waitset.attach(self._closing)
        self._thread = threading.Thread(target=self._listen, name="DDS", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def advertise(self, topic: Topic[Any]) -> None:
        """As `Transport.advertise`."""
        self._writer(topic)

    def publish(self, topic: Topic[M], message: M) -> None:
        """As `Transport.publish`."""
        self._writer(topic).write(to_idl(message))

    def subscribe(self, topic: Topic[M], heard: Callable[[M], None]) -> None:
        """As `Transport.subscribe`."""
        reader = DataReader(self._participant, self._topic(topic), qos=_reader_qos(topic.quality))
        unread = ReadCondition(reader, SampleState.NotRead | ViewState.Any | InstanceState.Any)

        def take() -> list[M]:
            try:
                samples = reader.take(LARGEST_TAKE)
            except UnicodeDecodeError:
                return []  # a text of no ROS node; all else that is malformed, DDS has thrown away already
            return [from_idl(topic.message_type, sample) for sample in samples if sample.sample_info.valid_data]

        with self._lock:
            self._listeners.append((take, heard))
            self._waitset.attach(unread)

    def publishers_of(self, topic: Topic[Any]) -> int:
        """As `Transport.publishers_of`."""
        return self._count(self._publications, topic)

    def subscribers_of(self, topic: Topic[Any]) -> int:
        """As `Transport.subscribers_of`."""
        return self._count(self._subscriptions, topic)

    def connected(self) -> bool:
        """Always: DDS has no master."""
        return True

    def close(self) -> None:
        """As `Transport.close`."""
        if self._thread.is_alive():
            self._closing.set(True)
            self._thread.join()
        self._writers.clear()
        self._listeners.clear()
        self._topics.clear()

    def _topic(self, topic: Topic[M]) -> DdsTopic[Any]:
        if topic not in self._topics:
            self._topics[topic] = DdsTopic(self._participant, f"rt{topic.name}", idl_class(topic.message_type))
        return self._topics[topic]

    def _writer(self, topic: Topic[M]) -> DataWriter[Any]:
        with self._lock:
            if topic not in self._writers:
                qos = _writer_qos(topic.quality)
                self._writers[topic] = DataWriter(self._participant, self._topic(topic), qos=qos)
            return self._writers[topic]

    def _listen(self) -> None:
        """Hand over what arrives, until `close`."""
        while not self._closing.read():
            self._waitset.wait(1000 * MILLISECOND)
            with self._lock:
                listeners = tuple(self._listeners)
            for take, heard in listeners:
                for message in take():
                    heard(message)

    def _count(self, endpoints: BuiltinDataReader, topic: Topic[M]) -> int:
        """Endpoints of a topic that belong to others."""
        found = endpoints.read(MOST_ENDPOINTS)
        others = {
            sample.key
            for sample in found
            if sample.sample_info.valid_data
            and sample.sample_info.instance_state == InstanceState.Alive
            and sample.topic_name == f"rt{topic.name}"
            and sample.participant_key != self._key
        }
        return len(others)
