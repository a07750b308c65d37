"""A ROS 1 node, through rospy (Debian's own, or that of a sourced ROS environment).

rospy allows one node per process, so there can be one `Ros1Transport`. It listens on 127.0.0.1 only, unless ``ROS_IP``
or ``ROS_HOSTNAME`` names another interface. Topics keep working when the master dies, and the node registers with the
next master.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from typing import Any, Self

from wherry.errors import InputError
from wherry.ros.message_fields import MessageT
from wherry.ros.messages import String
from wherry.ros.topics import QosProfile, Topic
from wherry.ros.transports.ros1_master import (
    MasterMonitor,
    Registration,
    Role,
    choose_interface,
    wait_for_master,
)
from wherry.ros.transports.ros1_messages import from_ros1, ros1_class, ros1_module, ros1_reader, to_ros1

QUEUE_SIZES = {QosProfile.SENSOR: 100, QosProfile.RELIABLE: 1000, QosProfile.LATCHED: 1000}  # messages per peer
RECEIVE_BUFFER = 1 << 22  # bytes; rospy never catches up again if a message is larger


class Ros1Transport:
    """A ROS 1 node: a `wherry.ros.transports.protocol.Transport`.

    Args:
        name: Name of the node, without its namespace. ROS shuts down a running node of the same name.
        namespace: Namespace of the node; topic names are absolute already.
        interface: Address at which other machines reach this one; empty for ``ROS_IP`` or, without it, 127.0.0.1.

    Raises:
        InputError: rospy is not installed, no master answers, or it runs on another machine and ``ROS_IP`` is not set.
    """

    ros_version = 1

    def __init__(self, name: str, namespace: str = "", interface: str = "") -> None:
        master_uri = choose_interface(interface)
        if namespace:
            os.environ["ROS_NAMESPACE"] = f"/{namespace.strip('/')}"  # rospy reads it when it is imported
        self._rospy = ros1_module("rospy")
        wait_for_master(master_uri)
        # argv is empty because the command line is not meant for rospy; ROS logging and ROS time are not used here.
        self._rospy.init_node(name, argv=[], disable_rosout=True, disable_rostime=True, disable_signals=True)
        self._monitor = MasterMonitor(self._rospy.get_name(), self._rospy.get_node_uri(), master_uri)
        self._publishers: dict[str, Any] = {}
        self._callback_lock = threading.RLock()  # held while a callback runs
        self._is_closed = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def set_parameter(self, name: str, value: bool | float | str) -> None:
        """Set a parameter on the master, such as ``/use_sim_time``, and again on every master that replaces it.

        Raises:
            MasterError: The master does not answer.
        """
        self._monitor.set_parameter(name, value)

    def advertise(self, topic: Topic[MessageT]) -> None:
        """As `Transport.advertise`."""
        if topic.name in self._publishers:
            return
        ros1 = ros1_class(topic.message_type)
        latch, queue = topic.qos is QosProfile.LATCHED, QUEUE_SIZES[topic.qos]
        publisher = self._rospy.Publisher(topic.name, ros1, queue_size=queue, latch=latch, tcp_nodelay=True)
        self._publishers[topic.name] = publisher
        self._monitor.add(Registration(Role.PUBLISHER, topic.name, ros1._type))

    def publish(self, topic: Topic[MessageT], message: MessageT) -> None:
        """As `Transport.publish`.

        Raises:
            InputError: ROS has shut this node down because another node of the same name has started.
        """
        if self._rospy.is_shutdown():
            raise InputError("ROS 1", self._rospy.get_name(), "another node of this name took its place")
        self.advertise(topic)
        self._publishers[topic.name].publish(to_ros1(message))

    def subscribe(self, topic: Topic[MessageT], callback: Callable[[MessageT], None]) -> None:
        """As `Transport.subscribe`."""
        ros1, queue = ros1_reader(topic.message_type), QUEUE_SIZES[topic.qos]

        def receive(message: Any) -> None:
            converted = from_ros1(message, topic.message_type)
            with self._callback_lock:
                if not self._is_closed:
                    callback(converted)

        self._rospy.Subscriber(topic.name, ros1, receive, queue_size=queue, buff_size=RECEIVE_BUFFER, tcp_nodelay=True)
        self._monitor.add(Registration(Role.SUBSCRIBER, topic.name, ros1._type))

    def count_publishers(self, topic: Topic[MessageT]) -> int:
        """As `Transport.count_publishers`, at most `POLL_PERIOD` old."""
        return self._monitor.count_others(Role.PUBLISHER, topic.name)

    def count_subscribers(self, topic: Topic[MessageT]) -> int:
        """As `Transport.count_subscribers`, at most `POLL_PERIOD` old."""
        return self._monitor.count_others(Role.SUBSCRIBER, topic.name)

    def is_connected(self) -> bool:
        """Whether the master answers and ROS has not shut this node down."""
        return self._monitor.is_reachable and not self._rospy.is_shutdown()

    def announce_sim_time(self) -> None:
        """As `Transport.announce_sim_time`."""
        self.set_parameter("/use_sim_time", True)

    def publish_robot_description(self, topic: Topic[String], urdf: str) -> None:
        """As `Transport.publish_robot_description`."""
        self.set_parameter(topic.name, urdf)

    def close(self) -> None:
        """As `Transport.close`."""
        with self._callback_lock:
            self._is_closed = True
        self._monitor.stop()
        self._rospy.signal_shutdown("closed")
