"""A simulated robot as a ROS robot, in real time: it publishes measurements, and obeys velocities and latch commands.

All stamps are of the simulation's clock, which ``/clock`` publishes. At every instant with measurements the order is:
clock, transform from odom to base_link, odometry, scan; so that a scan's transform precedes it.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Any, Protocol

import numpy as np

from wherry.robot import Odometry, Robot, Scan, Velocity
from wherry.ros import messages as ros
from wherry.ros.decoding import MessageError, decode_stamp, decode_twist
from wherry.ros.diagnostics import OK, WARN, RejectedMessages, diagnostic_array, diagnostic_status
from wherry.ros.encoding import encode_header, encode_laser_scan, encode_odometry, encode_stamp, encode_transform
from wherry.ros.names import RosNames, Topics
from wherry.ros.nodes.latch_protocol import LatchCommand, LatchState, decode_latch_command, encode_latch_state
from wherry.ros.nodes.pacer import RealTimePacer
from wherry.ros.topics import Topic
from wherry.ros.transforms import StampedTransform
from wherry.ros.transports.protocol import Transport
from wherry.simulation import Simulation
from wherry.simulation.drive import WHEEL_RADIUS
from wherry.simulation.model import LASER_HEIGHT
from wherry.simulation.simulator import ODOMETRY_RATE
from wherry.space.pose import IDENTITY, Floats

COMMAND_MAX_AGE = 0.5  # s, of a stamped velocity; an older one is rejected
MEASURED_VARIANCE, UNMEASURED_VARIANCE = 1e-3, 1e6  # m² and rad², of x, y, yaw; and of z, roll, pitch
COVARIANCE = np.diag([MEASURED_VARIANCE] * 2 + [UNMEASURED_VARIANCE] * 3 + [MEASURED_VARIANCE]).ravel()
WHEEL_JOINTS = ("left_wheel_joint", "right_wheel_joint")
STANDSTILL = Velocity()


class SimulatedWorld(Protocol):
    """The part of a `Simulation` that the node uses."""

    @property
    def time(self) -> float:
        """Simulated time, s."""
        ...

    @property
    def robot(self) -> Robot:
        """The simulated robot."""
        ...

    def advance(self) -> None:
        """Advance to the time of the next measurements."""
        ...

    def measure(self) -> list[Scan | Odometry]:
        """Measurements of the present time."""
        ...


@dataclass(frozen=True)
class RobotHardware:
    """Properties of a robot that messages need beyond the `Robot` protocol.

    Attributes:
        odometry_period: Time between two odometry messages, s.
        scan_period: Time between two scans, s.
        base_height: Height of base_link above the floor, m.
        laser_height: Height of the lidar above base_link, m.
        wheel_joints: Names of the wheels' joints.
        wheel_angles: Returns the angles of these joints, [W] rad.
    """

    odometry_period: float
    scan_period: float
    base_height: float
    laser_height: float
    wheel_joints: tuple[str, ...]
    wheel_angles: Callable[[], Floats]

    @classmethod
    def of(cls, simulation: Simulation) -> RobotHardware:
        """The hardware of a simulation's robot."""
        return cls(
            odometry_period=1 / ODOMETRY_RATE,
            scan_period=1 / simulation.lidar.specification.rate,
            base_height=WHEEL_RADIUS,
            laser_height=LASER_HEIGHT,
            wheel_joints=WHEEL_JOINTS,
            wheel_angles=lambda: simulation.physics.wheel_angles,
        )


class CommandQueue:
    """Velocities and latch commands, queued from the transport's thread to the simulation's.

    Args:
        transport: Connection to ROS.
        topics: Names of the robot's topics.
        now: Returns the simulated time, s.

    Attributes:
        rejected: Counts of rejected messages by topic.
    """

    def __init__(self, transport: Transport, topics: Topics, now: Callable[[], float]) -> None:
        self.rejected = RejectedMessages()
        self._topics, self._now = topics, now
        self._queue: SimpleQueue[Velocity | LatchCommand] = SimpleQueue()
        transport.subscribe(topics.cmd_vel, self._on_twist)
        if transport.ros_version == 2:
            transport.subscribe(topics.cmd_vel_stamped, self._on_stamped_twist)
        transport.subscribe(topics.latch_command, self._on_latch_command)

    def drain(self) -> Iterator[Velocity | LatchCommand]:
        """Remove and yield the queued commands in the order of their arrival."""
        with contextlib.suppress(Empty):
            while True:
                yield self._queue.get_nowait()

    def _on_twist(self, message: ros.Twist) -> None:
        try:
            self._queue.put(decode_twist(message))
        except MessageError as error:
            self.rejected.add(self._topics.cmd_vel.name, error)
            self._queue.put(STANDSTILL)  # a node that sends invalid velocities must not drive the robot

    def _on_stamped_twist(self, message: ros.TwistStamped) -> None:
        try:
            stamp = decode_stamp(message.header.stamp)
        except MessageError as error:
            self.rejected.add(self._topics.cmd_vel.name, error)
            return
        age = self._now() - stamp
        if stamp and age > COMMAND_MAX_AGE:
            self.rejected.add(self._topics.cmd_vel.name, f"was commanded {age:.1f} s ago")
            return
        self._on_twist(message.twist)

    def _on_latch_command(self, message: ros.JointState) -> None:
        try:
            self._queue.put(decode_latch_command(message))
        except MessageError as error:
            self.rejected.add(self._topics.latch_command.name, error)


