"""A node of ROS 1, through rospy (Debian's own, or that of a sourced ROS environment).

rospy allows one node in a process, so there can be one `Ros1`. It listens on 127.0.0.1 alone unless ``ROS_IP`` or
``ROS_HOSTNAME`` names another interface. Topics live on when the master dies, and the node registers with the next one.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Any, Self

from wherry.errors import InputError
from wherry.ros.messages import M
from wherry.ros.transports.ros1_master import (
    PUBLISHER,
    SUBSCRIBER,
    MasterWatch,
    Registration,
    choose_interface,
    wait_for_master,
)
from wherry.ros.transports.ros1_messages import from_ros1, ros1_class, ros1_module, ros1_reader, to_ros1
from wherry.ros.transports.transport import Quality, Topic

QUEUES = {Quality.SENSOR: 100, Quality.RELIABLE: 1000, Quality.LATCHED: 1000}  # messages waiting for a slow listener
BUFFER = 1 << 22  # bytes that are read at once; rospy falls behind for good where a message is larger


class Ros1:
    """A node of ROS 1: a `wherry.ros.transports.transport.Transport`.

    Args:
        name: The node's name, without its namespace. A node of the same name that runs already is shut down by ROS.
        namespace: The node's; topics come with absolute names.
        interface: The address at which other machines reach this one; empty for ``ROS_IP``, or else 127.0.0.1.

    Raises:
        InputError: rospy is not installed, no master answers, or it runs on another machine and ``ROS_IP`` is not set.
    """

    generation = 1

    def __init__(self, name: str, namespace: str = "", interface: str = "") -> None:
        master_uri = choose_interface(interface)
        if namespace:
            os.environ["ROS_NAMESPACE"] = f"/{namespace.strip('/')}"  # rospy reads it when it is imported
        self._rospy = ros1_module("rospy")
        wait_for_master(master_uri)
        # argv: the options are not rospy's. Nothing here logs through ROS, or asks rospy for the time.
        self._rospy.init_node(name, argv=[], disable_rosout=True, disable_rostime=True, disable_signals=True)
        self._watch = MasterWatch(self._rospy.get_name(), self._rospy.get_node_uri(), master_uri)
        self._publishers: dict[str, Any] = {}
        self._hearing = threading.RLock()  # held while a callback runs
        self._closed = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def set_parameter(self, name: str, value: bool | float | str) -> None:
        """Set a parameter of the whole system, such as ``/use_sim_time``, and again whenever a new master has come.

        Raises:
            MasterError: The master has gone.
        """
        self._watch.set_parameter(name, value)

    def advertise(self, topic: Topic[M]) -> None:
        """As `Transport.advertise`."""
        if topic.name in self._publishers:
            return
        ros1 = ros1_class(topic.message_type)
        latch, queue = topic.quality is Quality.LATCHED, QUEUES[topic.quality]
        publisher = self._rospy.Publisher(topic.name, ros1, queue_size=queue, latch=latch, tcp_nodelay=True)
        self._publishers[topic.name] = publisher
        self._watch.keep(Registration(PUBLISHER, topic.name, ros1._type))

    def publish(self, topic: Topic[M], message: M) -> None:
        """As `Transport.publish`.

        Raises:
            InputError: ROS has shut this node down, for another of its name has started.
        """
        if self._rospy.is_shutdown():
            raise InputError("ROS 1", self._rospy.get_name(), "another node of this name took its place")
        self.advertise(topic)
        self._publishers[topic.name].publish(to_ros1(message))

    def subscribe(self, topic: Topic[M], heard: Callable[[M], None]) -> None:
        """As `Transport.subscribe`."""
        ros1, queue = ros1_reader(topic.message_type), QUEUES[topic.quality]

        def take_in(message: Any) -> None:
            converted = from_ros1(message, topic.message_type)
            with self._hearing:
                if not self._closed:
                    heard(converted)

        self._rospy.Subscriber(topic.name, ros1, take_in, queue_size=queue, buff_size=BUFFER, tcp_nodelay=True)
        self._watch.keep(Registration(SUBSCRIBER, topic.name, ros1._type))

    def publishers_of(self, topic: Topic[M]) -> int:
        """As `Transport.publishers_of`; as it was a quarter of a second ago."""
        return self._watch.others(PUBLISHER, topic.name)

    def subscribers_of(self, topic: Topic[M]) -> int:
        """As `Transport.subscribers_of`; as it was a quarter of a second ago."""
        return self._watch.others(SUBSCRIBER, topic.name)

    def connected(self) -> bool:
        """Whether the master answers, and this node still is one."""
        return self._watch.reached and not self._rospy.is_shutdown()

    def close(self) -> None:
        """As `Transport.close`."""
        with self._hearing:
            self._closed = True
        self._watch.stop()
        self._rospy.signal_shutdown("closed")
