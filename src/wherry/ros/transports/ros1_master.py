"""The master of ROS 1, seen from a node: who is there, and what becomes of a node whose master has died.

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
from typing import Any
from urllib.parse import urlparse
from xmlrpc.client import Fault, ServerProxy, Transport

from wherry.errors import InputError

LOOPBACK = "127.0.0.1"
DEFAULT_URI = f"http://{LOOPBACK}:11311"
PATIENCE = 5.0  # s, how long a master may take to answer at first: it may be starting
LOOK_EVERY = 0.25  # s between two looks at the master
REPLY_WITHIN = 2.0  # s
SUCCESS = 1  # the status code of every reply of a master
PUBLISHER, SUBSCRIBER = "Publisher", "Subscriber"  # as the methods that register them are called


@dataclass(frozen=True, slots=True)
class Registration:
    """What a node told the master.

    Attributes:
        role: `PUBLISHER` or `SUBSCRIBER`.
        topic: Its absolute name.
        type_name: As ROS 1 writes it, such as "sensor_msgs/LaserScan".
    """

    role: str
    topic: str
    type_name: str


class MasterError(Exception):
    """The master does not answer, or refuses."""


class RefusalError(MasterError):
    """The master answers that it cannot do what it was asked for."""


class Master:
    """Calls to the master.

    Args:
        node: The caller's absolute name.
        uri: Where the master is.
    """

    def __init__(self, node: str, uri: str) -> None:
        self._node = node
        self._proxy = ServerProxy(uri, transport=_Impatient())

    def ask(self, method: str, *arguments: Any) -> Any:
        """Call a method of the master's.

        Raises:
            MasterError: It does not answer.
            RefusalError: It answers that it cannot.
        """
        try:
            code, message, value = getattr(self._proxy, method)(self._node, *arguments)
        except (OSError, http.client.HTTPException, Fault) as error:
            raise MasterError(f"{method}: {error}") from error
        if code != SUCCESS:
            raise RefusalError(f"{method}: {message}")
        return value

    def is_alive(self, node: str) -> bool:
        """Whether a node still answers: a master keeps those that were killed.

        Raises:
            MasterError: The master does not answer.
        """
        try:
            uri = urlparse(self.ask("lookupNode", node))
            socket.create_connection((uri.hostname or "", uri.port or 0), timeout=REPLY_WITHIN).close()
        except (RefusalError, OSError):
            return False
        return True

    def close(self) -> None:
        """Hang up."""
        self._proxy("close")()


class _Impatient(Transport):
    """XML-RPC that does not wait for ever."""

    def make_connection(self, host: Any) -> http.client.HTTPConnection:
        connection = super().make_connection(host)
        connection.timeout = REPLY_WITHIN
        return connection


def choose_interface(interface: str = "") -> str:
    """Settle, in the environment, which master to ask, and where to listen: on 127.0.0.1 unless told otherwise.

    Args:
        interface: An address of this machine; empty for ``ROS_IP`` or ``ROS_HOSTNAME``.

    Returns:
        The master's URI.

    Raises:
        InputError: The master runs on another machine, which could not reach a node on 127.0.0.1.
    """
    uri = os.environ.setdefault("ROS_MASTER_URI", DEFAULT_URI)
    host = urlparse(uri).hostname
    if host is None:
        raise InputError("ROS_MASTER_URI", uri, f"is no address such as {DEFAULT_URI}")
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
        InputError: None does.
    """
    deadline = time.monotonic() + PATIENCE
    with closing(Master("/wherry", uri)) as master:
        while True:
            try:
                master.ask("getPid")
            except MasterError as error:
                if time.monotonic() > deadline:
                    reason = "no ROS master answers there; start one: roscore"
                    raise InputError("ROS_MASTER_URI", uri, reason) from error
                time.sleep(LOOK_EVERY)
            else:
                return


class MasterWatch:
    """Looks at the master again and again, knows who else is there, and registers the node with a new master.

    rospy registers once. When a master dies, its nodes go on talking to each other, but a new master knows none of
    them, and no one could join any more.

    Args:
        node: The node's absolute name.
        node_uri: Where the node's own XML-RPC answers.
        master_uri: Where the master is.

    Attributes:
        reached: Whether the master answered the last time.
    """

    def __init__(self, node: str, node_uri: str, master_uri: str) -> None:
        self._node = node
        self._node_uri = node_uri
        self._master = Master(node, master_uri)
        self._registrations: set[Registration] = set()
        self._parameters: dict[str, Any] = {}
        self._others: dict[tuple[str, str], int] = {}
        self._lock = threading.Lock()  # one thread at a time asks the master
        self._stopped = threading.Event()
        self.reached = True
        self._thread = threading.Thread(target=self._run, name="ROS master", daemon=True)
        self._thread.start()

    def keep(self, registration: Registration) -> None:
        """Hold on to a registration that rospy has made."""
        with self._lock:
            self._registrations.add(registration)
            self._look()

    def set_parameter(self, name: str, value: bool | float | str) -> None:
        """Set a parameter, and again on every new master.

        Raises:
            MasterError: The master does not answer.
        """
        with self._lock:
            self._parameters[name] = value
            self._master.ask("setParam", name, value)

    def others(self, role: str, topic: str) -> int:
        """How many other nodes that are alive publish, or subscribe to, a topic that this node has registered for."""
        return self._others.get((role, topic), 0)

    def stop(self) -> None:
        """Look no more."""
        self._stopped.set()
        self._thread.join()
        self._master.close()

    def _run(self) -> None:
        while not self._stopped.wait(LOOK_EVERY):
            with self._lock:
                self._look()

    def _look(self) -> None:
        """Find out who is there, and register what the master does not know."""
        try:
            publishers, subscribers, _ = self._master.ask("getSystemState")
            known = {
                (role, topic): nodes
                for role, state in ((PUBLISHER, publishers), (SUBSCRIBER, subscribers))
                for topic, nodes in state
            }
            missing = [one for one in self._registrations if self._node not in known.get((one.role, one.topic), ())]
            if missing and not self._is_replaced():
                self._register(missing)
            self._others = self._count(known)
            self.reached = True
        except MasterError:
            self.reached = False

    def _is_replaced(self) -> bool:
        """Whether another node has taken this one's name, which ROS answers by shutting this one down."""
        try:
            return bool(self._master.ask("lookupNode", self._node) != self._node_uri)
        except RefusalError:
            return False

    def _register(self, missing: list[Registration]) -> None:
        """Tell a new master what the old one knew; publishers first, so that no subscriber loses one."""
        for name, value in self._parameters.items():
            self._master.ask("setParam", name, value)
        for one in sorted(missing, key=lambda one: one.role):
            answer = self._master.ask(f"register{one.role}", one.topic, one.type_name, self._node_uri)
            if one.role == SUBSCRIBER:  # the answer is who publishes; rospy takes that from a master's call alone
                with ServerProxy(self._node_uri, transport=_Impatient()) as node:
                    node.publisherUpdate("/master", one.topic, answer)

    def _count(self, known: dict[tuple[str, str], list[str]]) -> dict[tuple[str, str], int]:
        """Who else is there by role and topic, for the topics of this node."""
        topics = {one.topic for one in self._registrations}
        nodes = {
            key: [name for name in names if name != self._node] for key, names in known.items() if key[1] in topics
        }
        alive = {name: self._master.is_alive(name) for name in set().union(*nodes.values())}
        return {key: sum(alive[name] for name in names) for key, names in nodes.items()}
