from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.pipelines.delivery.simulator import WHEEL_JOINTS, Settings, node_of, prepare
from wherry.robot import Velocity
from wherry.ros import messages as ros
from wherry.ros.decoding import decode_laser_scan, decode_odometry, decode_stamp, decode_transform
from wherry.ros.encoding import encode_header, encode_twist
from wherry.ros.names import RosNames, load_names
from wherry.ros.nodes.latch import LatchCommand, LatchState, from_latch_state, to_latch_command
from wherry.ros.topics import Topic
from wherry.simulation import Simulation
from wherry.simulation.model import LASER_HEIGHT, robot_urdf
from wherry.space.pose import Pose
from wherry_testing.bus import Bus
from wherry_testing.worlds import HALL, hall

NAMES = load_names()
TOPICS = NAMES.topics


class Stage:
    """A simulation on a bus, that runs as long as a test wants."""

    def __init__(self, simulation: Simulation, names: RosNames = NAMES, rate: float = 20.0) -> None:
        self.simulation = simulation
        self.bus = Bus()
        self.node = node_of(simulation, self.bus.node(), names, rate)

    def run(self, seconds: float, *, each_tick: Callable[[float], None] = lambda _: None) -> None:
        """Run for a while of simulated time; ``each_tick`` is called before every instant."""
        end = self.simulation.time + seconds - 1e-9

        def stopped() -> bool:
            each_tick(self.simulation.time)
            return self.simulation.time >= end

        self.node.run(stopped)

    def heard(self, topic: Topic[Any]) -> list[Any]:
        return self.bus.heard[topic.name]

    def command(self, velocity: Velocity) -> Callable[[float], None]:
        return lambda _: self.bus.say(TOPICS.cmd_vel, encode_twist(velocity))

    @property
    def speed(self) -> float:
        return decode_odometry(self.heard(TOPICS.odom)[-1], "odom", "base_link").velocity.linear

    @property
    def latch(self) -> LatchState:
        return from_latch_state(self.heard(TOPICS.latch_state)[-1])

    def ask_latch(self, *, close: bool, number: float | None = None) -> LatchState:
        command = LatchCommand(self.simulation.time if number is None else number, close)
        self.bus.say(TOPICS.latch_command, to_latch_command(command))
        self.run(0.05)
        assert self.latch.answers(command) or number is not None
        return self.latch


@pytest.fixture
def stage() -> Stage:
    return Stage(hall())


def test_everything_is_told_on_one_clock_in_the_order_of_need() -> None:
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
def test_the_clock_ticks_in_between_too() -> None:
    stage = Stage(hall(), rate=1.0)
    stage.run(1.0)
    assert len(stage.heard(TOPICS.clock)) >= 90  # of 100


def test_frames_and_values_are_the_simulations(stage: Stage) -> None:
    stage.run(1.0, each_tick=stage.command(Velocity(0.3, 0.2)))
    odometry = decode_odometry(stage.heard(TOPICS.odom)[-1], "odom", "base_link")
    link = decode_transform(stage.heard(TOPICS.tf)[-1].transforms[0])
    assert (link.parent, link.child, link.time) == ("odom", "base_link", odometry.time)
    assert link.pose.distance_to(odometry.pose) == 0.0
    driven = stage.simulation.referee.pose.relative_to(Pose(0.9, 1.5))
    assert odometry.pose.distance_to(driven) < 0.02
    scan = decode_laser_scan(stage.heard(TOPICS.scan)[-1], "laser")
    assert len(scan.ranges) == 360
    mount, _ = stage.heard(TOPICS.tf_static)[0].transforms
    assert decode_transform(mount).pose == stage.simulation.robot.body.lidar
    assert (mount.header.frame_id, mount.child_frame_id) == ("base_link", "laser")
    assert mount.transform.translation.z == LASER_HEIGHT


def test_covariances_say_what_wheels_cannot_know(stage: Stage) -> None:
    stage.run(0.1)
    variances = stage.heard(TOPICS.odom)[-1].pose.covariance.reshape(6, 6).diagonal()
    assert (variances[[0, 1, 5]] < 0.1).all()
    assert (variances[[2, 3, 4]] > 1e3).all()


def test_joints_are_those_of_the_urdf(stage: Stage) -> None:
    robot = ElementTree.fromstring(robot_urdf())  # noqa: S314 - our own file
    turning = [joint.attrib["name"] for joint in robot.findall("joint") if joint.attrib["type"] == "continuous"]
    assert sorted(turning) == sorted(WHEEL_JOINTS)
    laser = robot.find("joint[@name='laser_joint']/origin")
    assert laser is not None
    assert float(laser.attrib["xyz"].split()[2]) == LASER_HEIGHT
    stage.run(1.0, each_tick=stage.command(Velocity(0.2)))
    state = stage.heard(TOPICS.joint_states)[-1]
    assert state.name == WHEEL_JOINTS
    np.testing.assert_allclose(state.position, stage.simulation.physics.wheel_angles)
    np.testing.assert_allclose(state.velocity, 0.2 / 0.05, rtol=0.05)


def test_names_are_used_everywhere() -> None:
    stage = Stage(hall(), load_names(namespace="r1", frame_prefix="r1/", remappings=["scan:=front/scan"]))
    stage.run(0.2)
    assert stage.bus.heard["/r1/front/scan"][0].header.frame_id == "r1/laser"
    odometry = stage.bus.heard["/r1/odom"][0]
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("r1/odom", "r1/base_link")
    assert stage.bus.heard["/tf"][0].transforms[0].child_frame_id == "r1/base_link"


