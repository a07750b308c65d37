from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.robot import Odometry, Scan, Velocity
from wherry.ros import messages as ros
from wherry.ros.body_files import load_body
from wherry.ros.encoding import encode_header, encode_laser_scan, encode_odometry, encode_transform
from wherry.ros.names import load_names
from wherry.ros.nodes import latch_client, velocity_commands
from wherry.ros.nodes import robot as ros_robot
from wherry.ros.nodes.errors import RobotLostError
from wherry.ros.nodes.latch_protocol import LatchState, decode_latch_command, encode_latch_state
from wherry.ros.nodes.robot import RosRobot
from wherry.ros.transforms import StampedTransform
from wherry.space.pose import Pose
from wherry_testing.bus import Bus, BusTransport, DdsBus, free_domain, wait_for

NAMES = load_names()
TOPICS = NAMES.topics
COVARIANCE = np.zeros(36)
DRIVE = Velocity(0.3, 0.1)
DOMAIN = free_domain()


class Driver:
    """Driver software of a robot that publishes what a test wants."""

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self.time = 10.0

    def mount(self) -> None:
        link = encode_transform(StampedTransform("base_link", "laser", self.time, Pose(-0.17)), 0.15)
        self.bus.publish(TOPICS.tf_static, ros.TFMessage((link,)))

    def odometry(self, **changes: object) -> None:
        message = encode_odometry(Odometry(self.time, Pose(self.time), Velocity()), "odom", "base_link", COVARIANCE)
        self.bus.publish(TOPICS.odom, replace(message, **changes))

    def scan(self, **changes: object) -> None:
        message = encode_laser_scan(Scan(self.time, np.ones(8), -3.0, 0.7, 0.02, 12.0), "laser")
        self.bus.publish(TOPICS.scan, replace(message, **changes))

    def latch(self, has_load: bool = False, answered: float = 0.0) -> None:
        self.bus.publish(TOPICS.latch_state, encode_latch_state(LatchState(self.time, has_load, answered)))

    def tick(self, seconds: float = 0.1) -> None:
        self.time += seconds
        self.odometry()
        self.scan()

    @property
    def commands(self) -> list[ros.Twist]:
        return self.bus.published[TOPICS.cmd_vel.name]


@pytest.fixture(params=["in process", "DDS"])
def bus(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bus]:
    if request.param == "in process":
        yield Bus()
        return
    monkeypatch.setenv("ROS_DOMAIN_ID", str(DOMAIN))
    with contextlib.closing(DdsBus()) as bus:
        yield bus


@pytest.fixture
def driver(bus: Bus) -> Driver:
    return Driver(bus)


@pytest.fixture
def node(bus: Bus) -> BusTransport:
    return bus.node()


@pytest.fixture
def robot(driver: Driver, node: BusTransport) -> Iterator[RosRobot]:
    with RosRobot(node, NAMES, load_body()) as robot:
        driver.mount()
        driver.odometry()
        driver.scan()
        driver.latch()
        robot.wait_until_ready(1.0, use_sim_time=True)
        assert isinstance(robot.receive(), Odometry)
        assert isinstance(robot.receive(), Scan)
        yield robot


@contextlib.contextmanager
def delayed(seconds: float, call: Callable[[], None]) -> Iterator[None]:
    """Call a function after some seconds in another thread, which has ended when the block is left."""
    timer = threading.Timer(seconds, call)
    timer.start()
    yield
    timer.join(10.0)


@contextlib.contextmanager
def repeated(call: Callable[[], None]) -> Iterator[None]:
    """Call a function every 50 ms in another thread until the block is left."""
    ended = threading.Event()

    def run() -> None:
        while not ended.wait(0.05):
            call()

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join(10.0)


def last_rejection(robot: RosRobot) -> str:
    return next(pair.value for pair in robot.status().values if pair.key == "last refused")


def test_lidar_pose_is_taken_from_static_transforms(robot: RosRobot) -> None:
    assert robot.body.lidar == Pose(-0.17)


def test_chain_of_static_transforms_is_composed(bus: Bus, node: BusTransport, driver: Driver) -> None:
    robot = RosRobot(node, NAMES, load_body())
    mast = encode_transform(StampedTransform("base_link", "mast", 0.0, Pose(1.0, 0.0, math.pi / 2)))
    bus.publish(TOPICS.tf_static, ros.TFMessage((mast,)))
    camera = replace(mast, child_frame_id="camera", transform=ros.Transform(rotation=ros.Quaternion(1.0, w=0.0)))
    bus.publish(
        TOPICS.tf_static, ros.TFMessage((camera, encode_transform(StampedTransform("mast", "laser", 0.0, Pose(0.5)))))
    )
    driver.odometry()
    driver.scan()
    driver.latch()
    robot.wait_until_ready(1.0)
    assert robot.body.lidar.x == pytest.approx(1.0)
    assert robot.body.lidar.y == pytest.approx(0.5)


