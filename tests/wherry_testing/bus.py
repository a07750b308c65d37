"""ROS in one process, for tests: publishing calls the subscribers' callbacks, directly or through DDS."""

from __future__ import annotations

import itertools
import os
import time
from collections import Counter, defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Self

from wherry.ros.messages import String
from wherry.ros.names import load_names
from wherry.ros.topics import QosProfile, Topic
from wherry.ros.transports.ros2 import Ros2Transport

TOPICS = load_names().topics
NUMBERS = itertools.count()


def free_domain() -> int:
    """A ROS_DOMAIN_ID that other test files and processes are unlikely to use; above 101, ports collide."""
    return 1 + (13 * os.getpid() + next(NUMBERS)) % 101


@dataclass
class Bus:
    """A ROS system: its nodes, and all messages published so far by topic."""

    heard: dict[str, list[Any]] = field(default_factory=lambda: defaultdict(list))
    callbacks: dict[tuple[str, type], list[Callable[[Any], None]]] = field(default_factory=lambda: defaultdict(list))
    latched: dict[tuple[str, type], Any] = field(default_factory=dict)
    publishers: dict[str, set[int]] = field(default_factory=lambda: defaultdict(set))
    nodes: list[BusTransport] = field(default_factory=list)

    def node(self, ros_version: int = 2) -> BusTransport:
        self.nodes.append(BusTransport(self, ros_version))
        return self.nodes[-1]

    def say(self, topic: Topic[Any], message: Any) -> None:
        """Publish as an external node that is not counted as a publisher."""
        self.heard[topic.name].append(message)
        if topic.qos is QosProfile.LATCHED:
            self.latched[topic.name, topic.message_type] = message
        for callback in tuple(self.callbacks[topic.name, topic.message_type]):
            callback(message)


@dataclass
class BusTransport:
    """A node of a `Bus`: a `Transport`."""

    bus: Bus
    ros_version: int = 2

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def advertise(self, topic: Topic[Any]) -> None:
        self.bus.publishers[topic.name].add(id(self))

    def publish(self, topic: Topic[Any], message: Any) -> None:
        assert isinstance(message, topic.message_type)
        self.advertise(topic)
        self.bus.say(topic, message)

    def subscribe(self, topic: Topic[Any], callback: Callable[[Any], None]) -> None:
        key = topic.name, topic.message_type
        self.bus.callbacks[key].append(callback)
        if topic.qos is QosProfile.LATCHED and key in self.bus.latched:
            callback(self.bus.latched[key])

    def count_publishers(self, topic: Topic[Any]) -> int:
        return len(self.bus.publishers[topic.name] - {id(self)})

    def count_subscribers(self, topic: Topic[Any]) -> int:
        return len(self.bus.callbacks[topic.name, topic.message_type])

    def is_connected(self) -> bool:
        return True

    def announce_sim_time(self) -> None:
        pass

    def publish_robot_description(self, topic: Topic[String], urdf: str) -> None:
        self.publish(topic, String(urdf))

    def close(self) -> None:
        for publishers in self.bus.publishers.values():
            publishers.discard(id(self))


class DdsBus(Bus):
    """The same over real DDS; ``say`` and the nodes' ``publish`` return once the message has arrived."""

    def __init__(self) -> None:
        super().__init__()
        self.external = Ros2Transport()
        self.arrived: Counter[tuple[str, type]] = Counter()
        self.opened: list[Ros2Transport] = [self.external]
        for topic in (TOPICS.cmd_vel, TOPICS.cmd_vel_stamped, TOPICS.latch_command):
            self.external.subscribe(topic, partial(self._hear, topic))

    def _hear(self, topic: Topic[Any], message: Any) -> None:
        self.heard[topic.name].append(message)
        for callback in tuple(self.callbacks[topic.name, topic.message_type]):
            callback(message)

    def node(self, ros_version: int = 2) -> Any:
        node = DdsNode(self)
        self.opened.append(node)
        return node

    def say(self, topic: Topic[Any], message: Any) -> None:
        key = topic.name, topic.message_type
        before = self.arrived[key]
        wait_for(lambda: bool(self.external._writer(topic).get_matched_subscriptions()))
        self.external.publish(topic, message)
        wait_for(lambda: self.arrived[key] > before)

    def close(self) -> None:
        for node in self.opened:
            node.close()


class DdsNode(Ros2Transport):
    """A node that counts the messages that arrive, and publishes no faster than they do."""

    def __init__(self, bus: DdsBus) -> None:
        super().__init__()
        self._bus = bus

    def subscribe(self, topic: Topic[Any], callback: Callable[[Any], None]) -> None:
        def call_and_count(message: Any) -> None:
            callback(message)
            self._bus.arrived[topic.name, topic.message_type] += 1

        super().subscribe(topic, call_and_count)

    def publish(self, topic: Topic[Any], message: Any) -> None:
        before = len(self._bus.heard[topic.name])
        wait_for(lambda: bool(self._writer(topic).get_matched_subscriptions()))
        super().publish(topic, message)
        wait_for(lambda: len(self._bus.heard[topic.name]) > before)


def wait_for(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < deadline, "the condition was not met in time"
        time.sleep(0.0005)
