"""The agent and the simulator as two processes that share nothing but a real roscore."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import pytest

from wherry_testing.robots_clock import STANDSTILL_SPEED, STOPPING_RESOLUTION, ReceivedOdometry, stopping_time
from wherry_testing.ros1_system import Roscore, require, stamp, values_of, wait_until

SIMULATE = ("ros1", "simulate", "small", "--boxes", "2", "--json")
# The world's two warehouse cells as seen from its robot.
DELIVER = ("ros1", "deliver", "--warehouse", "3.6,-0.6", "--warehouse", "3.6,-1.8", "--json")
SCAN, ODOMETRY, TWIST = "sensor_msgs/LaserScan", "nav_msgs/Odometry", "geometry_msgs/Twist"
MAP, DIAGNOSTICS = "nav_msgs/OccupancyGrid", "diagnostic_msgs/DiagnosticArray"
START_TIMEOUT = 90.0  # s, wall clock, until the robot drives
STOP_TIMEOUT = 0.5  # s from an invalid scan to standstill

pytestmark = [pytest.mark.slow, pytest.mark.realtime]


@pytest.fixture(scope="module")
def roscore(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Roscore]:
    require("roscore")
    with Roscore(tmp_path_factory.mktemp("ros1")) as roscore:
        yield roscore


def test_two_boxes_are_delivered_over_ros1(roscore: Roscore, capsys: pytest.CaptureFixture[str]) -> None:
    with (
        roscore.wherry(*SIMULATE, "--rate", "2") as simulator,
        roscore.wherry(*DELIVER) as agent,
        roscore.wherry("ros1", "monitor", "--duration", "100000", "--json") as monitor,
    ):
        assert agent.finish(400.0) == 0, agent.output
        monitor.interrupt()
        monitor.finish(20.0)
        simulator.interrupt()
        simulator.finish(20.0)
    result, statistics = simulator.result(), monitor.result()
    with capsys.disabled():
        print(f"\n{result}\n{statistics}")  # noqa: T201 - the log shows the measured latency
    assert (result["delivered"], result["boxes"], result["collisions"]) == (2, 2, 0)
    assert agent.result()["delivered"] == 2
    assert statistics["scans missing"] == statistics["odometry missing"] == 0
    assert statistics["scan to velocity, median, ms"] <= 10.0


def test_map_of_inconsistent_size_is_rejected(roscore: Roscore) -> None:
    with roscore.wherry(*SIMULATE), roscore.peer("mapper") as mapper:
        info = {"resolution": 0.05, "width": 10, "height": 10, "origin": {"orientation": {"w": 1.0}}}
        mapper.send("/map", MAP, {"header": {"frame_id": "map"}, "info": info, "data": [0] * 99}, latch=True)
        with roscore.wherry(*DELIVER, "--mapping", "ros", "--wait", "20") as agent:
            assert agent.finish(120.0) == 2
    assert "99 values for 10 × 10 cells" in " ".join(agent.output.split())


def speed_of(odometry: dict[str, Any]) -> float:
    """Norm of the linear velocity, m/s, and the angular velocity, rad/s."""
    twist = odometry["twist"]["twist"]
    return math.hypot(twist["linear"]["x"], twist["angular"]["z"])


class MonitoredRun:
    """An agent that explores with a simulated robot; a third node relays the scans and monitors topics."""

    def __init__(self, roscore: Roscore, stack: ExitStack) -> None:
        self.simulator = stack.enter_context(roscore.wherry(*SIMULATE, "--remap", "scan:=raw_scan"))
        self.peer = stack.enter_context(roscore.peer())
        self.peer.relay("/raw_scan", "/scan", "pass")
        for topic, kind in (("/odom", ODOMETRY), ("/cmd_vel", TWIST), ("/map", MAP), ("/diagnostics", DIAGNOSTICS)):
            self.peer.listen(topic, kind)
        self.agent = stack.enter_context(roscore.wherry(*DELIVER))
        self.wait_until_driving()

    def wait_until_driving(self) -> None:
        def drives() -> bool:
            assert self.agent.process.poll() is None, self.agent.output
            return bool(self.peer.received["/odom"]) and self.speed() > 0.1

        wait_until(drives, START_TIMEOUT, f"it drives\n{self.agent.output}")

    def speed(self) -> float:
        return speed_of(self.peer.last("/odom"))

    def now(self) -> float:
        return stamp(self.peer.last("/odom"))

    def commands(self, begin: float) -> list[tuple[float, float, float]]:
        """Times, s, and velocities, m/s and rad/s, commanded since a time on the monotonic clock."""
        entries = [entry for entry in self.peer.received["/cmd_vel"] if entry["at"] >= begin]
        return [(entry["at"], entry["message"]["linear"]["x"], entry["message"]["angular"]["z"]) for entry in entries]

    def time_to_stop(self, begin: float) -> float:
        """Time on the robot's clock from an instant until the robot stood, s; independent of the machine's load."""
        wait_until(lambda: self.speed() < STANDSTILL_SPEED, 10.0, "the robot stands")
        entries = list(self.peer.received["/odom"])
        return stopping_time(
            [ReceivedOdometry(entry["at"], stamp(entry["message"]), speed_of(entry["message"])) for entry in entries],
            begin,
        )

    @contextmanager
    def disturbed(self, mode: str) -> Iterator[float]:
        """Change or withhold scans; yields the time on the monotonic clock when that begins, s."""
        self.peer.relay("/raw_scan", "/scan", mode)
        try:
            yield time.monotonic()
        finally:
            self.peer.relay("/raw_scan", "/scan", "pass")

    def check_standstill_for(self, seconds: float) -> None:
        begin, count = self.now(), len(self.peer.received["/odom"])
        wait_until(lambda: self.now() - begin >= seconds, 30.0, "time passes")
        assert max(speed_of(entry["message"]) for entry in self.peer.received["/odom"][count:]) < STANDSTILL_SPEED

    def status(self, name: str) -> dict[str, str]:
        for entry in reversed(self.peer.received["/diagnostics"]):
            if found := values_of(entry["message"], name):
                return found
        return {}


@pytest.fixture(scope="module")
def module_run(roscore: Roscore) -> Iterator[MonitoredRun]:
    with ExitStack() as stack:
        yield MonitoredRun(roscore, stack)


@pytest.fixture
def run(module_run: MonitoredRun) -> MonitoredRun:
    """The same run for all tests; the last test ends it."""
    module_run.wait_until_driving()
    return module_run


@pytest.mark.parametrize("mode", ["silent", "nan", "frame"])
def test_agent_commands_standstill_without_valid_scans(run: MonitoredRun, mode: str) -> None:
    with run.disturbed(mode) as begin:
        check_standstill(run, mode, begin)
    run.wait_until_driving()


def check_standstill(run: MonitoredRun, mode: str, begin: float) -> None:
    wait_until(lambda: run.speed() < STANDSTILL_SPEED, 10.0, "the robot stands")
    run.check_standstill_for(1.0)
    commands = run.commands(begin)
    last_motion = max((at for at, linear, angular in commands if linear or angular), default=begin)
    first_zero = min((at for at, *_ in commands if at > last_motion), default=math.inf)
    assert first_zero - begin <= STOP_TIMEOUT, "commanded, not only stopped by the watchdog"
    if mode != "silent":
        words = {"nan": "not finite", "frame": "'camera' instead of 'laser'"}[mode]
        wait_until(lambda: words in run.status("wherry: robot").get("last refused", ""), 5.0, "diagnostics say why")


def test_agent_yields_to_another_publisher(roscore: Roscore, run: MonitoredRun) -> None:
    with roscore.peer("joystick") as joystick:
        begin = run.now()
        while run.now() < begin + 3.0:
            joystick.send("/cmd_vel", TWIST, {"angular": {"z": 0.3}})
        late = [entry["message"]["angular"]["z"] for entry in run.peer.received["/cmd_vel"]][-20:]
        assert late == [0.3] * 20, "the agent sends nothing"
        wait_until(lambda: "another node" in run.status("wherry: robot").get("message", ""), 5.0, "a warning")
    run.wait_until_driving()


def test_run_continues_without_the_master(roscore: Roscore, run: MonitoredRun) -> None:
    begin, count = run.now(), len(run.peer.received["/cmd_vel"])
    roscore.kill()
    wait_until(lambda: run.now() > begin + 4.0, 30.0, "time passes")
    assert len(run.peer.received["/cmd_vel"]) > count + 20, "the agent goes on"
    roscore.start()
    with roscore.peer("newcomer") as newcomer:
        newcomer.listen("/map", MAP)
        grid = newcomer.wait_for("/map", 1, 20.0)[0]
        assert len(grid["data"]) == grid["info"]["width"] * grid["info"]["height"] > 0
        assert grid["header"]["frame_id"] == "map"
    run.wait_until_driving()
    assert run.agent.process.poll() is None


def test_robot_stops_when_the_agent_is_killed(run: MonitoredRun) -> None:
    run.agent.kill()
    last_command = run.peer.received["/cmd_vel"][-1]["at"]
    assert run.time_to_stop(last_command) <= STOP_TIMEOUT + STOPPING_RESOLUTION
    run.check_standstill_for(1.0)
