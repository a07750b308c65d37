"""A simulated robot as a robot of ROS, in real time: what it senses goes out, ``/cmd_vel`` and latch commands come in.

All stamps are of the simulation's clock, which ``/clock`` tells. At every instant that has measurements, first the
clock goes out, then the transform from odom to base_link, then odometry, and the scan last, for it needs the others.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Any, Protocol

import numpy as np

from wherry.robot import Odometry, Robot, Scan, Velocity
from wherry.ros import messages as ros
from wherry.ros.decoding import MessageError, decode_stamp, decode_twist
from wherry.ros.diagnostics import OK, WARN, RejectedMessages, diagnostic_array, diagnostic_status
from wherry.ros.encoding import encode_header, encode_laser_scan, encode_odometry, encode_stamp, encode_transform
from wherry.ros.names import RosNames
from wherry.ros.nodes.latch import LatchCommand, LatchState, from_latch_command, to_latch_state
from wherry.ros.topics import Topic
from wherry.ros.transforms import StampedTransform
from wherry.ros.transports.protocol import Transport
from wherry.space.pose import IDENTITY, Floats

OLDEST_COMMAND = 0.5  # s; what was commanded earlier no longer holds
LARGEST_LAG = 0.25  # s that the simulation may catch up; beyond that, time is given up
KNOWN, UNKNOWN = 1e-3, 1e6  # m², rad²: variances of what wheels measure, and of what they do not
COVARIANCE = np.diag([KNOWN, KNOWN, UNKNOWN, UNKNOWN, UNKNOWN, KNOWN]).ravel()
STANDSTILL = Velocity()


class World(Protocol):
    """A simulation, as far as it has to be known here."""

    @property
    def time(self) -> float:
        """S."""
        ...

    @property
    def robot(self) -> Robot:
        """Obeys."""
        ...

    def advance(self) -> None:
        """Let time pass until the next measurements."""
        ...

    def measure(self) -> list[Scan | Odometry]:
        """What the sensors say now."""
        ...


@dataclass(frozen=True)
class Hardware:
    """What messages tell of a robot beyond a `Robot`.

    Attributes:
        period: s, from one odometry to the next.
        scan_period: s, from one scan to the next.
        base_height: m, of base_link above the floor.
        laser_height: m, of the lidar above base_link.
        wheel_joints: Their names.
        wheel_angles: [W] rad, how far they have turned.
    """

    period: float
    scan_period: float
    base_height: float
    laser_height: float
    wheel_joints: tuple[str, ...]
    wheel_angles: Callable[[], Floats]


class SimulatorNode:
    """Runs a simulation at a multiple of real time, and is its robot's driver software.

    Args:
        world: The simulation.
        hardware: The rest of what there is to tell of its robot.
        transport: ROS.
        names: What everything is called.
        rate: Simulated seconds a second.
    """

    def __init__(
        self, world: World, hardware: Hardware, transport: Transport, names: RosNames, *, rate: float = 1.0
    ) -> None:
        self._world = world
        self._hardware = hardware
        self._transport = transport
        self._topics, self._frames, self._rates = names.topics, names.frames, names.rates
        self._rate = rate
        self._commands: SimpleQueue[Velocity | LatchCommand] = SimpleQueue()
        self._refusals = RejectedMessages()
        self._angles = hardware.wheel_angles()
        self._loaded = False
        self._answered = 0.0
        self._lag = 0.0
        self._next_state = self._next_diagnostics = world.time
        self._anchor = (time.monotonic(), world.time)  # an instant on both clocks
        self._connect()

    def run(self, stopped: Callable[[], bool] = lambda: False) -> None:
        """Run until ``stopped``."""
        self._anchor = (time.monotonic(), self._world.time)
        while not stopped():
            self._wait_until(self._world.time + self._hardware.period)
            self._obey()
            self._world.advance()
            self._tell(self._world.measure())

    def _connect(self) -> None:
        topics = self._topics
        own: tuple[Topic[Any], ...] = (topics.clock, topics.tf, topics.odom, topics.scan, topics.joint_states)
        for topic in own:
            self._transport.advertise(topic)
        self._transport.publish(topics.tf_static, self._fixed_links())
        self._transport.subscribe(topics.cmd_vel, self._hear_twist)
        if self._transport.ros_version == 2:
            self._transport.subscribe(topics.cmd_vel_stamped, self._hear_stamped_twist)
        self._transport.subscribe(topics.latch_command, self._hear_latch_command)

    def _fixed_links(self) -> ros.TFMessage:
        """Where the lidar is on the robot, and where the robot stands."""
        frames, now = self._frames, self._world.time
        mount = StampedTransform(frames.base_link, frames.laser, now, self._world.robot.body.lidar)
        footprint = StampedTransform(frames.base_link, frames.base_footprint, now, IDENTITY)
        hardware = self._hardware
        return ros.TFMessage(
            (encode_transform(mount, hardware.laser_height), encode_transform(footprint, -hardware.base_height))
        )

    # ---- in: on the transport's thread

    def _hear_twist(self, message: ros.Twist) -> None:
        try:
            self._commands.put(decode_twist(message))
        except MessageError as error:
            self._refusals.add(self._topics.cmd_vel.name, error)
            self._commands.put(STANDSTILL)  # whoever sends this must not go on driving

    def _hear_stamped_twist(self, message: ros.TwistStamped) -> None:
        try:
            stamp = decode_stamp(message.header.stamp)
        except MessageError as error:
            self._refusals.add(self._topics.cmd_vel.name, error)
            return
        if stamp and self._world.time - stamp > OLDEST_COMMAND:
            self._refusals.add(self._topics.cmd_vel.name, f"was commanded {self._world.time - stamp:.1f} s ago")
            return
        self._hear_twist(message.twist)

    def _hear_latch_command(self, message: ros.JointState) -> None:
        try:
            self._commands.put(from_latch_command(message))
        except MessageError as error:
            self._refusals.add(self._topics.latch_command.name, error)

    def _obey(self) -> None:
        """Carry out what was heard since the last instant; of several velocities the last one counts."""
        while True:
            try:
                command = self._commands.get_nowait()
            except Empty:
                return
            if isinstance(command, Velocity):
                self._world.robot.command(command)
            else:
                self._work_latch(command)

    def _work_latch(self, command: LatchCommand) -> None:
        if command.number > self._answered:
            robot = self._world.robot
            self._loaded = robot.close_latch() if command.close else not robot.open_latch()
            self._answered = command.number
        self._tell_latch()

    # ---- out

    def _wait_until(self, instant: float) -> None:
        """Sleep until a simulated instant has come, telling what time it is meanwhile."""
        self._lag = self._now() - instant
        if self._lag > LARGEST_LAG:
            self._anchor = (time.monotonic(), instant)
        tick = 1 / self._rates.clock
        ticked = self._world.time
        while (left := instant - self._now()) > 0.0:
            if ticked + tick < instant - tick / 2:
                time.sleep(max(min(ticked + tick - self._now(), left), 0.0) / self._rate)
                ticked += tick
                self._transport.publish(self._topics.clock, ros.Clock(encode_stamp(ticked)))
            else:
                time.sleep(left / self._rate)

    def _now(self) -> float:
        """s, on the simulation's clock, if it went on evenly."""
        wall, simulated = self._anchor
        return simulated + (time.monotonic() - wall) * self._rate

    def _tell(self, measurements: list[Scan | Odometry]) -> None:
        self._transport.publish(self._topics.clock, ros.Clock(encode_stamp(self._world.time)))
        for measurement in measurements:
            if isinstance(measurement, Odometry):
                self._tell_odometry(measurement)
            else:
                scan = encode_laser_scan(measurement, self._frames.laser, self._hardware.scan_period)
                self._transport.publish(self._topics.scan, scan)
        self._tell_wheels()
        if self._world.time >= self._next_state:
            self._next_state = self._world.time + 1 / self._rates.latch_state
            self._tell_latch()
        if self._world.time >= self._next_diagnostics:
            self._next_diagnostics = self._world.time + 1 / self._rates.diagnostics
            self._tell_diagnostics()

    def _tell_odometry(self, odometry: Odometry) -> None:
        odom, base = self._frames.odom, self._frames.base_link
        link = StampedTransform(odom, base, odometry.time, odometry.pose)
        self._transport.publish(self._topics.tf, ros.TFMessage((encode_transform(link),)))
        self._transport.publish(self._topics.odom, encode_odometry(odometry, odom, base, COVARIANCE))

    def _tell_wheels(self) -> None:
        before, self._angles = self._angles, self._hardware.wheel_angles()
        turning = (self._angles - before) / self._hardware.period
        header = encode_header(self._world.time, "")
        state = ros.JointState(header, self._hardware.wheel_joints, self._angles, turning)
        self._transport.publish(self._topics.joint_states, state)

    def _tell_latch(self) -> None:
        state = LatchState(self._world.time, self._loaded, self._answered)
        self._transport.publish(self._topics.latch_state, to_latch_state(state))

    def _tell_diagnostics(self) -> None:
        commanders = self._transport.count_publishers(self._topics.cmd_vel)
        late, many = self._lag > LARGEST_LAG, commanders > 1
        text = "runs"
        if many:
            text = f"{commanders} publishers command the robot; it obeys the last message"
        elif late:
            text = "this machine is too slow for the rate"
        values = {
            "rate": self._rate,
            "lag, s": f"{max(self._lag, 0.0):.3f}",
            "publishers of velocities": commanders,
            **{f"refused on {topic}": count for topic, count in self._refusals.counts.items()},
            "last refused": self._refusals.last,
        }
        status = diagnostic_status("wherry: simulator", WARN if late or many else OK, text, values)
        self._transport.publish(self._topics.diagnostics, diagnostic_array(self._world.time, status))