class SimulatorNode:
    """The driver of a simulated robot; runs the simulation at a multiple of real time.

    Args:
        world: The simulation.
        hardware: Properties of the robot that its messages contain.
        transport: Connection to ROS.
        names: Names of topics and frames, and publishing rates.
        rate: Simulated seconds per second.
    """

    def __init__(
        self,
        world: SimulatedWorld,
        hardware: RobotHardware,
        transport: Transport,
        names: RosNames,
        *,
        rate: float = 1.0,
    ) -> None:
        self._world = world
        self._hardware = hardware
        self._transport = transport
        self._topics, self._frames, self._rates = names.topics, names.frames, names.rates
        self._pacer = RealTimePacer(rate, world.time)
        self._wheel_angles = hardware.wheel_angles()
        self._has_load = False
        self._answered = 0.0  # s, stamp of the last latch command carried out
        self._next_latch_state = self._next_diagnostics = world.time
        self._advertise()
        self._commands = CommandQueue(transport, names.topics, lambda: self._world.time)

    def run(self, stopped: Callable[[], bool] = lambda: False) -> None:
        """Run until ``stopped`` returns True."""
        self._pacer.restart(self._world.time)
        while not stopped():
            self._pacer.wait_until(
                self._world.time + self._hardware.odometry_period,
                last=self._world.time,
                period=1 / self._rates.clock,
                on_tick=self._publish_clock,
            )
            self._execute_commands()
            self._world.advance()
            self._publish(self._world.measure())

    def _advertise(self) -> None:
        topics = self._topics
        own: tuple[Topic[Any], ...] = (topics.clock, topics.tf, topics.odom, topics.scan, topics.joint_states)
        for topic in own:
            self._transport.advertise(topic)
        self._transport.publish(topics.tf_static, self._static_transforms())

    def _static_transforms(self) -> ros.TFMessage:
        """The lidar's and the footprint's poses in base_link."""
        frames, now, hardware = self._frames, self._world.time, self._hardware
        lidar = StampedTransform(frames.base_link, frames.laser, now, self._world.robot.body.lidar)
        footprint = StampedTransform(frames.base_link, frames.base_footprint, now, IDENTITY)
        return ros.TFMessage(
            (encode_transform(lidar, hardware.laser_height), encode_transform(footprint, -hardware.base_height))
        )

    # ---- commands

    def _execute_commands(self) -> None:
        """Execute the commands received since the last step, in order, so that the last velocity takes effect."""
        for command in self._commands.drain():
            if isinstance(command, Velocity):
                self._world.robot.command(command)
            else:
                self._execute_latch_command(command)

    def _execute_latch_command(self, command: LatchCommand) -> None:
        if command.stamp > self._answered:
            robot = self._world.robot
            self._has_load = robot.close_latch() if command.close else not robot.open_latch()
            self._answered = command.stamp
        self._publish_latch_state()

    # ---- publications

    def _publish(self, measurements: list[Scan | Odometry]) -> None:
        now = self._world.time
        self._publish_clock(now)
        for measurement in measurements:
            if isinstance(measurement, Odometry):
                self._publish_odometry(measurement)
            else:
                scan = encode_laser_scan(measurement, self._frames.laser, self._hardware.scan_period)
                self._transport.publish(self._topics.scan, scan)
        self._publish_joint_states()
        if now >= self._next_latch_state:
            self._next_latch_state = now + 1 / self._rates.latch_state
            self._publish_latch_state()
        if now >= self._next_diagnostics:
            self._next_diagnostics = now + 1 / self._rates.diagnostics
            self._publish_diagnostics()

    def _publish_clock(self, now: float) -> None:
        self._transport.publish(self._topics.clock, ros.Clock(encode_stamp(now)))

    def _publish_odometry(self, odometry: Odometry) -> None:
        odom, base = self._frames.odom, self._frames.base_link
        transform = StampedTransform(odom, base, odometry.time, odometry.pose)
        self._transport.publish(self._topics.tf, ros.TFMessage((encode_transform(transform),)))
        self._transport.publish(self._topics.odom, encode_odometry(odometry, odom, base, COVARIANCE))

    def _publish_joint_states(self) -> None:
        before, self._wheel_angles = self._wheel_angles, self._hardware.wheel_angles()
        speeds = (self._wheel_angles - before) / self._hardware.odometry_period
        header = encode_header(self._world.time, "")
        state = ros.JointState(header, self._hardware.wheel_joints, self._wheel_angles, speeds)
        self._transport.publish(self._topics.joint_states, state)

    def _publish_latch_state(self) -> None:
        state = LatchState(self._world.time, self._has_load, self._answered)
        self._transport.publish(self._topics.latch_state, encode_latch_state(state))

    def _publish_diagnostics(self) -> None:
        publishers = self._transport.count_publishers(self._topics.cmd_vel)
        level, text = OK, "running"
        if publishers > 1:
            level, text = WARN, f"{publishers} publishers command the robot; it obeys the last message"
        elif self._pacer.is_late:
            level, text = WARN, "this machine is too slow for the rate"
        rejected = self._commands.rejected
        values = {
            "rate": self._pacer.rate,
            "lag, s": f"{max(self._pacer.lag, 0.0):.3f}",
            "publishers of velocities": publishers,
            **{f"refused on {topic}": count for topic, count in rejected.counts.items()},
            "last refused": rejected.last,
        }
        status = diagnostic_status("wherry: simulator", level, text, values)
        self._transport.publish(self._topics.diagnostics, diagnostic_array(self._world.time, status))


def simulator_node(simulation: Simulation, transport: Transport, names: RosNames, rate: float = 1.0) -> SimulatorNode:
    """The node of a simulation's robot, at ``rate`` simulated seconds per second."""
    return SimulatorNode(simulation, RobotHardware.of(simulation), transport, names, rate=rate)
