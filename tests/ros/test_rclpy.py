"""The real rclpy (Jazzy, Fast DDS) receives from our robot and drives it; it is installed for these tests only."""

from __future__ import annotations

import fcntl
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wherry.ros import messages as ros
from wherry.ros.encoding import encode_occupancy_grid, encode_pose_array
from wherry.ros.names import load_names
from wherry.ros.nodes.simulator import WHEEL_JOINTS, simulator_node
from wherry.ros.transports.ros2 import Ros2Transport
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry_testing import worlds
from wherry_testing.bus import free_domain
from wherry_testing.node_thread import running

pytestmark = [pytest.mark.slow, pytest.mark.realtime]

TOPICS = load_names().topics
DOMAIN = free_domain()
WHEELS = ("rclpy", "rmw-fastrtps-cpp", "sensor-msgs", "nav-msgs", "geometry-msgs")
GRID = OccupancyGrid(np.array([[0.0, 1.0, 0.5], [0.1, 0.9, 0.3]], np.float32), 0.05, Pose(-1.5, 2.0))


@pytest.fixture(scope="session")
def rclpy(request: pytest.FixtureRequest) -> str:
    """The Python of an environment with rclpy, from third-party wheels that are not a dependency of wherry."""
    if sys.version_info[:2] != (3, 11) and os.environ.get("CI") != "true":
        pytest.skip("rclpy's wheels are for Python 3.11")
    assert request.config.cache is not None
    folder = request.config.cache.mkdir("rclpy-jazzy")
    python = folder / "bin" / "python"
    with (folder.parent / f"{folder.name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # tests run in several processes
        if not (folder / "complete").exists():
            _install(folder, python)
    return str(python)


def _install(folder: Path, python: Path) -> None:
    """Create the environment."""
    wheels = [f"ros-jazzy-{name}" for name in WHEELS]
    try:
        subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True, capture_output=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", *wheels], check=True, capture_output=True)
    except subprocess.CalledProcessError as error:
        if os.environ.get("CI") == "true":
            raise AssertionError(error.stderr.decode()) from error
        pytest.skip("rclpy's wheels cannot be installed here")
    (folder / "complete").touch()


def ask(python: str, speed: float, seconds: float, kind: str = "plain") -> dict[str, Any]:
    """Drive the robot with rclpy; return what it received meanwhile."""
    environment = {
        **os.environ,
        "ROS_DOMAIN_ID": str(DOMAIN),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
    }
    oracle = Path(worlds.__file__).with_name("rclpy_oracle.py")
    command = [python, str(oracle), str(speed), str(seconds), kind]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout.splitlines()[-1])
    assert isinstance(answer, dict)
    return answer


class Stage:
    """A simulated robot on DDS, with its scans and odometry by stamp, ns."""

    def __init__(self, transport: Ros2Transport) -> None:
        self.simulation = worlds.hall()
        self.scans: dict[int, ros.LaserScan] = {}
        self.odometry: dict[int, ros.Odometry] = {}
        transport.subscribe(TOPICS.scan, lambda message: self.scans.update({_nanoseconds(message.header): message}))
        transport.subscribe(TOPICS.odom, lambda message: self.odometry.update({_nanoseconds(message.header): message}))


def _nanoseconds(header: ros.Header) -> int:
    return header.stamp.sec * 10**9 + header.stamp.nanosec


@pytest.fixture
def stage(monkeypatch: pytest.MonkeyPatch) -> Iterator[Stage]:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(DOMAIN))
    with Ros2Transport() as robot, Ros2Transport() as agent:
        stage = Stage(agent)
        node = simulator_node(stage.simulation, robot, load_names(), 1.0)
        with running(node):
            agent.publish(TOPICS.map, encode_occupancy_grid(GRID, 0.0, "map"))  # long before rclpy subscribes
            yield stage


def test_rclpy_receives_the_values_that_were_sent_and_drives(rclpy: str, stage: Stage) -> None:
    received = ask(rclpy, 0.25, 3.0)
    compared = 0
    for stamp, ranges in received["scans"].items():
        np.testing.assert_array_equal(np.array(ranges, np.float32), stage.scans[int(stamp)].ranges)
        compared += 1
    assert compared == 3
    frame, angle_min, increment, range_max = received["scan"][0]
    assert (frame, range_max) == ("laser", 12.0)
    assert angle_min == pytest.approx(-np.pi)
    assert increment == pytest.approx(np.pi / 180)
    for stamp, (x, z, speed) in received["odom"].items():
        ours = stage.odometry[int(stamp)]
        assert (x, z) == (ours.pose.pose.position.x, ours.pose.pose.orientation.z)
        assert speed == ours.twist.twist.linear.x
    assert received["frames"] == [["odom", "base_link"]]
    assert received["joints"] == [list(WHEEL_JOINTS)]
    assert received["counts"]["clock"] > received["counts"]["odom"] > received["counts"]["scan"] > 20
    ((width, height, resolution, x, data),) = received["map"]
    assert (width, height, x) == (3, 2, -1.5)
    assert resolution == pytest.approx(0.05)
    assert data == [0, 100, -1, 0, 100, -1]
    assert stage.simulation.referee.pose.x - 0.9 == pytest.approx(0.25 * 3.0, abs=0.3)
    assert max(speed for _, _, speed in received["odom"].values()) == pytest.approx(0.25, abs=0.05)


def test_rclpy_drives_with_stamped_velocities(rclpy: str, stage: Stage) -> None:
    received = ask(rclpy, -0.2, 2.0, "stamped")
    assert min(speed for _, _, speed in received["odom"].values()) == pytest.approx(-0.2, abs=0.05)
    time.sleep(0.6)
    last = stage.odometry[max(stage.odometry)]
    assert abs(last.twist.twist.linear.x) < 0.02  # the robot stops once rclpy has ended


def test_rclpy_receives_messages_of_the_agent(rclpy: str, stage: Stage) -> None:
    over = threading.Event()

    def publish(transport: Ros2Transport) -> None:
        cloud = encode_pose_array(np.random.default_rng(0).normal(size=(200, 3)), 0.0, "map")
        while not over.wait(0.1):
            transport.publish(TOPICS.particlecloud, cloud)

    with Ros2Transport() as agent:
        thread = threading.Thread(target=publish, args=(agent,))
        thread.start()
        try:
            received = ask(rclpy, 0.0, 1.0)
        finally:
            over.set()
            thread.join()
    assert received["particles"] == [200]
