"""The latch in Gazebo, tested with a stand-in for Gazebo and its bridge, in one process and over DDS."""

from __future__ import annotations

import itertools
import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wherry.floorplan.plan import Cell
from wherry.floorplan.world_files import find_world
from wherry.gazebo.export import GazeboExportSettings, export_world
from wherry.gazebo.latch import GazeboLatch
from wherry.gazebo.latch_settings import GazeboLatchSettings, format_latch_settings, load_latch_settings
from wherry.gazebo.latch_topics import close_topic, pose_topic, state_topic
from wherry.robot import Velocity
from wherry.ros import messages as ros
from wherry.ros.encoding import encode_header, encode_pose
from wherry.ros.names import Rates, load_names
from wherry.ros.nodes.latch_protocol import LatchCommand, LatchState, decode_latch_state, encode_latch_command
from wherry.ros.transports.ros2 import Ros2Transport
from wherry.simulation.simulator import LATCH_REACH
from wherry.space.pose import Pose
from wherry_testing.bus import Bus, free_domain
from wherry_testing.dds import wait_until, wherry
from wherry_testing.gazebo import NEAR, FakeGazebo, RunningGazebo, settings_file
from wherry_testing.invalid_files import assert_file_is_rejected
from wherry_testing.worlds import hall

TOPICS = load_names().topics
DOMAIN = free_domain()
ON_THE_BOX, ON_THE_WAREHOUSE = Pose(1.5, 0.3), Pose(2.1, 0.3)
SETTINGS = GazeboLatchSettings(2, LATCH_REACH, 0.6, frozenset({Cell(2, 1)}))
NEAR_SETTINGS = GazeboLatchSettings(2, LATCH_REACH, 0.6, frozenset({Cell(3, 0)}))


class Stage:
    """Gazebo, the latch and a client on one bus; a test advances the time."""

    def __init__(self, *, ready: bool = True) -> None:
        self.bus = Bus()
        self.gazebo = FakeGazebo(hall(NEAR), self.bus.node())
        self.latch = GazeboLatch(NEAR_SETTINGS, self.bus.node(), replace(load_names(), rates=Rates(latch_state=1000.0)))
        self.stamps = itertools.count(1)
        if ready:
            self.advance(2.1)

    @property
    def states(self) -> list[LatchState]:
        return [decode_latch_state(message) for message in self.bus.published[TOPICS.latch_state.name]]

    def advance(self, seconds: float) -> None:
        end = self.gazebo.time + seconds
        while self.gazebo.time < end - 1e-9:
            self.gazebo.advance()
            self.latch.run(iter([False, True]).__next__)

    def place(self, robot: Pose) -> None:
        held = next(iter(self.gazebo.attached), None)
        self.gazebo.physics.place_robot(robot, held)
        self.advance(0.05)

    def request(self, *, close: bool) -> LatchCommand:
        command = LatchCommand(float(next(self.stamps)), close)
        self.bus.publish(TOPICS.latch_command, encode_latch_command(command))
        return command

    def request_and_wait(self, *, close: bool) -> bool:
        """Request a change; returns whether the latch holds a box after the answer."""
        command = self.request(close=close)
        self.advance(0.1)
        assert self.states[-1].answers(command)
        return self.states[-1].has_load


@pytest.fixture
def stage() -> Stage:
    return Stage()


def test_joints_are_opened_before_the_first_state() -> None:
    stage = Stage(ready=False)
    assert stage.gazebo.attached == {0, 1}
    stage.advance(1.9)
    assert stage.gazebo.attached == set()
    assert not stage.states
    stage.request(close=True)  # too early: the world would open the joint again
    assert not stage.bus.published[close_topic(0).name]
    stage.advance(0.2)
    assert not stage.states[-1].has_load
    assert stage.states[-1].answered == 0.0
    assert not stage.gazebo.removed


def test_joint_left_attached_by_an_earlier_node_is_opened() -> None:
    stage = Stage(ready=False)
    stage.gazebo.simulation._tick = 100  # 5 s
    stage.advance(0.1)
    assert stage.gazebo.attached == set()
    assert not stage.states[-1].has_load
    assert not stage.gazebo.removed


def test_latch_closes_around_the_box_in_the_fork_only(stage: Stage) -> None:
    stage.place(ON_THE_BOX)
    assert stage.request_and_wait(close=True)
    assert stage.gazebo.attached == {0}
    assert len(stage.bus.published[close_topic(0).name]) == 1
    assert not stage.bus.published[close_topic(1).name]


@pytest.mark.parametrize(("offset", "has_load"), [(LATCH_REACH - 0.005, True), (LATCH_REACH + 0.005, False)])
def test_reach_is_the_simulators(stage: Stage, offset: float, has_load: bool) -> None:
    stage.place(Pose(ON_THE_BOX.x - offset, ON_THE_BOX.y))
    assert stage.request_and_wait(close=True) is has_load


def test_latch_opens_over_the_warehouse_only_and_the_box_is_removed(stage: Stage) -> None:
    stage.place(ON_THE_BOX)
    assert stage.request_and_wait(close=True)
    assert stage.request_and_wait(close=False)
    assert stage.gazebo.attached == {0}
    stage.place(ON_THE_WAREHOUSE)
    assert not stage.request_and_wait(close=False)
    assert stage.gazebo.attached == set()
    assert stage.gazebo.removed == [0]
    assert not stage.request_and_wait(close=True)  # it was removed


def test_repeated_command_is_carried_out_once_and_answered_again(stage: Stage) -> None:
    stage.place(ON_THE_BOX)
    command = stage.request(close=True)
    stage.advance(0.1)
    stage.bus.publish(TOPICS.latch_command, encode_latch_command(command))
    stage.advance(0.1)
    assert stage.states[-1].answers(command)
    assert len(stage.bus.published[close_topic(0).name]) == 1