def test_tilted_lidar_is_rejected(bus: Bus, node: BusTransport, driver: Driver) -> None:
    robot = RosRobot(node, NAMES, load_body())
    tilted = rotated(math.sin(0.25), 0.0, 0.0, math.cos(0.25))
    bus.publish(TOPICS.tf_static, ros.TFMessage((tilted,)))
    with pytest.raises(InputError, match=r"frame 'laser': where .* it is tilted by 29°.*; lidar in the --body file"):
        robot.wait_until_ready(0.1)


def rotated(x: float, y: float, z: float, w: float) -> ros.TransformStamped:
    """A mount of the lidar with a rotation."""
    link = encode_transform(StampedTransform("base_link", "laser", 0.0, Pose()))
    return replace(link, transform=ros.Transform(rotation=ros.Quaternion(x, y, z, w)))


def test_scans_of_a_lidar_upside_down_are_mirrored(bus: Bus, node: BusTransport, driver: Driver) -> None:
    robot = RosRobot(node, NAMES, load_body())
    bus.publish(TOPICS.tf_static, ros.TFMessage((rotated(1.0, 0.0, 0.0, 0.0),)))
    driver.odometry()
    driver.scan(angle_min=0.25, angle_max=0.75, angle_increment=0.25, ranges=np.array([1.0, 2.0, 3.0], np.float32))
    driver.latch()
    robot.wait_until_ready(1.0)
    robot.receive()
    scan = robot.receive()
    assert isinstance(scan, Scan)
    assert scan.angles.tolist() == [-0.75, -0.5, -0.25]
    assert scan.ranges.tolist() == [3.0, 2.0, 1.0]


def test_transforms_that_change_may_lead_to_the_lidar(bus: Bus, node: BusTransport, driver: Driver) -> None:
    robot = RosRobot(node, NAMES, load_body())
    bus.publish(TOPICS.tf_static, ros.TFMessage((encode_transform(StampedTransform("mast", "laser", 0.0, Pose(0.5))),)))
    mast = encode_transform(StampedTransform("base_link", "mast", driver.time, Pose(1.0)))
    bus.publish(TOPICS.tf, ros.TFMessage((mast,)))
    driver.odometry()
    driver.scan()
    driver.latch()
    robot.wait_until_ready(1.0)
    assert robot.body.lidar == Pose(1.5)
    assert isinstance(robot.receive(), Odometry)
    bus.publish(TOPICS.tf, ros.TFMessage((replace(mast, transform=rotated(0.0, 0.0, 1.0, 0.0).transform),)))
    with pytest.raises(RobotLostError, match="base_link → mast: the lidar moves on the robot"):
        robot.receive()


@pytest.mark.parametrize(("offset", "side"), [(-1000.0, "before"), (1000.0, "after")])
def test_scans_of_another_clock_are_named(
    bus: Bus, node: BusTransport, driver: Driver, offset: float, side: str
) -> None:
    robot = RosRobot(node, NAMES, load_body())
    driver.time = 2000.0
    driver.mount()
    driver.latch()
    for _ in range(5):
        driver.time += 0.1
        driver.odometry()
        driver.scan(header=encode_header(driver.time + offset, "laser"))
    with pytest.raises(InputError) as caught:
        robot.wait_until_ready(0.1)
    expected = f"/odom at the times of /scan, which another clock stamps 1000.0 s {side} odometry: not received"
    assert expected in str(caught.value)


def test_a_robot_whose_clocks_drift_apart_is_lost(
    robot: RosRobot, driver: Driver, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ros_robot, "ROBOT_LOST_TIMEOUT", 0.5)
    for _ in range(6):  # the first ones are taken for outliers
        driver.time += 0.05
        driver.scan(header=encode_header(driver.time + 100.0, "laser"))
    driver.odometry()
    assert isinstance(robot.receive(), Odometry)
    with (
        repeated(lambda: driver.scan(header=encode_header(driver.time + 100.0, "laser"))),
        pytest.raises(RobotLostError, match=r"/odom at the times of /scan, which another clock stamps 100\.0 s after"),
    ):
        robot.receive()


