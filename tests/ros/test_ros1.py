"""`Ros1Transport` in a real ROS 1: with a roscore, and a node of Debian's rospy as the peer."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from wherry.errors import InputError
from wherry.ros.transports.ros1_master import Master, MasterError, choose_interface, wait_for_master
from wherry_testing.ros1_system import Peer, Program, Roscore, require, wait_until

pytestmark = pytest.mark.realtime

SCAN, STRING = "sensor_msgs/LaserScan", "std_msgs/String"
ECHO = """
import sys
from wherry.errors import InputError
from wherry.ros.messages import LaserScan, String
from wherry.ros.transports.ros1 import Ros1Transport
from wherry.ros.topics import QosProfile, Topic

there, back = (Topic(name, LaserScan, QosProfile.SENSOR) for name in ("/there", "/back"))
latched = Topic("/latched", String, QosProfile.LATCHED)
with Ros1Transport(sys.argv[1], sys.argv[2]) as node:
    node.set_parameter("/answer", 42)
    node.publish(latched, String("once"))
    node.advertise(back)
    node.subscribe(there, lambda scan: node.publish(back, scan))
    print("ready")
    for line in sys.stdin:
        try:
            node.publish(back, LaserScan())
        except InputError as error:
            print(error)
        else:
            print(node.count_publishers(there), node.count_subscribers(back), node.is_connected())
