"""A node of ROS 2 without a ROS installation: through Eclipse Cyclone DDS, which PyPI has (``wherry[ros2]``).

A topic ``/scan`` of ``sensor_msgs/msg/LaserScan`` is the DDS topic ``rt/scan`` of the type
``sensor_msgs::msg::dds_::LaserScan_``, serialized as plain CDR. The classes that Cyclone DDS needs are generated from
those in `wherry.ros.messages`.
"""

from __future__ import annotations

import os
import socket
import stat
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType, new_class
from typing import Any, Self
from xml.sax.saxutils import quoteattr

import numpy as np

from wherry.errors import InputError
from wherry.ros.message_fields import ARRAY_TYPES, Field, M, Message, cached, fields_of
from wherry.ros.messages import String
from wherry.ros.topics import QosProfile, Topic

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
MAX_DOMAIN = 232  # beyond it, DDS runs out of UDP ports
FIRST_PORT, PORTS_PER_DOMAIN = 7400, 250  # UDP (DDS wire protocol, section 9.6.1)
MAX_PARTICIPANTS = 60  # per machine, that discovery without multicast looks for
MAX_SAMPLES = 100  # messages taken from a reader at once
MAX_ENDPOINTS = 10_000  # publishers or subscribers, read at once
MILLISECOND = 1_000_000  # ns
MAX_BLOCKING_TIME = 50 * MILLISECOND  # ns that a slow subscriber may hold up a publisher
WAIT_TIMEOUT = 1000 * MILLISECOND  # ns
WRITER_DEPTHS = MappingProxyType({QosProfile.SENSOR: 10, QosProfile.RELIABLE: 100, QosProfile.LATCHED: 1})  # messages
READER_DEPTH = 100  # messages kept until they are taken

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
    inner = IDL_TYPES[entry.kind] if isinstance(entry.kind, str) else idl_class(entry.kind)
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
    if isinstance(entry.kind, str):
        return value.tolist() if isinstance(value, np.ndarray) else value
    return to_idl(value) if entry.length is None else [to_idl(item) for item in value]


def from_idl(message_type: type[M], sample: Any) -> M:
    """Convert a sample of the `idl_class` of a message class."""
    return message_type(*(_value_from_idl(entry, getattr(sample, entry.name)) for entry in fields_of(message_type)))


def _value_from_idl(entry: Field, value: Any) -> Any:
    kind = entry.kind
    if isinstance(kind, str):
        if entry.length is None:
            return value
        return tuple(value) if kind == "string" else np.array(value, ARRAY_TYPES[kind])
    return from_idl(kind, value) if entry.length is None else tuple(from_idl(kind, item) for item in value)


def domain_id() -> int:
    """The value of ROS_DOMAIN_ID; 0 if it is not set.

    Raises:
        InputError: It is not a whole number from 0 to 232.
    """
    text = os.environ.get("ROS_DOMAIN_ID", "") or "0"
    if not text.isascii() or not text.isdigit() or int(text) > MAX_DOMAIN:
        raise InputError("ROS_DOMAIN_ID", text, f"is not a whole number from 0 to {MAX_DOMAIN}")
    return int(text)


def configuration(interface: str) -> str:
    """Cyclone DDS's configuration: only this machine on the loopback interface, the whole network on any other."""
    general = f"<Interfaces><NetworkInterface name={quoteattr(interface)}/></Interfaces>"
    discovery = f"<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>{MAX_PARTICIPANTS}"
    discovery += "</MaxAutoParticipantIndex>"
    if interface == LOOPBACK:
        general += "<AllowMulticast>false</AllowMulticast>"
        discovery += '<Peers><Peer address="127.0.0.1"/></Peers>'
    return f"<CycloneDDS><Domain><General>{general}</General><Discovery>{discovery}</Discovery></Domain></CycloneDDS>"