SWEEP_ODOMETRY = {
    "poses during the sweep": [0.0, 0.04, 0.08, 0.12],
    "poses before the sweep": [-0.12, -0.06, 0.0],
    "velocity": [0.0],
}


@pytest.mark.parametrize("clockwise", [False, True])
@pytest.mark.parametrize("case", SWEEP_ODOMETRY)
def test_a_scan_while_turning_is_corrected(
    bus: Bus, node: BusTransport, driver: Driver, clockwise: bool, case: str
) -> None:
    """A lidar on the axle, in the middle of a square room of 4 m, that turns at 1 rad/s."""
    rate, period, beams, start = 1.0, 0.1, 90, driver.time
    robot = RosRobot(node, NAMES, load_body())
    mount = encode_transform(StampedTransform("base_link", "laser", 0.0, Pose()))
    bus.publish(TOPICS.tf_static, ros.TFMessage((mount,)))
    driver.latch()
    angles = np.linspace(-math.pi, math.pi, beams) * (-1.0 if clockwise else 1.0)
    world = angles + rate * np.linspace(0.0, period, beams)  # of the beams, from the heading at the first one
    ranges = 2.0 / np.maximum(np.abs(np.cos(world)), np.abs(np.sin(world)))
    for time_of in SWEEP_ODOMETRY[case]:
        velocity = Velocity(0.0, rate if case == "velocity" else 0.0)
        measured = Odometry(start + time_of, Pose(theta=rate * time_of), velocity)
        bus.publish(TOPICS.odom, encode_odometry(measured, "odom", "base_link", COVARIANCE))
    message = encode_laser_scan(Scan(start, ranges, angles[0], angles[1] - angles[0], 0.02, 12.0), "laser")
    bus.publish(TOPICS.scan, replace(message, time_increment=period / (beams - 1)))
    robot.wait_until_ready(1.0)
    scan = next(item for item in iter(robot.receive, None) if isinstance(item, Scan))
    raw = np.column_stack([ranges * np.cos(angles), ranges * np.sin(angles)])
    assert np.abs(np.abs(raw).max(axis=1) - 2.0).max() > 0.1
    assert np.abs(np.abs(scan.points()).max(axis=1) - 2.0).max() < 1e-5


def test_impossible_times_of_beams_are_reported(robot: RosRobot, driver: Driver) -> None:
    driver.time += 0.1
    driver.odometry()
    driver.scan(time_increment=0.5)
    received = [robot.receive() for _ in range(2)]
    assert isinstance(received[1], Scan)
    assert received[1].angles == pytest.approx(-3.0 + 0.7 * np.arange(8))
    values = {pair.key: pair.value for pair in robot.status().values}
    assert values["corrected in /scan"].startswith("time_increment is impossible")


def test_missing_topics_and_transforms_are_named(node: BusTransport, driver: Driver) -> None:
    robot = RosRobot(node, NAMES, load_body())
    driver.odometry()
    driver.scan(header=ros.Header(ros.Time(10), "base_scan"))
    with pytest.raises(InputError) as caught:
        robot.wait_until_ready(0.1)
    text = str(caught.value)
    assert "/scan, /latch/state, base_link → laser on /tf_static" in text
    assert "/odom" not in text
    assert "'base_scan' instead of 'laser'" in text


def test_velocities_are_clipped_to_the_limits(robot: RosRobot, driver: Driver) -> None:
    robot.command(DRIVE)
    robot.command(Velocity(9.0, -9.0))
    sent = [(twist.linear.x, twist.angular.z) for twist in driver.commands]
    assert sent == [(0.3, 0.1), (0.6, -2.5)]


def test_velocities_can_be_stamped(bus: Bus, driver: Driver) -> None:
    robot = RosRobot(bus.node(), NAMES, load_body(), stamped=True)
    driver.mount()
    driver.latch()
    driver.tick()
    robot.wait_until_ready(1.0, use_sim_time=True)
    robot.receive()
    robot.receive()
    robot.command(DRIVE)
    (sent,) = bus.published[TOPICS.cmd_vel_stamped.name]
    assert isinstance(sent, ros.TwistStamped)
    assert sent.twist.linear.x == 0.3
    assert sent.header == ros.Header(ros.Time(10, 100_000_000), "base_link")