def test_answer_follows_gazebos_report(stage: Stage) -> None:
    stage.place(ON_THE_BOX)
    command = stage.request(close=True)
    assert not stage.states[-1].answers(command)
    stage.bus.publish(TOPICS.latch_command, encode_latch_command(command))  # repeated, and so is the node's request
    assert len(stage.bus.published[close_topic(0).name]) == 2
    stage.advance(0.1)
    assert stage.states[-1] == LatchState(pytest.approx(stage.gazebo.time), True, command.stamp)
    assert stage.gazebo.attached == {0}


def test_command_that_changes_nothing_is_answered_at_once(stage: Stage) -> None:
    assert not stage.request_and_wait(close=False)
    stage.place(ON_THE_BOX)
    assert stage.request_and_wait(close=True)
    assert stage.request_and_wait(close=True)


def test_box_detached_by_another_node_is_reported_and_not_removed(stage: Stage) -> None:
    stage.place(ON_THE_BOX)
    assert stage.request_and_wait(close=True)
    stage.gazebo.execute("detach", 0)
    assert not stage.states[-1].has_load
    assert not stage.gazebo.removed
    assert stage.request_and_wait(close=True)


def test_invalid_messages_are_rejected(stage: Stage) -> None:
    broken = ros.PoseStamped(encode_header(9.0, "world"), encode_pose(Pose(float("nan"))))
    stage.bus.publish(pose_topic("wherry"), broken)
    stage.bus.publish(state_topic(0), ros.String("unknown"))
    stage.bus.publish(TOPICS.latch_command, ros.JointState(name=("latch",), position=np.array([0.5])))
    rejected = {"/model/wherry/pose": 1, "/latch/state/box_0": 1, "/latch/command": 1}
    assert stage.latch.rejected.counts == rejected
    stage.place(ON_THE_BOX)
    assert stage.request_and_wait(close=True)


# ---- the settings file of an export


def test_export_contains_the_latchs_settings(tmp_path: Path) -> None:
    export_world(GazeboExportSettings("small", tmp_path, boxes=1))
    settings, plan = load_latch_settings(tmp_path / "latch.yaml"), find_world("small")
    assert settings == GazeboLatchSettings(1, LATCH_REACH, plan.cell_size, plan.warehouse)


def test_settings_are_read_as_written(tmp_path: Path) -> None:
    (tmp_path / "latch.yaml").write_text(format_latch_settings(SETTINGS))
    assert load_latch_settings(tmp_path / "latch.yaml") == SETTINGS
    assert SETTINGS.is_over_warehouse(Pose(1.21, 0.61))
    assert not SETTINGS.is_over_warehouse(Pose(1.19, 0.61))
    assert not SETTINGS.is_over_warehouse(Pose(-0.1, 0.61))


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        ("wherry-latch: 1", "wherry-latch: 2", "wherry-latch"),
        ("boxes: 2", "boxes: -1", "boxes"),
        ("boxes: 2", "boxes: true", "boxes"),
        ("boxes: 2", "", "boxes"),
        ("reach: 0.05", "reach: .nan", "reach"),
        ("cell_size: 0.6", "cell_size: 0", "cell_size"),
        ("cell_size: 0.6", "cell_size: 1e-320", "cell_size"),
        ("warehouse:", "warehouse: 3\nhouse:", "warehouse"),
        ("- 1\n", "- 1.5\n", "warehouse.0.1"),
        ("boxes: 2", "boxes: 2\nbox: 3", "box"),
        ("boxes: 2", "boxes: [", "line 4"),
    ],
)
def test_invalid_settings_files_are_rejected(tmp_path: Path, old: str, new: str, field: str) -> None:
    text = format_latch_settings(SETTINGS)
    assert old in text
    assert_file_is_rejected(load_latch_settings, tmp_path / "latch.yaml", text.replace(old, new), field)


# ---- over DDS, with the command itself as the node


@pytest.fixture
def bridge(monkeypatch: pytest.MonkeyPatch) -> Iterator[Ros2Transport]:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(DOMAIN))
    with Ros2Transport() as transport:
        yield transport


def is_before_the_box(gazebo: FakeGazebo) -> bool:
    return gazebo.physics.robot_pose.x < ON_THE_BOX.x - 0.02


def test_command_latches_a_box_over_dds(bridge: Ros2Transport, tmp_path: Path) -> None:
    """The robot drives over the box and closes the latch."""
    states: list[LatchState] = []
    bridge.subscribe(TOPICS.latch_state, lambda message: states.append(decode_latch_state(message)))
    gazebo = FakeGazebo(hall(NEAR), bridge)
    gazebo.before_step = lambda: gazebo.robot.command(Velocity(0.2 * is_before_the_box(gazebo)))
    running = RunningGazebo(gazebo, rate=2.0)
    node = wherry("ros2", "gazebo-latch", settings_file(tmp_path, NEAR_SETTINGS), domain=DOMAIN)
    try:
        wait_until(lambda: bool(states) and not is_before_the_box(gazebo), 60.0)
        assert not states[-1].has_load
        assert gazebo.time >= 2.0
        command = LatchCommand(gazebo.time, close=True)

        def is_answered() -> bool:
            bridge.publish(TOPICS.latch_command, encode_latch_command(command))  # the node may subscribe late
            return states[-1].answers(command)

        wait_until(is_answered, 20.0)
        assert states[-1].has_load
        assert gazebo.attached == {0}
        node.send_signal(signal.SIGINT)
        assert node.wait(timeout=20.0) == 0
    finally:
        node.kill()
        node.communicate()
        running.stop()
