from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from wherry.robot import Velocity
from wherry.ros import messages as ros
from wherry.ros.decoding import decode_laser_scan, decode_odometry, decode_stamp, decode_transform
from wherry.ros.encoding import encode_header, encode_twist
from wherry.ros.names import RosNames, load_names
from wherry.ros.nodes.latch_protocol import LatchCommand, LatchState, decode_latch_state, encode_latch_command
from wherry.ros.nodes.simulator import WHEEL_JOINTS, simulator_node
from wherry.ros.topics import Topic
from wherry.simulation import Simulation
from wherry.simulation.model import LASER_HEIGHT, robot_urdf
from wherry.space.pose import Pose
from wherry_testing.bus import Bus
from wherry_testing.worlds import HALL, hall

NAMES = load_names()
TOPICS = NAMES.topics


class Stage:
    """A simulation on a bus that runs for as long as a test wants."""

    def __init__(self, simulation: Simulation, names: RosNames = NAMES, rate: float = 20.0) -> None:
        self.simulation = simulation
        self.bus = Bus()
        self.node = simulator_node(simulation, self.bus.node(), names, rate)

    def run(self, seconds: float, *, each_tick: Callable[[float], None] = lambda _: None) -> None:
        """Run for a simulated time, s; ``each_tick`` is called with the time before every step."""
        end = self.simulation.time + seconds - 1e-9

        def stopped() -> bool:
            each_tick(self.simulation.time)
            return self.simulation.time >= end

        self.node.run(stopped)

    def published(self, topic: Topic[Any]) -> list[Any]:
        return self.bus.heard[topic.name]

    def command(self, velocity: Velocity) -> Callable[[float], None]:
        return lambda _: self.bus.say(TOPICS.cmd_vel, encode_twist(velocity))

    @property
    def speed(self) -> float:
        return decode_odometry(self.published(TOPICS.odom)[-1], "odom", "base_link").velocity.linear

    @property
    def latch(self) -> LatchState:
        return decode_latch_state(self.published(TOPICS.latch_state)[-1])

    def request_latch(self, *, close: bool, stamp: float | None = None) -> LatchState:
        command = LatchCommand(self.simulation.time if stamp is None else stamp, close)
        self.bus.say(TOPICS.latch_command, encode_latch_command(command))
        self.run(0.05)
        assert self.latch.answers(command) or stamp is not None
        return self.latch


@pytest.fixture
def stage() -> Stage:
    return Stage(hall())


def test_stamps_share_one_clock_and_transforms_precede_scans() -> None:
    stage = Stage(hall(), rate=4.0)
    order: list[tuple[str, float]] = []

    def note(topic: Topic[Any], stamp: Callable[[Any], ros.Time]) -> None:
        key = topic.name, topic.message_type
        stage.bus.callbacks[key].append(lambda message: order.append((topic.name, decode_stamp(stamp(message)))))

    note(TOPICS.clock, lambda message: message.clock)
    note(TOPICS.tf, lambda message: message.transforms[0].header.stamp)
    note(TOPICS.odom, lambda message: message.header.stamp)
    note(TOPICS.scan, lambda message: message.header.stamp)
    stage.run(1.0)
    times = [stamp for _, stamp in order]
    assert times == sorted(times)
    for index, (name, stamp) in enumerate(order):
        if name == "/scan":
            assert [entry for entry in order[:index] if entry[1] == stamp] == [
                ("/clock", stamp),
                ("/tf", stamp),
                ("/odom", stamp),
            ]
    counts = {name: sum(entry[0] == name for entry in order) for name in ("/clock", "/tf", "/odom", "/scan")}
    assert counts["/odom"] == counts["/tf"] == 20
    assert counts["/scan"] == 10
    assert counts["/clock"] >= 20


@pytest.mark.realtime
def test_clock_ticks_between_measurements() -> None:
    stage = Stage(hall(), rate=1.0)
    stage.run(1.0)
    assert len(stage.published(TOPICS.clock)) >= 90  # of 100


def test_messages_have_the_simulations_values_and_frames(stage: Stage) -> None:
    stage.run(1.0, each_tick=stage.command(Velocity(0.3, 0.2)))
    odometry = decode_odometry(stage.published(TOPICS.odom)[-1], "odom", "base_link")
    link = decode_transform(stage.published(TOPICS.tf)[-1].transforms[0])
    assert (link.parent, link.child, link.time) == ("odom", "base_link", odometry.time)
    assert link.pose.distance_to(odometry.pose) == 0.0
    driven = stage.simulation.referee.pose.relative_to(Pose(0.9, 1.5))
    assert odometry.pose.distance_to(driven) < 0.02
    scan = decode_laser_scan(stage.published(TOPICS.scan)[-1], "laser")
    assert len(scan.ranges) == 360
    mount, _ = stage.published(TOPICS.tf_static)[0].transforms
    assert decode_transform(mount).pose == stage.simulation.robot.body.lidar
    assert (mount.header.frame_id, mount.child_frame_id) == ("base_link", "laser")
    assert mount.transform.translation.z == LASER_HEIGHT


def test_covariances_are_large_for_what_wheels_do_not_measure(stage: Stage) -> None:
    stage.run(0.1)
    variances = stage.published(TOPICS.odom)[-1].pose.covariance.reshape(6, 6).diagonal()
    assert (variances[[0, 1, 5]] < 0.1).all()
    assert (variances[[2, 3, 4]] > 1e3).all()


