"""ROS in one process, for tests: whoever publishes calls the listeners, at once or by way of DDS."""

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
    """A ROS_DOMAIN_ID that no test of another file or of another process is likely to use; above 101, ports collide."""
    return 1 + (13 * os.getpid() + next(NUMBERS)) % 101


@dataclass
class Bus:
    """What has been published, and who listens."""

    heard: dict[str, list[Any]] = field(default_factory=lambda: defaultdict(list))
    listeners: dict[tuple[str, type], list[Callable[[Any], None]]] = field(default_factory=lambda: defaultdict(list))
    latched: dict[tuple[str, type], Any] = field(default_factory=dict)
    publishers: dict[str, set[int]] = field(default_factory=lambda: defaultdict(set))
    nodes: list[BusTransport] = field(default_factory=list)

    def node(self, ros_version: int = 2) -> BusTransport:
        self.nodes.append(BusTransport(self, ros_version))
        return self.nodes[-1]

    def say(self, topic: Topic[Any], message: Any) -> None:
        """Publish as an outsider whom nobody counts."""
        self.heard[topic.name].append(message)
        if topic.qos is QosProfile.LATCHED:
            self.latched[topic.name, topic.message_type] = message
        for listener in tuple(self.listeners[topic.name, topic.message_type]):
            listener(message)


@dataclass
class BusTransport:
    """A `Transport`."""

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

    def subscribe(self, topic: Topic[Any], heard: Callable[[Any], None]) -> None:
        key = topic.name, topic.message_type
        self.bus.listeners[key].append(heard)
        if topic.qos is QosProfile.LATCHED and key in self.bus.latched:
            heard(self.bus.latched[key])

    def count_publishers(self, topic: Topic[Any]) -> int:
        return len(self.bus.publishers[topic.name] - {id(self)})

    def count_subscribers(self, topic: Topic[Any]) -> int:
        return len(self.bus.listeners[topic.name, topic.message_type])

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
    """The same over real DDS: what is said has arrived when ``say`` returns, and so has what a node publishes."""

    def __init__(self) -> None:
        super().__init__()
        self.outside = Ros2Transport()
        self.arrived: Counter[tuple[str, type]] = Counter()
        self.opened: list[Ros2Transport] = [self.outside]
        for topic in (TOPICS.cmd_vel, TOPICS.cmd_vel_stamped, TOPICS.latch_command):
            self.outside.subscribe(topic, partial(self._hear, topic))

    def _hear(self, topic: Topic[Any], message: Any) -> None:
        self.heard[topic.name].append(message)
        for listener in tuple(self.listeners[topic.name, topic.message_type]):
            listener(message)

    def node(self, ros_version: int = 2) -> Any:
        node = DdsNode(self)
        self.opened.append(node)
        return node

    def say(self, topic: Topic[Any], message: Any) -> None:
        key = topic.name, topic.message_type
        before = self.arrived[key]
        wait_for(lambda: bool(self.outside._writer(topic).get_matched_subscriptions()))
        self.outside.publish(topic, message)
        wait_for(lambda: self.arrived[key] > before)

    def close(self) -> None:
        for node in self.opened:
            node.close()


class DdsNode(Ros2Transport):
    """Tells the bus what has been heard, and publishes no faster than the bus hears."""

    def __init__(self, bus: DdsBus) -> None:
        super().__init__()
        self._bus = bus

    def subscribe(self, topic: Topic[Any], heard: Callable[[Any], None]) -> None:
        def tell(message: Any) -> None:
            heard(message)
            self._bus.arrived[topic.name, topic.message_type] += 1

        super().subscribe(topic, tell)

    def publish(self, topic: Topic[Any], message: Any) -> None:
        before = len(self._bus.heard[topic.name])
        wait_for(lambda: bool(self._writer(topic).get_matched_subscriptions()))
        super().publish(topic, message)
        wait_for(lambda: len(self._bus.heard[topic.name]) > before)


def wait_for(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < deadline, "it never came true"
        time.sleep(0.0005)
