"""``wherry ros1 simulate`` over a real roscore, as a node of Debian's rospy sees it."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from contextlib import closing
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from wherry.floorplan.world_files import find_world
from wherry.robot import Scan
from wherry.ros.transports.ros1_master import Master
from wherry.simulation import build
from wherry.simulation.drive import WHEEL_RADIUS
from wherry.simulation.seeded_worlds import seed_world
from wherry_testing.robots_clock import STOPPING_RESOLUTION
from wherry_testing.ros1_system import Peer, Program, Roscore, heading, require, stamp, values_of, wait_until

pytestmark = pytest.mark.realtime

SIMULATE = ("ros1", "simulate", "small", "--boxes", "2", "--seed", "5")
TWIST = "geometry_msgs/Twist"
SUBSCRIBED = {
    "/scan": "sensor_msgs/LaserScan",
    "/odom": "nav_msgs/Odometry",
    "/tf": "tf2_msgs/TFMessage",
    "/clock": "rosgraph_msgs/Clock",
    "/joint_states": "sensor_msgs/JointState",
    "/diagnostics": "diagnostic_msgs/DiagnosticArray",
}


@pytest.fixture(scope="module")
def roscore(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Roscore]:
    require("roscore")
    with Roscore(tmp_path_factory.mktemp("ros1")) as roscore:
        yield roscore


@pytest.fixture(scope="module")
def simulator(roscore: Roscore) -> Iterator[Program]:
    with roscore.wherry(*SIMULATE) as simulator:
        yield simulator


@pytest.fixture(scope="module")
def peer(roscore: Roscore, simulator: Program) -> Iterator[Peer]:
    """A node that subscribes before the simulator publishes."""
    with roscore.peer() as peer:
        for topic, type_name in SUBSCRIBED.items():
            peer.listen(topic, type_name)
        wait_until(lambda: len(peer.received["/scan"]) >= 3, 60.0, f"scans\n{simulator.output}")
        yield peer


def test_scans_equal_those_of_the_simulation(peer: Peer) -> None:
    world = seed_world(find_world("small"), 2, 5)
    simulation = build(world.plan, world.physics_rng)
    scans = {round(stamp(scan), 6): scan for scan in peer.wait_for("/scan", 3, 5.0)}
    compared = 0
    while simulation.time < max(scans):
        simulation.advance()
        for expected in simulation.measure():
            if isinstance(expected, Scan) and (found := scans.get(round(expected.time, 6))) is not None:
                assert np.array_equal(found["ranges"], expected.ranges.astype(np.float32), equal_nan=True)
                compared += 1
    assert compared >= 3


def test_messages_follow_ros_conventions(peer: Peer) -> None:
    scan = peer.last("/scan")
    assert scan["header"]["frame_id"] == "laser"
    assert scan["angle_min"] == pytest.approx(-math.pi)
    assert scan["angle_min"] + (len(scan["ranges"]) - 1) * scan["angle_increment"] == pytest.approx(scan["angle_max"])
    assert scan["scan_time"] == pytest.approx(0.1)
    odometry = peer.last("/odom")
    assert (odometry["header"]["frame_id"], odometry["child_frame_id"]) == ("odom", "base_link")
    assert len(odometry["pose"]["covariance"]) == 36
    joints = {joint.get("name") for joint in _description(peer).iter("joint") if joint.get("type") == "continuous"}
    assert set(peer.last("/joint_states")["name"]) == joints
    assert peer.parameter("/use_sim_time") is True


def test_transforms_precede_scans(peer: Peer) -> None:
    shift = peer.transform("odom", "laser")
    assert shift == pytest.approx([-0.17, 0.0, 0.15, 0.0, 0.0, 0.0, 1.0], abs=0.01), "real tf2, robot at its start"
    transforms = {
        stamp(link): entry["at"] for entry in list(peer.received["/tf"]) for link in entry["message"]["transforms"]
    }
    scans = list(peer.received["/scan"])[:-1]
    lag = np.array([transforms[stamp(entry["message"])] - entry["at"] for entry in scans])
    assert np.median(lag) < 0.0, "the transform comes first"
    assert np.quantile(lag, 0.9) < 0.05, "two connections may race, but not as long as from one odometry to the next"


def test_all_stamps_are_of_one_clock(peer: Peer) -> None:
    clocks = [entry["message"]["clock"] for entry in list(peer.received["/clock"])]
    times = [clock["secs"] + 1e-9 * clock["nsecs"] for clock in clocks]
    assert times == sorted(times)
    assert np.diff(times).max() < 0.05 + 1e-6, "published with every odometry and in between"
    for topic in ("/scan", "/odom", "/joint_states"):
        assert stamp(peer.last(topic)) == pytest.approx(times[-1], abs=1.0)


def test_robot_obeys_velocities_and_stops_without_them(peer: Peer) -> None:
    before = peer.last("/odom")
    wheel = peer.last("/joint_states")["position"][0]
    for _ in range(10):
        peer.send("/cmd_vel", TWIST, {"linear": {"x": 0.2}})
        _let_pass(peer, 0.1)
    last_command = stamp(peer.last("/odom"))
    wait_until(lambda: _speed(peer.last("/odom")) < 0.005, 5.0, "the robot stands")
    assert stamp(peer.last("/odom")) - last_command <= 0.5 + STOPPING_RESOLUTION
    _let_pass(peer, 0.2)
    after = peer.last("/odom")
    driven = math.hypot(*(_place(after) - _place(before)))
    assert 0.15 < driven < 0.35
    assert heading(after["pose"]["pose"]["orientation"]) == pytest.approx(0.0, abs=0.05)
    turned = peer.last("/joint_states")["position"][0] - wheel
    assert turned * WHEEL_RADIUS == pytest.approx(driven, rel=0.05), "joint angles match the distance driven"


def test_positive_angular_velocity_turns_left(peer: Peer) -> None:
    before = heading(peer.last("/odom")["pose"]["pose"]["orientation"])
    for _ in range(5):
        peer.send("/cmd_vel", TWIST, {"angular": {"z": 0.5}})
        _let_pass(peer, 0.1)
    assert 0.05 < heading(peer.last("/odom")["pose"]["pose"]["orientation"]) - before < 0.5
    _let_pass(peer, 0.6)


@pytest.mark.parametrize("speed", [math.nan, math.inf, 1e9])
def test_invalid_velocities_stop_the_robot(peer: Peer, speed: float) -> None:
    for _ in range(3):
        peer.send("/cmd_vel", TWIST, {"linear": {"x": 0.2}})
        _let_pass(peer, 0.1)
    assert _speed(peer.last("/odom")) > 0.05
    peer.send("/cmd_vel", TWIST, {"linear": {"x": speed}})
    _let_pass(peer, 0.35)
    assert _speed(peer.last("/odom")) < 0.01
    wait_until(lambda: "has the speed" in _simulator(peer).get("last refused", ""), 3.0, "diagnostics give the reason")


def test_second_publisher_of_velocities_is_reported(roscore: Roscore, peer: Peer) -> None:
    peer.send("/cmd_vel", TWIST, {})
    wait_until(lambda: _simulator(peer).get("publishers of velocities") == "1", 5.0, "one publisher")
    with roscore.peer("second") as second:
        second.send("/cmd_vel", TWIST, {})
        wait_until(lambda: _simulator(peer).get("publishers of velocities") == "2", 5.0, "two publishers")
        assert "2 publishers command the robot" in _simulator(peer)["message"]
    wait_until(lambda: _simulator(peer).get("publishers of velocities") == "1", 5.0, "one again")


def test_node_survives_the_master_and_registers_with_the_next(roscore: Roscore, simulator: Program, peer: Peer) -> None:
    before = len(peer.received["/scan"])
    roscore.kill()
    peer.wait_for("/scan", before + 10, 5.0)
    roscore.start()
    with roscore.peer("newcomer") as newcomer:
        newcomer.listen("/scan", SUBSCRIBED["/scan"])
        newcomer.wait_for("/scan", 5, 10.0)
        assert newcomer.parameter("/use_sim_time") is True
        assert newcomer.transform("odom", "laser")[2] == pytest.approx(0.15), "static transforms are latched"
        assert "wherry" in newcomer.parameter("/robot_description")


def test_namespace_and_frame_prefix(roscore: Roscore) -> None:
    options = ("--frame-prefix", "robot2/", "--remap", "odom:=wheels", "--namespace", "robot2")
    with roscore.wherry(*SIMULATE, *options) as simulator, roscore.peer("other") as peer:
        peer.listen("/robot2/scan", SUBSCRIBED["/scan"])
        peer.listen("/robot2/wheels", SUBSCRIBED["/odom"])
        wait_until(lambda: peer.received["/robot2/scan"], 60.0, f"a scan\n{simulator.output}")
        assert peer.last("/robot2/scan")["header"]["frame_id"] == "robot2/laser"
        peer.wait_for("/robot2/wheels", 1, 5.0)
        assert peer.transform("robot2/odom", "robot2/laser")[2] == pytest.approx(0.15)
        assert "wherry" in peer.parameter("/robot2/robot_description")


def test_arguments_of_roslaunch(roscore: Roscore) -> None:
    """roslaunch sets ROS_NAMESPACE, and appends the node's name, its log file and the remappings."""
    appended = ("scan:=front/scan", "__name:=lidar_robot", "__log:=/dev/null")
    environment = {**roscore.environment, "ROS_NAMESPACE": "/robot3"}
    command = [sys.executable, "-m", "wherry", *SIMULATE, *appended]
    with Program(command, environment) as simulator, roscore.peer("launched") as peer:
        peer.listen("/robot3/front/scan", SUBSCRIBED["/scan"])
        wait_until(lambda: peer.received["/robot3/front/scan"], 60.0, f"a scan\n{simulator.output}")
        with closing(Master("/test", roscore.environment["ROS_MASTER_URI"])) as master:
            assert master.is_alive("/robot3/lidar_robot")


def _description(peer: Peer) -> ElementTree.Element:
    return ElementTree.fromstring(peer.parameter("/robot_description"))  # noqa: S314 - it is our own


def _simulator(peer: Peer) -> dict[str, str]:
    for entry in reversed(peer.received["/diagnostics"]):
        if found := values_of(entry["message"], "wherry: simulator"):
            return found
    return {}


def _let_pass(peer: Peer, seconds: float) -> None:
    """Wait on the robot's clock."""
    end = stamp(peer.last("/odom")) + seconds
    wait_until(lambda: stamp(peer.last("/odom")) >= end - 1e-6, 20.0 * seconds + 5.0, "time passes")


def _speed(odometry: dict[str, Any]) -> float:
    twist = odometry["twist"]["twist"]
    return math.hypot(twist["linear"]["x"], twist["angular"]["z"])


def _place(odometry: dict[str, Any]) -> np.ndarray:
    position = odometry["pose"]["pose"]["position"]
    return np.array([position["x"], position["y"]])