class _Domains:
    """The DDS domains of this process: each is created for its first transport and deleted with its last one.

    A domain owns sockets and threads, and has to be configured before its first participant is created.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._domains: dict[tuple[int, str], list[Domain]] = {}  # by number and interface, one entry per user

    def acquire(self, number: int, interface: str) -> None:
        """Create a domain, or add a user to it.

        Raises:
            DDSException: DDS cannot use the interface, or the domain uses another one already.
            OSError: The system does not allow the sockets to be bound to the loopback interface.
        """
        with self._lock:
            users = self._domains.get((number, interface), [])
            if not users:
                users.append(Domain(number, configuration(interface)))
                if interface == LOOPBACK:
                    _bind_to_loopback(number)
            else:
                users.append(users[0])
            self._domains[number, interface] = users

    def release(self, number: int, interface: str) -> None:
        """Remove a user, whose entities in the domain are gone; the domain goes with its last one."""
        with self._lock:
            users = self._domains[number, interface]
            users.pop()
            if not users:
                del self._domains[number, interface]


_DOMAINS = _Domains()


def _bind_to_loopback(number: int) -> None:
    """Accept nothing from the network in a domain: Cyclone DDS sends on its interface only, but listens on all of them.

    Raises:
        OSError: The system does not allow it (Linux before 5.7, without CAP_NET_RAW).
    """
    ports = range(FIRST_PORT + PORTS_PER_DOMAIN * number, FIRST_PORT + PORTS_PER_DOMAIN * (number + 1))
    for own in own_sockets():
        if own.type == socket.SOCK_DGRAM and own.getsockname()[1] in ports:
            own.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, LOOPBACK.encode())


def own_sockets() -> Iterator[socket.socket]:
    """All internet sockets of this process, those of C libraries included; each is valid until the next one.

    No descriptor is duplicated or closed.
    """
    for name in os.listdir("/proc/self/fd"):  # noqa: PTH208 - the names are numbers
        try:
            if not stat.S_ISSOCK(os.fstat(int(name)).st_mode):
                continue
            borrowed = socket.socket(fileno=int(name))
        except OSError:
            continue  # closed since it was listed
        try:
            if borrowed.family in (socket.AF_INET, socket.AF_INET6):
                yield borrowed
        finally:
            borrowed.detach()  # its owner closes it


def _writer_qos(profile: QosProfile) -> Qos:
    """Reliable, which every subscriber accepts; a slow one holds up the publisher for `MAX_BLOCKING_TIME` at most."""
    return Qos(
        Policy.Reliability.Reliable(MAX_BLOCKING_TIME),
        Policy.Durability.TransientLocal if profile is QosProfile.LATCHED else Policy.Durability.Volatile,
        Policy.History.KeepLast(WRITER_DEPTHS[profile]),
        Policy.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False),
    )


def _reader_qos(profile: QosProfile) -> Qos:
    """As ROS's own nodes: best effort for sensors, so that the publishers of all drivers match."""
    is_best_effort = profile is QosProfile.SENSOR
    return Qos(
        Policy.Reliability.BestEffort if is_best_effort else Policy.Reliability.Reliable(MAX_BLOCKING_TIME),
        Policy.Durability.TransientLocal if profile is QosProfile.LATCHED else Policy.Durability.Volatile,
        Policy.History.KeepLast(READER_DEPTH),
        Policy.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False),
    )


