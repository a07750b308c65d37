"""`RosRobot` and the simulator as two processes over DDS: the robot contract, and the loss of either process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from wherry.robot import Odometry, Velocity
from wherry.ros import messages as ros
from wherry.ros.body_files import load_body
from wherry.ros.decoding import decode_odometry
from wherry.ros.encoding import encode_twist
from wherry.ros.names import load_names
from wherry.ros.nodes.robot import RosRobot
from wherry.ros.nodes.simulator import simulator_node
from wherry.ros.transports.ros2 import Ros2Transport
from wherry_testing.bus import free_domain
from wherry_testing.dds import ended, simulator, wait_until
from wherry_testing.node_thread import running
from wherry_testing.robot_contract import RobotContract
from wherry_testing.robots_clock import STOPPING_RESOLUTION, ReceivedOdometry, stopping_time
from wherry_testing.worlds import HALL, hall

NAMES = load_names()
TOPICS = NAMES.topics
RATE = 1.5  # simulated seconds per second
EMPTY = HALL.replace("  o  ", "     ")
CONTRACT, PROCESSES = free_domain(), free_domain()

pytestmark = [pytest.mark.slow, pytest.mark.realtime]

DRIVER = """
import time
from wherry.ros.names import load_names
from wherry.ros.messages import Twist, Vector3
from wherry.ros.transports.ros2 import Ros2Transport
transport, topics = Ros2Transport(), load_names().topics
while True:
    transport.publish(topics.cmd_vel, Twist(Vector3(0.3)))
    time.sleep(0.02)
"""


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("world") / "hall.txt"
    path.write_text(HALL)
    return path


class TestRosRobot(RobotContract):
    @pytest.fixture
    def robot(self, monkeypatch: pytest.MonkeyPatch) -> Iterator[RosRobot]:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(CONTRACT))
        with Ros2Transport() as robots, Ros2Transport() as transport, RosRobot(transport, NAMES, load_body()) as robot:
            node = simulator_node(hall(EMPTY), robots, NAMES, RATE)
            with running(node):
                robot.wait_until_ready(60.0)
                yield robot


class Watcher:
    """Records the robot's odometry."""

    def __init__(self, transport: Ros2Transport) -> None:
        self.odometry: list[Odometry] = []
        self.arrived: list[float] = []
        transport.subscribe(TOPICS.odom, self._on_odometry)

    def _on_odometry(self, message: ros.Odometry) -> None:
        self.odometry.append(decode_odometry(message, "odom", "base_link"))
        self.arrived.append(time.monotonic())

    @property
    def speed(self) -> float:
        return self.odometry[-1].velocity.linear if self.odometry else 0.0

    def travelled_since(self, when: float) -> float:
        """Distance between the first pose since ``when``, s, and the last one, m."""
        poses = [odometry.pose for odometry in self.odometry if odometry.time >= when]
        return poses[0].distance_to(poses[-1])

    def stopped_after(self, begin: float) -> float:
        """Time on the robot's clock from an instant of the monotonic clock until the robot stood, s."""
        messages = zip(self.arrived, self.odometry, strict=False)
        return stopping_time(
            [ReceivedOdometry(at, odometry.time, odometry.velocity.linear) for at, odometry in messages], begin
        )


@pytest.fixture
def transport(monkeypatch: pytest.MonkeyPatch) -> Iterator[Ros2Transport]:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(PROCESSES))
    with Ros2Transport() as transport:
        yield transport


def test_robot_stops_half_a_second_after_its_driver_is_killed(world: Path, transport: Ros2Transport) -> None:
    watcher = Watcher(transport)
    with simulator(world, PROCESSES), subprocess.Popen([sys.executable, "-c", DRIVER], env=os.environ) as driver:
        try:
            wait_until(lambda: watcher.speed > 0.25)
        finally:
            driver.kill()  # -9
        killed, begin = time.monotonic(), watcher.odometry[-1].time
        wait_until(lambda: watcher.odometry[-1].time > begin + 1.5)
        stopped_after = watcher.stopped_after(killed)
        assert stopped_after <= 0.5 + STOPPING_RESOLUTION
        assert abs(watcher.speed) < 0.01
        assert watcher.travelled_since(begin + 1.0) < 0.005
        assert watcher.travelled_since(begin) > 0.03  # it was driving


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("is_recorded", [False, True])
def test_interrupted_simulation_prints_its_summary(
    number: signal.Signals, is_recorded: bool, world: Path, transport: Ros2Transport
) -> None:
    watcher = Watcher(transport)
    bag = world.with_name(f"{number.name}.bag")
    with simulator(world, PROCESSES, "--rate", "5", *(("--record", str(bag)) if is_recorded else ())) as process:
        wait_until(lambda: bool(watcher.odometry), 60.0)
        summary = ended(process, number)
    assert process.returncode == 0
    assert summary["sim_seconds"] > 0.0
    assert bag.is_file() == is_recorded


def test_simulation_ends_after_its_duration_and_prints_its_summary(world: Path, transport: Ros2Transport) -> None:
    watcher = Watcher(transport)
    with simulator(world, PROCESSES, "--rate", "5", "--duration", "5") as process:
        wait_until(lambda: bool(watcher.odometry))
        while process.poll() is None and watcher.odometry[-1].time < 2.0:
            transport.publish(TOPICS.cmd_vel, encode_twist(Velocity(0.2)))
            time.sleep(0.02)
        summary = ended(process, timeout=60.0)
    assert summary["sim_seconds"] == pytest.approx(5.0, abs=0.11)
    assert summary["boxes"] == 1
    assert summary["collisions"] == summary["delivered"] == 0
    assert process.returncode == 0
    assert watcher.odometry[-1].pose.x > 0.1
