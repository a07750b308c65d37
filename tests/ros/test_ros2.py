from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from wherry.errors import InputError
from wherry.ros import messages as ros
from wherry.ros.message_fields import Field, Message, fields_of
from wherry.ros.messages import message_types
from wherry.ros.names import load_names
from wherry.ros.transports.ros2 import Ros2Transport
from wherry.ros.transports.ros2_domains import configuration, domain_id, own_sockets
from wherry.ros.transports.ros2_messages import from_idl, idl_class, to_idl
from wherry_testing.bus import free_domain

TOPICS = load_names().topics
STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = message_types()
PAIR, KILLED, HUNG, NOWHERE = (free_domain() for _ in range(4))
NUMBERS = np.random.default_rng(0)


def filled(message_type: type[Message]) -> Any:
    """A message with all fields different from their defaults."""
    return message_type(*(_filled_value(entry) for entry in fields_of(message_type)))


def _filled_value(entry: Field) -> Any:
    count = 3 if entry.length == 0 else entry.length
    if not isinstance(entry.type, str):
        return filled(entry.type) if count is None else tuple(filled(entry.type) for _ in range(count))
    if entry.type == "string":
        return "wörd" if count is None else ("one", "", "three")
    if entry.type == "bool":
        return True
    dtype = np.dtype("uint8" if entry.type == "byte" else entry.type)
    values = NUMBERS.integers(1, 100, count or 1).astype(dtype)
    return values if count is not None else values[0].item()


def as_real(message: Message) -> Any:
    """The same message in the classes of rosbags, which serialize as ROS does."""
    values = [getattr(message, entry.name) for entry in fields_of(type(message))]
    return STORE.types[type(message).type_name](*(_real_value(value) for value in values))


def _real_value(value: Any) -> Any:
    if isinstance(value, Message):
        return as_real(value)
    if isinstance(value, tuple):
        return [_real_value(item) for item in value]
    return value


def same(one: Any, other: Any) -> bool:
    if isinstance(one, Message):
        return type(one) is type(other) and all(
            same(getattr(one, entry.name), getattr(other, entry.name))
            for entry in fields(one)  # type: ignore[arg-type]
        )
    if isinstance(one, np.ndarray):
        return bool(one.dtype == other.dtype and np.array_equal(one, other))
    if isinstance(one, tuple):
        return isinstance(other, tuple) and len(one) == len(other) and all(map(same, one, other))
    return bool(one == other)


@pytest.mark.parametrize("type_name", sorted(TYPES))
def test_messages_are_serialized_as_ros_serializes_them(type_name: str) -> None:
    message = filled(TYPES[type_name])
    ours = to_idl(message).serialize(use_version_2=False)
    theirs = bytes(STORE.serialize_cdr(as_real(message), type_name))
    assert ours[4:] == theirs[4 : len(ours)]  # after the representation's header
    assert len(theirs) - len(ours) < 4  # padding


@pytest.mark.parametrize("type_name", sorted(TYPES))
def test_messages_survive_serialization(type_name: str) -> None:
    message = filled(TYPES[type_name])
    sample = idl_class(TYPES[type_name]).deserialize(to_idl(message).serialize(use_version_2=False))
    assert same(from_idl(TYPES[type_name], sample), message)


def test_idl_types_have_ros_names() -> None:
    assert idl_class(ros.LaserScan).__idl_typename__.replace(".", "::") == "sensor_msgs::msg::dds_::LaserScan_"