def test_close_stops_the_robot(bus: Bus, driver: Driver) -> None:
    with RosRobot(bus.node(), NAMES, load_body()):
        pass
    assert driver.commands[-1] == ros.Twist()


# ---- safety


def test_robot_stops_when_only_odometry_arrives(robot: RosRobot, driver: Driver) -> None:
    robot.command(DRIVE)
    for _ in range(9):
        driver.time += 0.05
        driver.odometry()
        robot.receive()
        robot.command(DRIVE)
    assert driver.time - 10.0 < 0.5
    assert driver.commands[-1] == ros.Twist()
    assert driver.commands[-3].linear.x == 0.3
    assert "too old" in robot.status().message
    driver.tick(0.05)
    robot.receive()
    robot.receive()
    robot.command(DRIVE)
    assert driver.commands[-1].linear.x == 0.3


def test_agent_that_fell_behind_does_not_drive(robot: RosRobot, driver: Driver) -> None:
    for _ in range(6):
        driver.tick()
    robot.command(DRIVE)
    assert driver.commands[-1] == ros.Twist()
    while driver.time - robot.receive().time > 0.01:
        pass
    robot.receive()
    robot.command(DRIVE)
    assert driver.commands[-1].linear.x == 0.3


def test_robot_is_stopped_while_receive_waits_for_a_silent_lidar(bus: Bus, driver: Driver) -> None:
    robot = RosRobot(bus.node(), NAMES, load_body())
    driver.mount()
    driver.latch()
    driver.tick()
    robot.wait_until_ready(1.0, use_sim_time=False)
    robot.receive()
    robot.receive()
    robot.command(DRIVE)
    started = time.monotonic()
    with delayed(0.9, driver.tick):
        robot.receive()
    assert time.monotonic() - started > 0.8
    assert driver.commands[1] == ros.Twist()


@pytest.mark.realtime
def test_robot_is_stopped_within_half_a_second(bus: Bus, driver: Driver) -> None:
    robot = RosRobot(bus.node(), NAMES, load_body())
    driver.mount()
    driver.latch()
    driver.tick()
    scanned = time.monotonic()
    robot.wait_until_ready(1.0, use_sim_time=False)
    robot.receive()
    robot.receive()
    robot.command(DRIVE)
    stopped: list[float] = []
    bus.callbacks[TOPICS.cmd_vel.name, ros.Twist].append(lambda _: stopped.append(time.monotonic()))
    with delayed(0.9, driver.tick):
        robot.receive()
    assert stopped[0] - scanned < 0.5


def test_only_the_latest_of_many_queued_scans_is_kept(robot: RosRobot, driver: Driver) -> None:
    for _ in range(40):
        driver.tick()
    first = robot.receive()
    assert isinstance(first, Odometry)
    received = [first]
    while received[-1].time < driver.time or isinstance(received[-1], Odometry):
        received.append(robot.receive())
    scans = [item for item in received if isinstance(item, Scan)]
    assert [item.time for item in scans] == [pytest.approx(driver.time)]
    assert len(received) == 41


@pytest.mark.parametrize(
    "changes",
    [
        {"header": ros.Header(ros.Time(10, 100_000_000), "camera")},
        {"header": ros.Header(ros.Time(99), "laser")},
        {"header": ros.Header(ros.Time(3), "laser")},
        {"range_max": math.nan},
        {"angle_increment": -0.7},
        {"ranges": np.zeros(0, np.float32)},
    ],
)
def test_invalid_scan_is_rejected_and_reported(changes: dict[str, object], robot: RosRobot, driver: Driver) -> None:
    driver.time += 0.1
    driver.odometry()
    driver.scan(**changes)
    driver.tick()
    received = [robot.receive() for _ in range(3)]
    assert [type(item) for item in received] == [Odometry, Odometry, Scan]
    assert received[-1].time == pytest.approx(driver.time)
    assert last_rejection(robot).startswith("/scan: ")
    assert ("refused on /scan", "1") in {(pair.key, pair.value) for pair in robot.status().values}


@pytest.mark.parametrize(
    "changes",
    [
        {"child_frame_id": "base_footprint"},
        {"header": ros.Header(ros.Time(10, 100_000_000), "map")},
        {"pose": ros.PoseWithCovariance(ros.Pose(ros.Point(math.nan)))},
        {"twist": ros.TwistWithCovariance(ros.Twist(ros.Vector3(math.inf)))},
        {"pose": ros.PoseWithCovariance(ros.Pose(orientation=ros.Quaternion(w=0.0)))},
    ],
)
def test_invalid_odometry_is_rejected_and_reported(changes: dict[str, object], robot: RosRobot, driver: Driver) -> None:
    driver.time += 0.1
    driver.odometry(**changes)
    driver.tick()
    assert robot.receive().time == pytest.approx(driver.time)
    assert last_rejection(robot).startswith("/odom: ")