class Ros2Transport:
    """A node of ROS 2: a `wherry.ros.transports.protocol.Transport`.

    Args:
        interface: Network interface to use: loopback, which keeps this machine out of every network, or another one.

    Raises:
        InputError: ROS_DOMAIN_ID is wrong, or DDS cannot use the interface.
    """

    ros_version = 2

    def __init__(self, interface: str = LOOPBACK) -> None:
        number = domain_id()
        self._domain = number, interface
        try:
            _DOMAINS.acquire(*self._domain)
            self._participant = DomainParticipant(number)
        except Exception as error:  # cyclonedds raises DDSException, which names no cause
            raise InputError("--interface", interface, f"cannot be used by DDS: {error}") from error
        self._key = self._participant.get_guid()
        self._topics: dict[Topic[Any], DdsTopic[Any]] = {}
        self._writers: dict[Topic[Any], DataWriter[Any]] = {}
        self._readers: list[tuple[Callable[[], Any], Callable[[Any], None]]] = []  # what takes samples, callback
        self._publications = BuiltinDataReader(self._participant, BuiltinTopicDcpsPublication)
        self._subscriptions = BuiltinDataReader(self._participant, BuiltinTopicDcpsSubscription)
        self._lock = threading.Lock()
        self._closing = GuardCondition(self._participant)
        self._waitset = WaitSet(self._participant)
        self._waitset.attach(self._closing)
        self._thread = threading.Thread(target=self._run_callbacks, name="DDS", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def advertise(self, topic: Topic[Any]) -> None:
        """As `Transport.advertise`."""
        self._writer(topic)

    def publish(self, topic: Topic[M], message: M) -> None:
        """As `Transport.publish`."""
        self._writer(topic).write(to_idl(message))

    def subscribe(self, topic: Topic[M], callback: Callable[[M], None]) -> None:
        """As `Transport.subscribe`."""
        reader = DataReader(self._participant, self._topic(topic), qos=_reader_qos(topic.qos))
        unread = ReadCondition(reader, SampleState.NotRead | ViewState.Any | InstanceState.Any)

        def take() -> list[M]:
            try:
                samples = reader.take(MAX_SAMPLES)
            except UnicodeDecodeError:
                return []  # a string that is not UTF-8; DDS itself has dropped everything else that is malformed
            return [from_idl(topic.message_type, sample) for sample in samples if sample.sample_info.valid_data]

        with self._lock:
            self._readers.append((take, callback))
            self._waitset.attach(unread)

    def count_publishers(self, topic: Topic[Any]) -> int:
        """As `Transport.count_publishers`."""
        return self._count(self._publications, topic)

    def count_subscribers(self, topic: Topic[Any]) -> int:
        """As `Transport.count_subscribers`."""
        return self._count(self._subscriptions, topic)

    def is_connected(self) -> bool:
        """True: DDS has no master."""
        return True

    def announce_sim_time(self) -> None:
        """Do nothing: each node of ROS 2 has a parameter ``use_sim_time`` of its own."""

    def publish_robot_description(self, topic: Topic[String], urdf: str) -> None:
        """As `Transport.publish_robot_description`."""
        self.publish(topic, String(urdf))

    def close(self) -> None:
        """As `Transport.close`."""
        if not self._thread.is_alive():
            return
        self._closing.set(True)
        self._thread.join()
        self._writers.clear()
        self._readers.clear()
        self._topics.clear()
        # DDS entities are deleted with their last reference; each before the one that it was created from.
        del self._waitset, self._closing, self._publications, self._subscriptions, self._participant
        _DOMAINS.release(*self._domain)

    def _topic(self, topic: Topic[M]) -> DdsTopic[Any]:
        if topic not in self._topics:
            self._topics[topic] = DdsTopic(self._participant, f"rt{topic.name}", idl_class(topic.message_type))
        return self._topics[topic]

    def _writer(self, topic: Topic[M]) -> DataWriter[Any]:
        with self._lock:
            if topic not in self._writers:
                qos = _writer_qos(topic.qos)
                self._writers[topic] = DataWriter(self._participant, self._topic(topic), qos=qos)
            return self._writers[topic]

    def _run_callbacks(self) -> None:
        """Call the callbacks with the messages that arrive, until `close`."""
        while not self._closing.read():
            self._waitset.wait(WAIT_TIMEOUT)
            with self._lock:
                readers = tuple(self._readers)
            for take, callback in readers:
                for message in take():
                    callback(message)

    def _count(self, endpoints: BuiltinDataReader, topic: Topic[M]) -> int:
        """Number of endpoints of a topic that belong to other participants."""
        found = endpoints.read(MAX_ENDPOINTS)
        others = {
            sample.key
            for sample in found
            if sample.sample_info.valid_data
            and sample.sample_info.instance_state == InstanceState.Alive
            and sample.topic_name == f"rt{topic.name}"
            and sample.participant_key != self._key
        }
        return len(others)