print("closed")
"""


@pytest.fixture(scope="module")
def roscore(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Roscore]:
    require("roscore")
    with Roscore(tmp_path_factory.mktemp("ros1")) as roscore:
        yield roscore


@pytest.fixture
def node(roscore: Roscore) -> Iterator[Program]:
    with roscore.python(ECHO, "echo", "") as node:
        wait_until(lambda: "ready" in node.output, 20.0, node.output)
        yield node


def ask(node: Program) -> str:
    """Ask the node for its numbers of publishers and subscribers and whether it is connected; or for its error."""
    said = len(node.lines)
    assert node.process.stdin is not None
    node.process.stdin.write("\n")
    node.process.stdin.flush()
    wait_until(lambda: len(node.lines) > said, 5.0, "an answer")
    return node.lines[said].strip()


def send(peer: Peer, topic: str, number: int) -> None:
    peer.send(topic, SCAN, {"header": {"frame_id": "laser"}, "scan_time": float(number), "ranges": [1.5] * 360})


def test_messages_are_exchanged_and_latched_ones_reach_late_subscribers(roscore: Roscore, node: Program) -> None:
    with roscore.peer() as peer:
        peer.listen("/latched", STRING)
        assert peer.wait_for("/latched", 1, 5.0) == [{"data": "once"}]
        peer.listen("/back", SCAN)
        for number in range(100):
            send(peer, "/there", number)
        echoed = peer.wait_for("/back", 100, 10.0)
    assert [scan["scan_time"] for scan in echoed] == list(range(100)), "all messages, in order"
    assert echoed[0]["header"]["frame_id"] == "laser"
    assert echoed[0]["ranges"] == [1.5] * 360


def test_other_living_nodes_are_counted(roscore: Roscore, node: Program) -> None:
    assert ask(node) == "0 0 True"
    with roscore.peer("one") as one, roscore.peer("two") as two:
        for peer in (one, two):
            send(peer, "/there", 0)
        one.listen("/back", SCAN)
        wait_until(lambda: ask(node) == "2 1 True", 5.0, "two publishers, one subscriber")
        two.kill()
        wait_until(lambda: ask(node) == "1 1 True", 5.0, "the master still lists the killed node")


def test_a_node_registers_again_with_a_new_master(roscore: Roscore, node: Program) -> None:
    with roscore.peer("before") as peer:
        peer.listen("/back", SCAN)
        send(peer, "/there", 1)
        peer.wait_for("/back", 1, 5.0)
        roscore.kill()
        wait_until(lambda: ask(node).endswith("False"), 5.0, "the node notices")
        count = len(peer.received["/back"])
        send(peer, "/there", 2)
        peer.wait_for("/back", count + 1, 5.0)
        assert peer.last("/back")["scan_time"] == 2.0, "topics work without a master"
    roscore.start()
    wait_until(lambda: ask(node).endswith("True"), 5.0, "the node is registered with the new master")
    with roscore.peer("after") as peer:
        peer.listen("/latched", STRING)
        assert peer.wait_for("/latched", 1, 5.0) == [{"data": "once"}]
        peer.listen("/back", SCAN)
        send(peer, "/there", 3)
        wait_until(
            lambda: any(entry["message"]["scan_time"] == 3.0 for entry in peer.received["/back"]), 5.0, "an echo"
        )
        assert peer.parameter("/answer") == 42


def test_a_node_listens_on_the_loopback_interface_only(node: Program) -> None:
    inodes = {entry.stat().st_ino for entry in Path(f"/proc/{node.process.pid}/fd").iterdir()}
    rows = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    listening = [row[1] for row in rows if row[3] == "0A" and int(row[9]) in inodes]
    assert len(listening) == 2, "one for XML-RPC, one for topics"
    assert {address.split(":")[0] for address in listening} == {"0100007F"}
    assert not Path("/proc/net/tcp6").exists() or not any(
        int(line.split()[9]) in inodes for line in Path("/proc/net/tcp6").read_text().splitlines()[1:]
    )


def test_a_node_is_replaced_by_one_of_the_same_name(roscore: Roscore, node: Program) -> None:
    with roscore.python(ECHO, "echo", "") as other:
        wait_until(lambda: "ready" in other.output, 20.0, other.output)
        wait_until(lambda: "another node of this name took its place" in ask(node), 5.0, "the first one reports it")
        assert ask(other).endswith("True")


def test_nodes_of_the_same_name_run_in_two_namespaces(roscore: Roscore, node: Program) -> None:
    with roscore.python(ECHO, "echo", "/robot2") as other:
        wait_until(lambda: "ready" in other.output, 20.0, other.output)
        wait_until(lambda: ask(node) == "0 0 True", 5.0, "the first one still runs")
        master = Master("/test", roscore.environment["ROS_MASTER_URI"])
        assert master.is_alive("/echo")
        assert master.is_alive("/robot2/echo")
        master.close()


def test_closing_unregisters_from_the_master(roscore: Roscore, node: Program) -> None:
    assert node.process.stdin is not None
    node.process.stdin.close()
    assert node.finish(10.0) == 0
    assert node.lines[-1] == "closed\n"
    master = Master("/test", roscore.environment["ROS_MASTER_URI"])
    publishers, subscribers, _ = master.call("getSystemState")
    master.close()
    assert "/echo" not in {name for _, names in publishers + subscribers for name in names}


# ---- without a master


@pytest.fixture
def environment(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    for name in ("ROS_MASTER_URI", "ROS_IP", "ROS_HOSTNAME"):
        monkeypatch.setenv(name, "")  # so that changes made in a test are undone
        monkeypatch.delenv(name)
    return monkeypatch


def test_nodes_listen_on_loopback_by_default(environment: pytest.MonkeyPatch) -> None:
    assert choose_interface() == "http://127.0.0.1:11311"
    assert os.environ["ROS_IP"] == "127.0.0.1"
    environment.setenv("ROS_IP", "192.0.2.1")
    choose_interface()
    assert os.environ["ROS_IP"] == "192.0.2.1"
    choose_interface("192.0.2.2")
    assert os.environ["ROS_IP"] == "192.0.2.2"


def test_a_remote_master_needs_an_address_that_it_can_reach(environment: pytest.MonkeyPatch) -> None:
    environment.setenv("ROS_MASTER_URI", "http://192.0.2.9:11311")
    with pytest.raises(InputError, match="set ROS_IP to the address"):
        choose_interface()
    assert choose_interface("192.0.2.1") == "http://192.0.2.9:11311"


@pytest.mark.parametrize("uri", ["nonsense", "", "http://"])
def test_an_invalid_master_uri_is_refused(environment: pytest.MonkeyPatch, uri: str) -> None:
    environment.setenv("ROS_MASTER_URI", uri)
    with pytest.raises(InputError, match="is not an address"):
        choose_interface()


def test_a_missing_master_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wherry.ros.transports.ros1_master.STARTUP_TIMEOUT", 0.3)
    with pytest.raises(InputError, match="no ROS master answers there; start one: roscore"):
        wait_for_master(f"http://127.0.0.1:{_closed_port()}")


def test_a_call_without_a_master_raises_a_master_error() -> None:
    master: Any = Master("/test", f"http://127.0.0.1:{_closed_port()}")
    with pytest.raises(MasterError, match="getPid"):
        master.call("getPid")
    master.close()


def _closed_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port