def test_clock_that_is_set_back_ends_the_run(robot: RosRobot, driver: Driver) -> None:
    driver.time = 0.0
    for _ in range(5):
        driver.tick()
    with pytest.raises(RobotLostError, match="time moved backwards from 10"):
        robot.receive()


def test_run_continues_after_a_confirmed_gap(robot: RosRobot, driver: Driver) -> None:
    driver.time += 30.0
    for _ in range(5):
        driver.tick()
    assert robot.receive().time == pytest.approx(40.5)


def test_robot_without_scans_ends_the_run(robot: RosRobot, driver: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ros_robot, "ROBOT_LOST_TIMEOUT", 0.2)
    with pytest.raises(RobotLostError, match="/scan: nothing received"):
        robot.receive()
    assert driver.commands[-1] == ros.Twist()


def test_nothing_is_sent_while_another_node_drives(
    robot: RosRobot, driver: Driver, bus: Bus, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(velocity_commands, "YIELD_SECONDS", 0.3)
    robot.command(DRIVE)
    bus.publish(TOPICS.cmd_vel, ros.Twist(ros.Vector3(0.11)))
    count = len(driver.commands)
    robot.command(DRIVE)
    assert len(driver.commands) == count
    assert robot.status().level == ros.DiagnosticStatus.ERROR
    assert "another node drives" in robot.status().message
    time.sleep(0.4)
    robot.command(DRIVE)
    assert driver.commands[-1].linear.x == 0.3


def test_echoes_of_own_commands_are_recognized(robot: RosRobot, driver: Driver) -> None:
    for step in range(300):
        robot.command(Velocity(step / 1000, -step / 500))
    assert len(driver.commands) == 300


def test_invalid_velocity_of_another_node_is_ignored(robot: RosRobot, driver: Driver, bus: Bus) -> None:
    bus.publish(TOPICS.cmd_vel, ros.Twist(ros.Vector3(math.nan)))
    robot.command(DRIVE)
    assert driver.commands[-1].linear.x == 0.3
    assert last_rejection(robot).startswith("/cmd_vel: ")


def test_second_publisher_is_reported_before_it_drives(robot: RosRobot, bus: Bus) -> None:
    assert robot.status().level == ros.DiagnosticStatus.OK
    bus.node().advertise(TOPICS.cmd_vel)
    wait_for(lambda: robot.status().level != ros.DiagnosticStatus.OK)
    assert robot.status().level == ros.DiagnosticStatus.WARN
    assert "also publishes" in robot.status().message


def test_unreachable_master_is_reported(robot: RosRobot, node: BusTransport, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(node, "is_connected", lambda: False)
    assert "master" in robot.status().message


# ---- the latch


def test_latch_command_is_repeated_until_it_is_answered(robot: RosRobot, driver: Driver, bus: Bus) -> None:
    stamps: list[float] = []

    def answer(message: ros.JointState) -> None:
        command = decode_latch_command(message)
        stamps.append(command.stamp)
        driver.latch(has_load=False, answered=command.stamp - 1.0)  # the answer to an earlier command
        if len(stamps) % 2 == 0:  # the first transmission is lost
            driver.latch(has_load=command.close, answered=command.stamp)

    bus.callbacks[TOPICS.latch_command.name, ros.JointState].append(answer)
    assert robot.close_latch() is True
    assert robot.open_latch() is True
    first, again, second, _ = stamps
    assert first == again < second


def test_latch_that_does_not_answer_ends_the_run(robot: RosRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(latch_client, "ANSWER_TIMEOUT", 0.02)
    with pytest.raises(RobotLostError, match="/latch/state: the latch does not answer"):
        robot.close_latch()


# ---- idle callback


def test_idle_callback_runs_only_when_no_measurement_is_queued(robot: RosRobot, driver: Driver) -> None:
    calls: list[float] = []

    def on_idle() -> None:
        calls.append(driver.time)
        driver.tick()

    robot.idle_callback = on_idle
    driver.tick()
    received = [type(robot.receive()) for _ in range(4)]
    assert received == [Odometry, Scan, Odometry, Scan]
    assert calls == [pytest.approx(10.1)]