def test_without_cyclonedds_the_error_says_what_to_install() -> None:
    program = "import sys; sys.modules['cyclonedds'] = None; from wherry.cli import main; main()"
    command = [sys.executable, "-c", program, "ros2", "monitor", "--duration", "0"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr == "wherry: ROS 2: cyclonedds: is not installed: pip install 'wherry[ros2]'\n"


def test_the_default_configuration_is_confined_to_loopback() -> None:
    assert 'name="lo"' in configuration("lo")
    assert "<AllowMulticast>false" in configuration("lo")
    assert 'name="eth0"' in configuration("eth0")
    assert "127.0.0.1" not in configuration("eth0")


def test_nothing_is_received_from_a_network_by_default() -> None:
    """In a process of its own, whose sockets are all those of DDS."""
    program = (
        "import socket\n"
        "from wherry.ros.names import load_names; from wherry.ros.transports.ros2 import Ros2Transport\n"
        "from wherry.ros.transports.ros2_domains import own_sockets\n"
        "with Ros2Transport() as one:\n"
        "    topic = load_names().topics.scan\n"
        "    one.subscribe(topic, print); one.advertise(topic)\n"
        "    for s in own_sockets():\n"
        "        device = s.getsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, 16).rstrip(bytes(1)).decode()\n"
        "        print(s.getsockname()[0], device)"
    )
    environment = {**os.environ, "ROS_DOMAIN_ID": str(NOWHERE)}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    sockets = [line.split(" ") for line in done.stdout.splitlines()]
    assert len(sockets) >= 3
    for address, device in sockets:
        assert address == "127.0.0.1" or device == "lo"


def test_own_sockets_are_neither_duplicated_nor_closed() -> None:
    ours, theirs = socket.socketpair()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp, ours, theirs, Path(os.devnull).open("rb") as file:
        before = open_descriptors()
        found = [own.fileno() for own in own_sockets()]
        assert open_descriptors() == before
        assert udp.fileno() in found
        assert not {ours.fileno(), theirs.fileno(), file.fileno()} & set(found), "neither Unix sockets nor files"


def test_closed_domains_leave_no_descriptors_and_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    counts = []
    for domain in (NOWHERE, PAIR, KILLED, HUNG) * 3:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        with Ros2Transport() as one, Ros2Transport() as other:
            one.subscribe(TOPICS.scan, Inbox())
            other.publish(TOPICS.scan, ros.LaserScan())
        counts.append((len(open_descriptors()), threading.active_count()))
    assert len(set(counts)) == 1


def test_a_domain_stays_open_until_its_last_transport_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(PAIR))
    inbox = Inbox()
    with Ros2Transport() as one, Ros2Transport() as other:
        Ros2Transport().close()
        other.subscribe(TOPICS.clock, inbox)
        wait_until(lambda: one.count_subscribers(TOPICS.clock) == 1)
        one.advertise(TOPICS.clock)
        wait_until(lambda: other.count_publishers(TOPICS.clock) == 1)
        one.publish(TOPICS.clock, ros.Clock(ros.Time(3)))
        assert inbox.wait_for(1)[0].clock.sec == 3


def open_descriptors() -> list[str]:
    """Open file descriptors of this process, among them the one that lists them."""
    return sorted(os.listdir("/proc/self/fd"))  # noqa: PTH208 - the names are numbers


@pytest.mark.parametrize("text", ["-1", "233", "one", "1.0", "١"])
def test_an_invalid_domain_is_refused(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    with pytest.raises(InputError, match="ROS_DOMAIN_ID"):
        domain_id()


def test_the_domain_is_taken_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    assert domain_id() == 7
    monkeypatch.delenv("ROS_DOMAIN_ID")
    assert domain_id() == 0


def test_a_missing_interface_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(NOWHERE))
    with pytest.raises(InputError, match="--interface: nowhere0"):
        Ros2Transport("nowhere0")


class Inbox:
    """A callback that collects messages, and can wait for them."""

    def __init__(self) -> None:
        self.messages: list[Any] = []
        self._arrived = threading.Condition()

    def __call__(self, message: Message) -> None:
        with self._arrived:
            self.messages.append(message)
            self._arrived.notify_all()

    def wait_for(self, count: int) -> list[Any]:
        with self._arrived:
            assert self._arrived.wait_for(lambda: len(self.messages) >= count, timeout=10.0), "too few messages arrived"
        return self.messages


@pytest.fixture
def pair(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Ros2Transport, Ros2Transport]]:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(PAIR))
    with Ros2Transport() as one, Ros2Transport() as other:
        yield one, other


def wait_until(condition: Any) -> None:
    deadline = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < deadline, "the condition was not met in time"
        time.sleep(0.01)


def test_messages_arrive_in_order(pair: tuple[Ros2Transport, Ros2Transport]) -> None:
    one, other = pair
    inbox = Inbox()
    other.subscribe(TOPICS.tf, inbox)
    one.advertise(TOPICS.tf)
    wait_until(lambda: one.count_subscribers(TOPICS.tf) == 1 and other.count_publishers(TOPICS.tf) == 1)
    for second in range(50):
        one.publish(TOPICS.tf, ros.TFMessage((ros.TransformStamped(ros.Header(ros.Time(second))),)))
    arrived = [message.transforms[0].header.stamp.sec for message in inbox.wait_for(50)]
    assert arrived == list(range(50))


