"""ROS in one process, for tests: whoever publishes calls the listeners."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, Self

from wherry.ros.transport import Quality, Topic


@dataclass
class Bus:
    """What has been published, and who listens."""

    heard: dict[str, list[Any]] = field(default_factory=lambda: defaultdict(list))
    listeners: dict[tuple[str, type], list[Callable[[Any], None]]] = field(default_factory=lambda: defaultdict(list))
    latched: dict[tuple[str, type], Any] = field(default_factory=dict)
    publishers: dict[str, set[int]] = field(default_factory=lambda: defaultdict(set))
    nodes: list[BusTransport] = field(default_factory=list)

    def node(self, generation: int = 2) -> BusTransport:
        self.nodes.append(BusTransport(self, generation))
        return self.nodes[-1]

    def say(self, topic: Topic[Any], message: Any) -> None:
        """Publish as an outsider whom nobody counts."""
        self.heard[topic.name].append(message)
        if topic.quality is Quality.LATCHED:
            self.latched[topic.name, topic.message_type] = message
        for listener in tuple(self.listeners[topic.name, topic.message_type]):
            listener(message)


@dataclass
class BusTransport:
    """A `Transport`."""

    bus: Bus
    generation: int = 2
    is_connected: bool = True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
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
        if topic.quality is Quality.LATCHED and key in self.bus.latched:
            heard(self.bus.latched[key])

    def publishers_of(self, topic: Topic[Any]) -> int:
        return len(self.bus.publishers[topic.name] - {id(self)})

    def subscribers_of(self, topic: Topic[Any]) -> int:
        return len(self.bus.listeners[topic.name, topic.message_type])

    def connected(self) -> bool:
        return self.is_connected

    def close(self) -> None:
        for publishers in self.bus.publishers.values():
            publishers.discard(id(self))
