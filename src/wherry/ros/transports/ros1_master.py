"""Client of the ROS 1 master: counts other nodes, and registers a node again when the master was restarted.

Everything here is the documented XML-RPC of ROS 1 (ROS Wiki: "Master API", "Slave API", "Parameter Server API").
"""

from __future__ import annotations

import http.client
import os
import socket
import threading
import time
from contextlib import closing
from dataclasses import dataclass
from enum import StrEnum
from typing import Any
from urllib.parse import urlparse
from xmlrpc.client import Fault, ServerProxy, Transport

from wherry.errors import InputError

LOOPBACK = "127.0.0.1"
DEFAULT_URI = f"http://{LOOPBACK}:11311"
STARTUP_TIMEOUT = 5.0  # s, for the first answer of a master, which may be starting
POLL_PERIOD = 0.25  # s, between two queries of the master
REPLY_TIMEOUT = 2.0  # s
SUCCESS = 1  # status code of a successful reply


class Role(StrEnum):
    """Role of a node on a topic; the values occur in the names of the methods that register it."""

    PUBLISHER = "Publisher"
    SUBSCRIBER = "Subscriber"


@dataclass(frozen=True, slots=True)
class Registration:
    """A publisher or subscriber that a node registered with the master.

    Attributes:
        role: Whether the node publishes or subscribes.
        topic: Absolute name of the topic.
        type_name: Message type as ROS 1 writes it, such as "sensor_msgs/LaserScan".
    """

    role: Role
    topic: str
    type_name: str


class MasterError(Exception):
    """A call to the master failed: it does not answer, or answers with an error."""


class MasterReplyError(MasterError):
    """The master answered with an error, such as that there is no node of a name."""


class Master:
    """Calls to the master.

    Args:
        node: Absolute name of the calling node.
        uri: URI of the master.
    """

    def __init__(self, node: str, uri: str) -> None:
        self._node = node
        self._proxy = ServerProxy(uri, transport=_TransportWithTimeout())

    def call(self, method: str, *arguments: Any) -> Any:
        """Call a method of the master's API.

        Raises:
            MasterError: It does not answer.
            MasterReplyError: It answers with an error.
        """
        try:
            code, message, value = getattr(self._proxy, method)(self._node, *arguments)
        except (OSError, http.client.HTTPException, Fault) as error:
            raise MasterError(f"{method}: {error}") from error
        if code != SUCCESS:
            raise MasterReplyError(f"{method}: {message}")
        return value

    def is_alive(self, node: str) -> bool:
        """Whether a node accepts connections; a master keeps the names of nodes that were killed.

        Raises:
            MasterError: The master does not answer.
        """
        try:
            uri = urlparse(self.call("lookupNode", node))
            socket.create_connection((uri.hostname or "", uri.port or 0), timeout=REPLY_TIMEOUT).close()
        except (MasterReplyError, OSError):
            return False
        return True

    def close(self) -> None:
        """Close the connection."""
        self._proxy("close")()


class _TransportWithTimeout(Transport):
    """XML-RPC over HTTP whose requests time out after `REPLY_TIMEOUT`."""

    def make_connection(self, host: Any) -> http.client.HTTPConnection:
        connection = super().make_connection(host)
        connection.timeout = REPLY_TIMEOUT
        return connection


def choose_interface(interface: str = "") -> str:
    """Set the environment variables that decide where the master is and where this node listens: 127.0.0.1 by default.

    Args:
        interface: An address of this machine; empty for ``ROS_IP`` or ``ROS_HOSTNAME``.

    Returns:
        URI of the master.

    Raises:
        InputError: The master runs on another machine, which could not reach a node on 127.0.0.1.
    """
    uri = os.environ.setdefault("ROS_MASTER_URI", DEFAULT_URI)
    host = urlparse(uri).hostname
    if host is None:
        raise InputError("ROS_MASTER_URI", uri, f"is not an address such as {DEFAULT_URI}")
    if interface:
        os.environ["ROS_IP"] = interface
    if "ROS_IP" in os.environ or "ROS_HOSTNAME" in os.environ:
        return uri
    if host not in ("localhost", socket.gethostname()) and not host.startswith("127."):
        reason = "the master runs on another machine: set ROS_IP to the address by which it can reach this one"
        raise InputError("ROS_MASTER_URI", uri, reason)
    os.environ["ROS_IP"] = LOOPBACK
    return uri


