"""A ROS 2 node without a ROS installation: through Eclipse Cyclone DDS, which PyPI has (``wherry[ros2]``).

The ROS 2 topic ``/scan`` is the DDS topic ``rt/scan``; `wherry.ros.transports.ros2_messages` has its type.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from types import MappingProxyType
from typing import Any, Self

from wherry.errors import InputError
from wherry.ros.message_fields import MessageT
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
    from cyclonedds.pub import DataWriter
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic as DdsTopic

    from wherry.ros.transports.ros2_domains import DOMAINS, LOOPBACK, domain_id
    from wherry.ros.transports.ros2_messages import from_idl, idl_class, to_idl
except ImportError as error:
    raise InputError("ROS 2", "cyclonedds", "is not installed: pip install 'wherry[ros2]'") from error

MAX_SAMPLES = 100  # messages taken from a reader at once
MAX_ENDPOINTS = 10_000  # publishers or subscribers, read at once
MILLISECOND = 1_000_000  # ns
MAX_BLOCKING_TIME = 50 * MILLISECOND  # ns that a slow subscriber may hold up a publisher
WAIT_TIMEOUT = 1000 * MILLISECOND  # ns
WRITER_DEPTHS = MappingProxyType({QosProfile.SENSOR: 10, QosProfile.RELIABLE: 100, QosProfile.LATCHED: 1})  # messages
READER_DEPTH = 100  # messages kept until they are taken


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
    """A ROS 2 node: a `wherry.ros.transports.protocol.Transport`.

    Args:
        interface: Network interface to use: loopback, which keeps this machine out of every network, or another one.

    Raises:
        InputError: ROS_DOMAIN_ID is wrong, or DDS cannot use the interface.
    """

    ros_version = 2

    def __init__(self, interface: str = LOOPBACK) -> None:
        self._domain = domain_id(), interface
        try:
            self._participant = DOMAINS.join(*self._domain)
        except Exception as error:  # cyclonedds raises DDSException, which names no cause
            raise InputError("--interface", interface, f"cannot be used by DDS: {error}") from error
        self._key = self._participant.get_guid()
        self._topics: dict[Topic[Any], DdsTopic[Any]] = {}
        self._writers: dict[Topic[Any], DataWriter[Any]] = {}
        self._readers: list[
            tuple[Callable[[], Any], Callable[[Any], None]]
        ] = []  # function that takes new messages, and the callback
        self._publications = BuiltinDataReader(self._participant, BuiltinTopicDcpsPublication)
        self._subscriptions = BuiltinDataReader(self._participant, BuiltinTopicDcpsSubscription)
        self._lock = threading.Lock()
        self._is_closed = False
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

    def publish(self, topic: Topic[MessageT], message: MessageT) -> None:
        """As `Transport.publish`."""
        self._writer(topic).write(to_idl(message))

    def subscribe(self, topic: Topic[MessageT], callback: Callable[[MessageT], None]) -> None:
        """As `Transport.subscribe`."""
        reader = DataReader(self._participant, self._topic(topic), qos=_reader_qos(topic.qos))
        unread = ReadCondition(reader, SampleState.NotRead | ViewState.Any | InstanceState.Any)

        def take() -> list[MessageT]:
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
        """Do nothing: each ROS 2 node has a parameter ``use_sim_time`` of its own."""

    def publish_robot_description(self, topic: Topic[String], urdf: str) -> None:
        """As `Transport.publish_robot_description`."""
        self.publish(topic, String(urdf))

    def close(self) -> None:
        """As `Transport.close`."""
        if self._is_closed:
            return
        self._is_closed = True
        self._closing.set(True)
        self._thread.join()
        self._writers.clear()
        self._readers.clear()
        self._topics.clear()
        # DDS entities are deleted with their last reference; each before the one that it was created from.
        del self._waitset, self._closing, self._publications, self._subscriptions, self._participant
        DOMAINS.leave(*self._domain)

    def _topic(self, topic: Topic[MessageT]) -> DdsTopic[Any]:
        if topic not in self._topics:
            self._topics[topic] = DdsTopic(self._participant, f"rt{topic.name}", idl_class(topic.message_type))
        return self._topics[topic]

    def _writer(self, topic: Topic[MessageT]) -> DataWriter[Any]:
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

    def _count(self, endpoints: BuiltinDataReader, topic: Topic[MessageT]) -> int:
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