def test_it_obeys_both_kinds_of_velocity(stage: Stage) -> None:
    stage.run(1.0, each_tick=stage.command(Velocity(0.3)))
    assert stage.speed == pytest.approx(0.3, abs=0.03)

    def stamped(now: float) -> None:
        message = ros.TwistStamped(encode_header(now, "base_link"), encode_twist(Velocity(-0.3)))
        stage.bus.say(TOPICS.cmd_vel_stamped, message)

    stage.run(1.0, each_tick=stamped)
    assert stage.speed == pytest.approx(-0.3, abs=0.03)


def test_an_old_stamped_velocity_is_not_obeyed(stage: Stage) -> None:
    stage.run(1.0)
    old = ros.TwistStamped(encode_header(0.3, "base_link"), encode_twist(Velocity(0.3)))
    stage.run(0.5, each_tick=lambda _: stage.bus.say(TOPICS.cmd_vel_stamped, old))
    assert abs(stage.speed) < 0.02


def test_it_stands_half_a_second_after_the_last_velocity(stage: Stage) -> None:
    stage.run(1.5, each_tick=stage.command(Velocity(0.6)))
    assert stage.speed > 0.5
    stage.run(0.5)
    there = stage.simulation.referee.pose
    stage.run(0.5)
    assert stage.simulation.referee.pose.distance_to(there) < 0.001


@pytest.mark.parametrize("broken", [ros.Twist(ros.Vector3(math.nan)), ros.Twist(angular=ros.Vector3(z=1e9))])
def test_whoever_sends_nonsense_stops_the_robot(broken: ros.Twist, stage: Stage) -> None:
    stage.run(1.0, each_tick=stage.command(Velocity(0.3)))
    stage.run(0.5, each_tick=lambda _: stage.bus.say(TOPICS.cmd_vel, broken))
    assert abs(stage.speed) < 0.02
    stage.run(1.0)
    values = {pair.key: pair.value for pair in stage.heard(TOPICS.diagnostics)[-1].status[0].values}
    assert int(values["refused on /cmd_vel"]) >= 9
    assert "speed" in values["last refused"]


def test_two_commanders_are_told(stage: Stage) -> None:
    for _ in range(2):
        stage.bus.node().advertise(TOPICS.cmd_vel)
    stage.run(0.1)
    status = stage.heard(TOPICS.diagnostics)[-1].status[0]
    assert status.level == ros.DiagnosticStatus.WARN
    assert "2 publishers" in status.message


def test_the_latch_answers_every_command_once_it_is_carried_out() -> None:
    stage = Stage(hall())
    stage.run(0.2)
    assert stage.latch == LatchState(stage.latch.time, loaded=False, answered=0.0)
    assert not stage.ask_latch(close=True).loaded  # nothing in the fork


def test_a_box_is_held_and_kept_until_the_warehouse() -> None:
    drawing = HALL.replace("|     >                         |", "|     >   o                     |")
    stage = Stage(hall(drawing))
    while stage.simulation.referee.pose.x < 1.49:
        stage.run(0.05, each_tick=stage.command(Velocity(0.2)))
    state = stage.ask_latch(close=True)
    assert state.loaded
    count = len(stage.heard(TOPICS.latch_state))
    stage.run(1.0)
    assert len(stage.heard(TOPICS.latch_state)) - count >= 9  # again and again
    assert stage.ask_latch(close=False).loaded  # interlocked


def test_a_command_that_comes_twice_or_late_is_carried_out_once() -> None:
    drawing = HALL.replace("|     >                         |", "|     >   o                     |")
    stage = Stage(hall(drawing))
    stage.run(0.2)
    number = stage.ask_latch(close=True).answered
    while stage.simulation.referee.pose.x < 1.49:
        stage.run(0.05, each_tick=stage.command(Velocity(0.2)))
    for late in (number, number - 0.1):
        state = stage.ask_latch(close=True, number=late)
        assert not state.loaded
        assert state.answered == number
    assert stage.ask_latch(close=True).loaded


@pytest.mark.realtime
def test_it_keeps_real_time_times_the_rate() -> None:
    stage = Stage(hall(), rate=4.0)
    started = time.monotonic()
    stage.run(2.0)
    assert time.monotonic() - started == pytest.approx(0.5, abs=0.2)


@pytest.mark.realtime
def test_a_pause_is_not_caught_up_with() -> None:
    """After the machine slept, time goes on from there: nobody wants ten seconds of scans at once."""
    stage = Stage(hall(), rate=2.0)
    slept = []

    def sleep_once(now: float) -> None:
        if now >= 0.5 and not slept:
            slept.append(time.sleep(1.0))

    started = time.monotonic()
    stage.run(2.0, each_tick=sleep_once)
    assert time.monotonic() - started > 1.9


def test_worlds_are_those_of_the_delivery() -> None:
    assert len(prepare(Settings("small", boxes=1)).plan.boxes) == 1
    for settings in (Settings("small", boxes=-1), Settings("small", rate=0.0), Settings("small", rate=math.nan)):
        with pytest.raises(InputError):
            prepare(settings)