def wait_for_master(uri: str) -> None:
    """Return once a master answers.

    Raises:
        InputError: No master answers within `STARTUP_TIMEOUT`.
    """
    deadline = time.monotonic() + STARTUP_TIMEOUT
    with closing(Master("/wherry", uri)) as master:
        while True:
            try:
                master.call("getPid")
            except MasterError as error:
                if time.monotonic() > deadline:
                    reason = "no ROS master answers there; start one: roscore"
                    raise InputError("ROS_MASTER_URI", uri, reason) from error
                time.sleep(POLL_PERIOD)
            else:
                return


class MasterMonitor:
    """Polls the master: counts other nodes, and registers this node again when the master was replaced.

    rospy registers once. When a master dies, its nodes remain connected, but a new master does not know them, so that
    no further node could connect to them.

    Args:
        node: Absolute name of the node.
        node_uri: URI of the node's own XML-RPC server.
        master_uri: URI of the master.

    Attributes:
        is_reachable: Whether the master answered the last query.
    """

    def __init__(self, node: str, node_uri: str, master_uri: str) -> None:
        self._node = node
        self._node_uri = node_uri
        self._master = Master(node, master_uri)
        self._registrations: set[Registration] = set()
        self._parameters: dict[str, Any] = {}
        self._counts: dict[tuple[Role, str], int] = {}
        self._lock = threading.Lock()  # one thread at a time calls the master
        self._is_stopped = threading.Event()
        self.is_reachable = True
        self._thread = threading.Thread(target=self._run, name="ROS master", daemon=True)
        self._thread.start()

    def add(self, registration: Registration) -> None:
        """Add a registration that rospy has made, to be repeated with every new master."""
        with self._lock:
            self._registrations.add(registration)
            self._poll()

    def set_parameter(self, name: str, value: bool | float | str) -> None:
        """Set a parameter, now and with every new master.

        Raises:
            MasterError: The master does not answer.
        """
        with self._lock:
            self._parameters[name] = value
            self._master.call("setParam", name, value)

    def count_others(self, role: Role, topic: str) -> int:
        """How many other living nodes have a role on a topic for which this node is registered."""
        return self._counts.get((role, topic), 0)

    def stop(self) -> None:
        """Stop polling."""
        self._is_stopped.set()
        self._thread.join()
        self._master.close()

    def _run(self) -> None:
        while not self._is_stopped.wait(POLL_PERIOD):
            with self._lock:
                self._poll()

    def _poll(self) -> None:
        """Ask the master which nodes exist, and register what it does not know."""
        try:
            publishers, subscribers, _ = self._master.call("getSystemState")
            known = {
                (role, topic): nodes
                for role, state in ((Role.PUBLISHER, publishers), (Role.SUBSCRIBER, subscribers))
                for topic, nodes in state
            }
            missing = [
                entry for entry in self._registrations if self._node not in known.get((entry.role, entry.topic), ())
            ]
            if missing and not self._is_replaced():
                self._register(missing)
            self._counts = self._count(known)
            self.is_reachable = True
        except MasterError:
            self.is_reachable = False

    def _is_replaced(self) -> bool:
        """Whether another node has registered under this node's name; ROS then shuts this one down."""
        try:
            return bool(self._master.call("lookupNode", self._node) != self._node_uri)
        except MasterReplyError:
            return False

    def _register(self, missing: list[Registration]) -> None:
        """Register with a new master; publishers first, so that no subscriber misses one."""
        for name, value in self._parameters.items():
            self._master.call("setParam", name, value)
        for registration in sorted(missing, key=lambda entry: entry.role):
            method, topic = f"register{registration.role}", registration.topic
            publishers = self._master.call(method, topic, registration.type_name, self._node_uri)
            if (
                registration.role is Role.SUBSCRIBER
            ):  # rospy connects only to publishers announced to its XML-RPC server
                with ServerProxy(self._node_uri, transport=_TransportWithTimeout()) as node:
                    node.publisherUpdate("/master", topic, publishers)

    def _count(self, known: dict[tuple[Role, str], list[str]]) -> dict[tuple[Role, str], int]:
        """Number of other living nodes by role and topic, for the topics of this node."""
        topics = {registration.topic for registration in self._registrations}
        nodes = {
            key: [name for name in names if name != self._node] for key, names in known.items() if key[1] in topics
        }
        alive = {name: self._master.is_alive(name) for name in set().union(*nodes.values())}
        return {key: sum(alive[name] for name in names) for key, names in nodes.items()}