def test_late_subscribers_get_the_last_latched_message(pair: tuple[Ros2Transport, Ros2Transport]) -> None:
    one, other = pair
    grid = filled(ros.OccupancyGrid)
    one.publish(TOPICS.map, ros.OccupancyGrid())
    one.publish(TOPICS.map, grid)
    inbox = Inbox()
    other.subscribe(TOPICS.map, inbox)
    assert same(inbox.wait_for(1)[0], grid)
    time.sleep(0.1)
    assert len(inbox.messages) == 1


def test_a_string_that_is_not_utf8_is_dropped(
    pair: tuple[Ros2Transport, Ros2Transport], monkeypatch: pytest.MonkeyPatch
) -> None:
    one, other = pair
    inbox, broken = Inbox(), []
    text_class = idl_class(ros.String)
    deserialize = text_class.deserialize

    def fail_once(data: bytes, **options: Any) -> Any:
        if not broken:
            broken.append(data)
            raise UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid start byte")
        return deserialize(data, **options)

    monkeypatch.setattr(text_class, "deserialize", fail_once)
    other.subscribe(TOPICS.robot_description, inbox)
    one.publish(TOPICS.robot_description, ros.String("one"))
    wait_until(lambda: bool(broken))
    one.publish(TOPICS.robot_description, ros.String("two"))
    assert inbox.wait_for(1)[0].data == "two"


def test_both_types_of_velocity_share_a_topic(pair: tuple[Ros2Transport, Ros2Transport]) -> None:
    one, other = pair
    plain, stamped = Inbox(), Inbox()
    assert TOPICS.cmd_vel.name == TOPICS.cmd_vel_stamped.name
    other.subscribe(TOPICS.cmd_vel, plain)
    other.subscribe(TOPICS.cmd_vel_stamped, stamped)
    one.advertise(TOPICS.cmd_vel)
    one.advertise(TOPICS.cmd_vel_stamped)
    wait_until(lambda: one.count_subscribers(TOPICS.cmd_vel) == 2)
    time.sleep(0.2)
    one.publish(TOPICS.cmd_vel, ros.Twist(ros.Vector3(0.1)))
    one.publish(TOPICS.cmd_vel_stamped, ros.TwistStamped(twist=ros.Twist(ros.Vector3(0.2))))
    assert plain.wait_for(1)[0].linear.x == 0.1
    assert stamped.wait_for(1)[0].twist.linear.x == 0.2


def test_only_other_participants_are_counted(pair: tuple[Ros2Transport, Ros2Transport]) -> None:
    one, other = pair
    one.advertise(TOPICS.scan)
    other.advertise(TOPICS.scan)
    wait_until(lambda: one.count_publishers(TOPICS.scan) == other.count_publishers(TOPICS.scan) == 1)
    assert one.count_publishers(TOPICS.odom) == 0
    other.close()


def test_no_messages_of_a_killed_process_arrive(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(KILLED))
    program = (
        "import time; from wherry.ros.transports.ros2 import Ros2Transport; from wherry.ros.names import load_names\n"
        "from wherry.ros.messages import Bool, Twist\n"
        "transport, topics = Ros2Transport(), load_names().topics\n"
        "while True: transport.publish(topics.cmd_vel, Twist()); time.sleep(0.02)"
    )
    with Ros2Transport() as transport:
        inbox = Inbox()
        transport.subscribe(TOPICS.cmd_vel, inbox)
        with subprocess.Popen([sys.executable, "-c", program], env=os.environ) as process:
            inbox.wait_for(5)
            process.kill()
        time.sleep(0.3)
        count = len(inbox.messages)
        time.sleep(0.3)
        assert len(inbox.messages) == count


@pytest.mark.realtime
def test_a_hanging_subscriber_does_not_block_the_publisher(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(HUNG))
    program = (
        "import time; from wherry.ros.transports.ros2 import Ros2Transport; from wherry.ros.names import load_names\n"
        "transport, topics = Ros2Transport(), load_names().topics\n"
        "transport.subscribe(topics.tf, lambda message: None); time.sleep(60)"
    )
    with Ros2Transport() as transport, subprocess.Popen([sys.executable, "-c", program], env=os.environ) as process:
        try:
            transport.advertise(TOPICS.tf)
            wait_until(lambda: transport.count_subscribers(TOPICS.tf) == 1)
            process.send_signal(19)  # SIGSTOP
            message = replace(filled(ros.TFMessage))
            longest = 0.0
            for _ in range(500):
                started = time.perf_counter()
                transport.publish(TOPICS.tf, message)
                longest = max(longest, time.perf_counter() - started)
            assert longest < 0.1
        finally:
            process.kill()
