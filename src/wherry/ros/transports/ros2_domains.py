"""The DDS domains of this process, by default confined to the loopback interface."""

from __future__ import annotations

import os
import socket
import stat
import threading
from collections.abc import Iterator
from xml.sax.saxutils import quoteattr

from cyclonedds.domain import Domain, DomainParticipant

from wherry.errors import InputError

LOOPBACK = "lo"
MAX_DOMAIN = 232  # beyond it, DDS runs out of UDP ports
FIRST_PORT, PORTS_PER_DOMAIN = 7400, 250  # UDP (DDS wire protocol, section 9.6.1)
MAX_PARTICIPANTS = 60  # per machine, that discovery without multicast looks for


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


class Domains:
    """The DDS domains of a process: each is created for its first participant and deleted with its last one.

    A domain owns sockets and threads, and has to be configured before its first participant is created.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._domains: dict[tuple[int, str], tuple[Domain, int]] = {}  # with the number of participants

    def join(self, number: int, interface: str) -> DomainParticipant:
        """Create a participant, and its domain if this is the first one.

        Raises:
            DDSException: DDS cannot use the interface, or the domain uses another one already.
            OSError: The system does not allow the sockets to be bound to the loopback interface.
        """
        with self._lock:
            domain, participants = self._domains.get((number, interface), (None, 0))
            if domain is None:
                domain = Domain(number, configuration(interface))
                if interface == LOOPBACK:
                    _bind_to_loopback(number)
            participant = DomainParticipant(number)
            self._domains[number, interface] = domain, participants + 1
            return participant

    def leave(self, number: int, interface: str) -> None:
        """Count a participant that was deleted; after the last one, delete the domain."""
        with self._lock:
            domain, participants = self._domains.pop((number, interface))
            if participants > 1:
                self._domains[number, interface] = domain, participants - 1


DOMAINS = Domains()


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
