"""A node that operates the detachable joints of Gazebo Sim as the latch that the agent uses.

Gazebo's joints implement neither ``latch/command`` and ``latch/state`` nor the warehouse's interlock. Each box of an
exported world has its own joint. An empty message attaches it to the box in the current pose, and it reports "attached"
or "detached" only when that changes. The node therefore

- attaches the joint of the box in the fork, which it determines from the models' poses;
- detaches it over the warehouse only, as the simulator's interlock does, and has Gazebo move the box out of the
  building;
- answers a command once Gazebo has reported the change. The client repeats a command that is not answered, and the node
  then repeats its request.

It publishes nothing until the world itself has detached the joints, which begin attached. It first detaches them once
more, in case an earlier node left one attached.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

from wherry.gazebo.latch_settings import GazeboLatchSettings
from wherry.gazebo.latch_topics import (
    ATTACHED,
    DETACHED,
    OPEN,
    OPENING_SECONDS,
    ROBOT,
    box_name,
    close_topic,
    pose_topic,
    removal_topic,
    state_topic,
)
from wherry.ros import messages as ros
from wherry.ros.decoding import MessageError, decode_pose, decode_stamp
from wherry.ros.diagnostics import RejectedMessages
from wherry.ros.names import RosNames
from wherry.ros.nodes.latch_protocol import LatchCommand, LatchState, decode_latch_command, encode_latch_state
from wherry.ros.nodes.subscriptions import Subscriptions
from wherry.ros.transports.protocol import Transport
from wherry.space.pose import Pose


class GazeboLatch:
    """The latch node of an exported world.

    Args:
        settings: Settings of the latch in the world.
        transport: Connection to ROS.
        names: Names of the agent's topics, and the rate of the latch's state.
    """

    def __init__(self, settings: GazeboLatchSettings, transport: Transport, names: RosNames) -> None:
        self._settings = settings
        self._transport = transport
        self._command, self._state = names.topics.latch_command, names.topics.latch_state
        self._period = 1 / names.rates.latch_state
        self._subscriptions = Subscriptions(transport)
        self._time = 0.0  # s, the world's clock
        self._poses: dict[str, Pose] = {}  # by model, world frame
        self._attached: set[int] = set()
        self._delivered: set[int] = set()
        self._is_reset = False
        self._pending: LatchCommand | None = None  # requested from Gazebo, but not reported by it yet
        self._answered = 0.0  # s, stamp of the last command carried out
        self._connect()

    def run(self, stopped: Callable[[], bool] = lambda: False) -> None:
        """Publish the latch's state until ``stopped`` returns True; messages are handled by their callbacks."""
        while not stopped():
            with self._subscriptions.changed:
                self._reset()
                self._publish_state()
            time.sleep(self._period)

    @property
    def rejected(self) -> RejectedMessages:
        """Counts of rejected messages by topic."""
        return self._subscriptions.rejected

    @property
    def is_ready(self) -> bool:
        """Whether Gazebo is running and has detached all joints."""
        return self._is_reset and self._time >= OPENING_SECONDS[-1] + 1

    def _connect(self) -> None:
        transport, subscriptions = self._transport, self._subscriptions
        transport.advertise(OPEN)
        transport.advertise(self._state)
        for model in (ROBOT, *map(box_name, range(self._settings.boxes))):
            subscriptions.add(pose_topic(model), partial(self._on_pose, model))
        for box in range(self._settings.boxes):
            transport.advertise(close_topic(box))
            transport.advertise(removal_topic(box))
            subscriptions.add(state_topic(box), partial(self._on_joint_state, box))
        subscriptions.add(self._command, self._on_command)

    # ---- callbacks; called with the lock held

    def _on_pose(self, model: str, message: ros.PoseStamped) -> None:
        seconds, pose = decode_stamp(message.header.stamp), decode_pose(message.pose)
        self._poses[model] = pose
        if model == ROBOT:
            self._time = seconds

    def _on_joint_state(self, box: int, message: ros.String) -> None:
        if message.data == ATTACHED:
            self._attached.add(box)
        elif message.data == DETACHED:
            self._attached.discard(box)
            self._remove_if_delivered(box)
        else:
            raise MessageError(f"is {message.data!r} instead of {ATTACHED!r} or {DETACHED!r}")
        if self._pending is not None and self._pending.close == bool(self._attached):
            self._answer(self._pending)
        self._publish_state()

    def _on_command(self, message: ros.JointState) -> None:
        command = decode_latch_command(message)
        if self.is_ready and command.stamp > self._answered:
            self._execute(command)
        self._publish_state()

    # ---- joints; called with the lock held

    def _execute(self, command: LatchCommand) -> None:
        """Request the change from Gazebo; a command that changes nothing is answered at once."""
        box = self._box_in_fork()
        can_open = self._settings.is_over_warehouse(self._poses[ROBOT])
        if command.close and not self._attached and box is not None:
            self._pending = command
            self._transport.publish(close_topic(box), ros.Empty())
        elif not command.close and self._attached and can_open:
            self._pending = command
            self._transport.publish(OPEN, ros.Empty())
        else:
            self._answer(command)

    def _answer(self, command: LatchCommand) -> None:
        self._answered, self._pending = command.stamp, None

    def _box_in_fork(self) -> int | None:
        """Number of the box that the latch can close around; None if there is none."""
        robot = self._poses[ROBOT]
        for box in sorted(set(range(self._settings.boxes)) - self._delivered):
            pose = self._poses.get(box_name(box))
            if pose is not None and pose.distance_to(robot) <= self._settings.reach:
                return box
        return None

    def _remove_if_delivered(self, box: int) -> None:
        """Have Gazebo move a box out of the building if it was detached on command."""
        if self._pending is not None and not self._pending.close:
            self._delivered.add(box)
            self._transport.publish(removal_topic(box), ros.Empty())

    def _reset(self) -> None:
        """Detach every joint once, as soon as Gazebo is running."""
        if not self._is_reset and ROBOT in self._poses and self._transport.count_subscribers(OPEN):
            self._is_reset = True
            self._transport.publish(OPEN, ros.Empty())

    def _publish_state(self) -> None:
        if self.is_ready:
            state = LatchState(self._time, bool(self._attached), self._answered)
            self._transport.publish(self._state, encode_latch_state(state))