def test_joint_states_follow_the_urdf(stage: Stage) -> None:
    robot = ElementTree.fromstring(robot_urdf())  # noqa: S314 - our own file
    turning = [joint.attrib["name"] for joint in robot.findall("joint") if joint.attrib["type"] == "continuous"]
    assert sorted(turning) == sorted(WHEEL_JOINTS)
    laser = robot.find("joint[@name='laser_joint']/origin")
    assert laser is not None
    assert float(laser.attrib["xyz"].split()[2]) == LASER_HEIGHT
    stage.run(1.0, each_tick=stage.command(Velocity(0.2)))
    state = stage.published(TOPICS.joint_states)[-1]
    assert state.name == WHEEL_JOINTS
    np.testing.assert_allclose(state.position, stage.simulation.physics.wheel_angles)
    np.testing.assert_allclose(state.velocity, 0.2 / 0.05, rtol=0.05)


def test_namespace_prefix_and_remapping_apply_to_all_topics_and_frames() -> None:
    stage = Stage(hall(), load_names(namespace="r1", frame_prefix="r1/", remappings=["scan:=front/scan"]))
    stage.run(0.2)
    assert stage.bus.heard["/r1/front/scan"][0].header.frame_id == "r1/laser"
    odometry = stage.bus.heard["/r1/odom"][0]
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("r1/odom", "r1/base_link")
    assert stage.bus.heard["/tf"][0].transforms[0].child_frame_id == "r1/base_link"


def test_twist_and_stamped_twist_drive_the_robot(stage: Stage) -> None:
    stage.run(1.0, each_tick=stage.command(Velocity(0.3)))
    assert stage.speed == pytest.approx(0.3, abs=0.03)

    def stamped(now: float) -> None:
        message = ros.TwistStamped(encode_header(now, "base_link"), encode_twist(Velocity(-0.3)))
        stage.bus.say(TOPICS.cmd_vel_stamped, message)

    stage.run(1.0, each_tick=stamped)
    assert stage.speed == pytest.approx(-0.3, abs=0.03)


def test_outdated_stamped_velocity_is_rejected(stage: Stage) -> None:
    stage.run(1.0)
    old = ros.TwistStamped(encode_header(0.3, "base_link"), encode_twist(Velocity(0.3)))
    stage.run(0.5, each_tick=lambda _: stage.bus.say(TOPICS.cmd_vel_stamped, old))
    assert abs(stage.speed) < 0.02


def test_robot_stops_half_a_second_after_the_last_velocity(stage: Stage) -> None:
    stage.run(1.5, each_tick=stage.command(Velocity(0.6)))
    assert stage.speed > 0.5
    stage.run(0.5)
    there = stage.simulation.referee.pose
    stage.run(0.5)
    assert stage.simulation.referee.pose.distance_to(there) < 0.001


@pytest.mark.parametrize("broken", [ros.Twist(ros.Vector3(math.nan)), ros.Twist(angular=ros.Vector3(z=1e9))])
def test_invalid_velocity_stops_the_robot(broken: ros.Twist, stage: Stage) -> None:
    stage.run(1.0, each_tick=stage.command(Velocity(0.3)))
    stage.run(0.5, each_tick=lambda _: stage.bus.say(TOPICS.cmd_vel, broken))
    assert abs(stage.speed) < 0.02
    stage.run(1.0)
    values = {pair.key: pair.value for pair in stage.published(TOPICS.diagnostics)[-1].status[0].values}
    assert int(values["refused on /cmd_vel"]) >= 9
    assert "speed" in values["last refused"]


def test_two_publishers_of_velocities_are_reported(stage: Stage) -> None:
    for _ in range(2):
        stage.bus.node().advertise(TOPICS.cmd_vel)
    stage.run(0.1)
    status = stage.published(TOPICS.diagnostics)[-1].status[0]
    assert status.level == ros.DiagnosticStatus.WARN
    assert "2 publishers" in status.message


def test_latch_answers_each_command_after_carrying_it_out() -> None:
    stage = Stage(hall())
    stage.run(0.2)
    assert stage.latch == LatchState(stage.latch.time, has_load=False, answered=0.0)
    assert not stage.request_latch(close=True).has_load  # nothing in the fork


def test_box_is_held_outside_the_warehouse() -> None:
    drawing = HALL.replace("|     >                         |", "|     >   o                     |")
    stage = Stage(hall(drawing))
    while stage.simulation.referee.pose.x < 1.49:
        stage.run(0.05, each_tick=stage.command(Velocity(0.2)))
    state = stage.request_latch(close=True)
    assert state.has_load
    count = len(stage.published(TOPICS.latch_state))
    stage.run(1.0)
    assert len(stage.published(TOPICS.latch_state)) - count >= 9  # published periodically
    assert stage.request_latch(close=False).has_load  # interlocked


def test_repeated_or_late_latch_command_is_carried_out_once() -> None:
    drawing = HALL.replace("|     >                         |", "|     >   o                     |")
    stage = Stage(hall(drawing))
    stage.run(0.2)
    number = stage.request_latch(close=True).answered
    while stage.simulation.referee.pose.x < 1.49:
        stage.run(0.05, each_tick=stage.command(Velocity(0.2)))
    for late in (number, number - 0.1):
        state = stage.request_latch(close=True, stamp=late)
        assert not state.has_load
        assert state.answered == number
    assert stage.request_latch(close=True).has_load


@pytest.mark.realtime
def test_simulation_keeps_its_rate() -> None:
    stage = Stage(hall(), rate=4.0)
    started = time.monotonic()
    stage.run(2.0)
    assert time.monotonic() - started == pytest.approx(0.5, abs=0.2)


@pytest.mark.realtime
def test_long_pause_is_not_caught_up() -> None:
    stage = Stage(hall(), rate=2.0)
    slept = []

    def sleep_once(now: float) -> None:
        if now >= 0.5 and not slept:
            slept.append(time.sleep(1.0))

    started = time.monotonic()
    stage.run(2.0, each_tick=sleep_once)
    assert time.monotonic() - started > 1.9
