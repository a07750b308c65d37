"""`RosRobot` and the simulator as two processes over DDS: the contract of robots, and what happens when one dies."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from wherry.pipelines.delivery.simulator import node_of
from wherry.robot import Odometry, Velocity
from wherry.ros import messages as ros
from wherry.ros.body_files import load_body
from wherry.ros.decoding import decode_odometry
from wherry.ros.encoding import encode_twist
from wherry.ros.names import load_names
from wherry.ros.nodes.robot import RosRobot
from wherry.ros.transports.ros2 import Ros2Transport
from wherry_testing.bus import free_domain
from wherry_testing.dds import ended, simulator, wait_until
from wherry_testing.robot_contract import RobotContract
from wherry_testing.robots_clock import STOPPING_RESOLUTION, ReceivedOdometry, stopping_time
from wherry_testing.worlds import HALL, hall

NAMES = load_names()
TOPICS = NAMES.topics
RATE = 1.5  # × real time; the contract watches the robot for half a minute
EMPTY = HALL.replace("  o  ", "     ")
CONTRACT, DEATHS = free_domain(), free_domain()

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
        over = threading.Event()
        with Ros2Transport() as robots, Ros2Transport() as transport, RosRobot(transport, NAMES, load_body()) as robot:
            node = node_of(hall(EMPTY), robots, NAMES, RATE)
            thread = threading.Thread(target=node.run, args=(over.is_set,))
            thread.start()
            try:
                robot.wait_until_ready(60.0)
                yield robot
            finally:
                over.set()
                thread.join()


class Watcher:
    """What the robot does, as an outsider sees it."""

    def __init__(self, transport: Ros2Transport) -> None:
        self.odometry: list[Odometry] = []
        self.arrived: list[float] = []
        transport.subscribe(TOPICS.odom, self._hear)

    def _hear(self, message: ros.Odometry) -> None:
        self.odometry.append(decode_odometry(message, "odom", "base_link"))
        self.arrived.append(time.monotonic())

    @property
    def speed(self) -> float:
        return self.odometry[-1].velocity.linear if self.odometry else 0.0

    def travelled_since(self, when: float) -> float:
        """m, from the first odometry that is dated after ``when`` on."""
        poses = [odometry.pose for odometry in self.odometry if odometry.time >= when]
        return poses[0].distance_to(poses[-1])

    def stopped_after(self, begin: float) -> float:
        """s on the robot's clock until it stood, from an instant of the monotonic clock on."""
        heard = zip(self.arrived, self.odometry, strict=False)
        return stopping_time(
            [ReceivedOdometry(at, odometry.time, odometry.velocity.linear) for at, odometry in heard], begin
        )


@pytest.fixture
def transport(monkeypatch: pytest.MonkeyPatch) -> Iterator[Ros2Transport]:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(DEATHS))
    with Ros2Transport() as transport:
        yield transport


def test_the_robot_stands_half_a_second_after_its_driver_is_killed(world: Path, transport: Ros2Transport) -> None:
    watcher = Watcher(transport)
    with simulator(world, DEATHS), subprocess.Popen([sys.executable, "-c", DRIVER], env=os.environ) as driver:
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


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("is_recorded", [False, True])
def test_a_simulation_that_is_asked_to_end_still_says_what_its_referee_saw(
    how: signal.Signals, is_recorded: bool, world: Path, transport: Ros2Transport
) -> None:
    watcher = Watcher(transport)
    bag = world.with_name(f"{how.name}.bag")
    with simulator(world, DEATHS, "--rate", "5", *(("--record", str(bag)) if is_recorded else ())) as process:
        wait_until(lambda: bool(watcher.odometry), 60.0)
        result = ended(process, how)
    assert process.returncode == 0
    assert result["sim_seconds"] > 0.0
    assert bag.is_file() == is_recorded


def test_a_simulation_ends_when_it_is_told_to_and_says_what_its_referee_saw(
    world: Path, transport: Ros2Transport
) -> None:
    watcher = Watcher(transport)
    with simulator(world, DEATHS, "--rate", "5", "--duration", "5") as process:
        wait_until(lambda: bool(watcher.odometry))
        while process.poll() is None and watcher.odometry[-1].time < 2.0:
            transport.publish(TOPICS.cmd_vel, encode_twist(Velocity(0.2)))
            time.sleep(0.02)
        result = ended(process, timeout=60.0)
    assert result["sim_seconds"] == pytest.approx(5.0, abs=0.11)
    assert result["boxes"] == 1
    assert result["collisions"] == result["delivered"] == 0
    assert process.returncode == 0
    assert watcher.odometry[-1].pose.x > 0.1
