"""Recording of all messages that a ROS node publishes and receives."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from threading import Lock
from typing import Any, Self

from wherry.errors import InputError
from wherry.ros.bags.writer import BagWriter
from wherry.ros.decoding import MessageError, decode_stamp
from wherry.ros.message_fields import Message, MessageT
from wherry.ros.messages import String
from wherry.ros.names import RosNames
from wherry.ros.topics import Topic
from wherry.ros.transports.protocol import Transport


class RecordedTransport:
    """A transport that records all messages published and received through it.

    A message is recorded with the time of the robot's clock, which is the stamp of the last scan or odometry. Messages
    before the first scan or odometry are held back until it is received. Transforms are recorded even if the node does
    not subscribe to them.

    Args:
        transport: The transport to wrap.
        bag: Bag to write to; the caller closes it.
        names: Names of topics and frames.
    """

    def __init__(self, transport: Transport, bag: BagWriter, names: RosNames) -> None:
        self._transport = transport
        self._bag = bag
        self._clock_topics = {names.topics.scan.name, names.topics.odom.name}
        self._subscribed: set[str] = set()
        self._lock = Lock()
        self._is_finished = False
        self._now: float | None = None  # s, robot's clock
        self._held_back: list[tuple[Topic[Any], Message]] = []
        self.subscribe(names.topics.tf, lambda message: None)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    @property
    def ros_version(self) -> int:
        """As `Transport.ros_version`."""
        return self._transport.ros_version

    def advertise(self, topic: Topic[MessageT]) -> None:
        """As `Transport.advertise`."""
        self._transport.advertise(topic)

    def publish(self, topic: Topic[MessageT], message: MessageT) -> None:
        """As `Transport.publish`; recorded here unless the node subscribes to the topic and receives it itself."""
        self._transport.publish(topic, message)
        if topic.name not in self._subscribed:
            self._record(topic, message)

    def subscribe(self, topic: Topic[MessageT], callback: Callable[[MessageT], None]) -> None:
        """As `Transport.subscribe`."""
        if topic.name in self._subscribed:  # the first subscription records the messages
            self._transport.subscribe(topic, callback)
            return
        self._subscribed.add(topic.name)

        def record_and_call(message: MessageT) -> None:
            with contextlib.suppress(InputError):  # `publish` reports a full disk, on the agent's own thread
                self._record(topic, message)
            callback(message)

        self._transport.subscribe(topic, record_and_call)

    def count_publishers(self, topic: Topic[MessageT]) -> int:
        """As `Transport.count_publishers`."""
        return self._transport.count_publishers(topic)

    def count_subscribers(self, topic: Topic[MessageT]) -> int:
        """As `Transport.count_subscribers`."""
        return self._transport.count_subscribers(topic)

    def is_connected(self) -> bool:
        """As `Transport.is_connected`."""
        return self._transport.is_connected()

    def announce_sim_time(self) -> None:
        """As `Transport.announce_sim_time`."""
        self._transport.announce_sim_time()

    def publish_robot_description(self, topic: Topic[String], urdf: str) -> None:
        """As `Transport.publish_robot_description`; not recorded, as it is a parameter in ROS 1."""
        self._transport.publish_robot_description(topic, urdf)

    def close(self) -> None:
        """As `Transport.close`."""
        self._transport.close()

    def stop_recording(self) -> None:
        """Record nothing more, so that the bag can be closed; the transport stays open."""
        with self._lock:
            self._is_finished = True

    def _record(self, topic: Topic[Any], message: Message) -> None:
        with self._lock:
            if self._is_finished:
                return
            if topic.name in self._clock_topics:
                self._update_clock(message)
            self._held_back.append((topic, message))
            if self._now is None:
                return
            for held_topic, held in self._held_back:
                self._bag.write(held_topic, held, self._now)
            self._held_back.clear()

    def _update_clock(self, message: Any) -> None:
        """Advance the robot's clock to the stamp of a scan or odometry; an impossible stamp is ignored."""
        with contextlib.suppress(MessageError):  # the message is still recorded; readers of the bag reject it
            seconds = decode_stamp(message.header.stamp)
            self._now = seconds if self._now is None else max(self._now, seconds)
