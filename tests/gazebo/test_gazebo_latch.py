"""The latch in Gazebo, against a stand-in that speaks what Gazebo and its bridge speak, and over real DDS."""

from __future__ import annotations

import itertools
import signal
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.floorplan.plan import Cell
from wherry.floorplan.world_files import find_world
from wherry.gazebo.export import Settings as ExportSettings
from wherry.gazebo.export import export
from wherry.gazebo.latch import GazeboLatch, Site, close_topic, format_site, load_site, pose_topic, state_topic
from wherry.pipelines.delivery.simulator import Settings, prepare
from wherry.realization.mission import order_from_plan
from wherry.robot import Velocity
from wherry.ros import messages as ros
from wherry.ros.encoding import encode_header, encode_pose
from wherry.ros.names import Rates, load_names
from wherry.ros.nodes.latch import LatchCommand, LatchState, from_latch_state, to_latch_command
from wherry.ros.transports.ros2 import Ros2Transport
from wherry.simulation.simulator import LATCH_REACH
from wherry.space.pose import Pose
from wherry_testing.bus import Bus, free_domain
from wherry_testing.dds import ended, wait_until, wherry
from wherry_testing.gazebo import Gazebo
from wherry_testing.worlds import hall

TOPICS = load_names().topics
DOMAIN, WHOLE = free_domain(), free_domain()
NEAR = """\
wherry-world: 1
name: near

+---+---+---+---+
|     o         |
+   +   +   +   +
|     >   o   w |
+---+---+---+---+
"""
ON_THE_BOX, ON_THE_WAREHOUSE = Pose(1.5, 0.3), Pose(2.1, 0.3)
SITE = Site(2, LATCH_REACH, 0.6, frozenset({Cell(2, 1)}))
SITE_NEAR = Site(2, LATCH_REACH, 0.6, frozenset({Cell(3, 0)}))


class Stage:
    """Gazebo, the latch, and somebody who asks it, on one bus; time passes when a test wants."""

    def __init__(self, *, ready: bool = True) -> None:
        self.bus = Bus()
        self.gazebo = Gazebo(hall(NEAR), self.bus.node())
        self.latch = GazeboLatch(SITE_NEAR, self.bus.node(), replace(load_names(), rates=Rates(latch_state=1000.0)))
        self.numbers = itertools.count(1)
        if ready:
            self.pass_time(2.1)

    @property
    def states(self) -> list[LatchState]:
        return [from_latch_state(message) for message in self.bus.heard[TOPICS.latch_state.name]]

    def pass_time(self, seconds: float) -> None:
        end = self.gazebo.time + seconds
        while self.gazebo.time < end - 1e-9:
            self.gazebo.advance()
            self.latch.run(iter([False, True]).__next__)

    def place(self, robot: Pose) -> None:
        held = next(iter(self.gazebo.attached), None)
        self.gazebo.physics.place_robot(robot, held)
        self.pass_time(0.05)

    def ask(self, *, close: bool) -> LatchCommand:
        command = LatchCommand(float(next(self.numbers)), close)
        self.bus.say(TOPICS.latch_command, to_latch_command(command))
        return command

    def answer(self, *, close: bool) -> bool:
        """Ask, and return whether there is a load then."""
        command = self.ask(close=close)
        self.pass_time(0.1)
        assert self.states[-1].answers(command)
        return self.states[-1].loaded


@pytest.fixture
def stage() -> Stage:
    return Stage()


def test_joints_that_begin_closed_are_open_before_anything_is_told() -> None:
    stage = Stage(ready=False)
    assert stage.gazebo.attached == {0, 1}
    stage.pass_time(1.9)
    assert stage.gazebo.attached == set()
    assert not stage.states
    stage.ask(close=True)  # too early: the world would open the joint at once
    assert not stage.bus.heard[close_topic(0).name]
    stage.pass_time(0.2)
    assert not stage.states[-1].loaded
    assert stage.states[-1].answered == 0.0
    assert not stage.gazebo.taken_in


def test_a_joint_that_an_earlier_node_left_closed_is_opened() -> None:
    stage = Stage(ready=False)
    stage.gazebo.simulation._tick = 100  # 5 s
    stage.pass_time(0.1)
    assert stage.gazebo.attached == set()
    assert not stage.states[-1].loaded
    assert not stage.gazebo.taken_in


def test_the_latch_closes_around_the_box_in_the_fork_and_no_other(stage: Stage) -> None:
    stage.place(ON_THE_BOX)
    assert stage.answer(close=True)
    assert stage.gazebo.attached == {0}
    assert len(stage.bus.heard[close_topic(0).name]) == 1
    assert not stage.bus.heard[close_topic(1).name]


@pytest.mark.parametrize(("off", "loaded"), [(LATCH_REACH - 0.005, True), (LATCH_REACH + 0.005, False)])
def test_it_reaches_as_far_as_the_simulators(stage: Stage, off: float, loaded: bool) -> None:
    stage.place(Pose(ON_THE_BOX.x - off, ON_THE_BOX.y))
    assert stage.answer(close=True) is loaded


def test_the_load_is_let_go_over_the_warehouse_only_which_takes_it_in(stage: Stage) -> None:
    stage.place(ON_THE_BOX)
    assert stage.answer(close=True)
    assert stage.answer(close=False)
    assert stage.gazebo.attached == {0}
    stage.place(ON_THE_WAREHOUSE)
    assert not stage.answer(close=False)
    assert stage.gazebo.attached == set()
    assert stage.gazebo.taken_in == [0]
    assert not stage.answer(close=True)  # it is gone


def test_a_command_is_carried_out_once_and_answered_each_time(stage: Stage) -> None:
    stage.place(ON_THE_BOX)
    command = stage.ask(close=True)
    stage.pass_time(0.1)
    stage.bus.say(TOPICS.latch_command, to_latch_command(command))
    stage.pass_time(0.1)
    assert stage.states[-1].answers(command)
    assert len(stage.bus.heard[close_topic(0).name]) == 1


def test_nothing_is_answered_before_gazebo_has_done_it(stage: Stage) -> None:
    stage.place(ON_THE_BOX)
    command = stage.ask(close=True)
    assert not stage.states[-1].answers(command)
    stage.bus.say(TOPICS.latch_command, to_latch_command(command))  # asks again, and so does the node
    assert len(stage.bus.heard[close_topic(0).name]) == 2
    stage.pass_time(0.1)
    assert stage.states[-1] == LatchState(pytest.approx(stage.gazebo.time), True, command.number)
    assert stage.gazebo.attached == {0}


def test_closing_a_closed_latch_and_opening_an_open_one_is_answered_at_once(stage: Stage) -> None:
    assert not stage.answer(close=False)
    stage.place(ON_THE_BOX)
    assert stage.answer(close=True)
    assert stage.answer(close=True)


def test_a_load_that_somebody_else_lets_go_is_told_and_stays(stage: Stage) -> None:
    stage.place(ON_THE_BOX)
    assert stage.answer(close=True)
    stage.gazebo.work("detach", 0)
    assert not stage.states[-1].loaded
    assert not stage.gazebo.taken_in
    assert stage.answer(close=True)


def test_what_cannot_be_is_refused(stage: Stage) -> None:
    broken = ros.PoseStamped(encode_header(9.0, "world"), encode_pose(Pose(float("nan"))))
    stage.bus.say(pose_topic("wherry"), broken)
    stage.bus.say(state_topic(0), ros.String("perhaps"))
    stage.bus.say(TOPICS.latch_command, ros.JointState(name=("latch",), position=np.array([0.5])))
    refused = {"/model/wherry/pose": 1, "/latch/state/box_0": 1, "/latch/command": 1}
    assert stage.latch.refusals.counts == refused
    stage.place(ON_THE_BOX)
    assert stage.answer(close=True)


# ---- the file that an export brings along


def test_an_export_tells_the_latch_what_it_has_to_know(tmp_path: Path) -> None:
    export(ExportSettings("small", tmp_path, boxes=1))
    site, plan = load_site(tmp_path / "latch.yaml"), find_world("small")
    assert site == Site(1, LATCH_REACH, plan.cell_size, plan.warehouse)


def test_a_file_holds_what_was_written(tmp_path: Path) -> None:
    (tmp_path / "latch.yaml").write_text(format_site(SITE))
    assert load_site(tmp_path / "latch.yaml") == SITE
    assert SITE.allows_opening(Pose(1.21, 0.61))
    assert not SITE.allows_opening(Pose(1.19, 0.61))
    assert not SITE.allows_opening(Pose(-0.1, 0.61))


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        ("wherry-latch: 1", "wherry-latch: 2", "wherry-latch"),
        ("boxes: 2", "boxes: -1", "boxes"),
        ("boxes: 2", "boxes: true", "boxes"),
        ("boxes: 2", "", "boxes"),
        ("reach: 0.05", "reach: .nan", "reach"),
        ("cell_size: 0.6", "cell_size: 0", "cell_size"),
        ("warehouse:", "warehouse: 3\nhouse:", "warehouse"),
        ("- 1\n", "- 1.5\n", "warehouse"),
        ("boxes: 2", "boxes: [", ""),
    ],
)
def test_other_files_are_refused(tmp_path: Path, old: str, new: str, field: str) -> None:
    text = format_site(SITE)
    assert old in text
    (tmp_path / "latch.yaml").write_text(text.replace(old, new))
    with pytest.raises(InputError) as caught:
        load_site(tmp_path / "latch.yaml")
    assert caught.value.field == field
    assert "\n" not in str(caught.value)


# ---- over DDS, with the command itself as the node


class Running:
    """The stand-in in a thread, and its bridge on DDS."""

    def __init__(self, gazebo: Gazebo, rate: float) -> None:
        self.gazebo = gazebo
        self.over = threading.Event()
        self.thread = threading.Thread(target=gazebo.node(rate).run, args=(self.over.is_set,))
        self.thread.start()

    def stop(self) -> None:
        self.over.set()
        self.thread.join()


@pytest.fixture
def bridge(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Iterator[Ros2Transport]:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(WHOLE if "whole" in request.node.name else DOMAIN))
    with Ros2Transport() as transport:
        yield transport


def site_file(tmp_path: Path, site: Site) -> str:
    path = tmp_path / "latch.yaml"
    path.write_text(format_site(site))
    return str(path)


def is_before_the_box(gazebo: Gazebo) -> bool:
    return gazebo.physics.robot_pose.x < ON_THE_BOX.x - 0.02


def test_the_command_latches_a_box_over_dds(bridge: Ros2Transport, tmp_path: Path) -> None:
    """The robot stands before the box, drives over it, and asks."""
    states: list[LatchState] = []
    bridge.subscribe(TOPICS.latch_state, lambda message: states.append(from_latch_state(message)))
    gazebo = Gazebo(hall(NEAR), bridge)
    gazebo.before_step = lambda: gazebo.robot.command(Velocity(0.2 * is_before_the_box(gazebo)))
    running = Running(gazebo, rate=2.0)
    node = wherry("ros2", "gazebo-latch", site_file(tmp_path, SITE_NEAR), domain=DOMAIN)
    try:
        wait_until(lambda: bool(states) and not is_before_the_box(gazebo), 60.0)
        assert not states[-1].loaded
        assert gazebo.time >= 2.0
        command = LatchCommand(gazebo.time, close=True)

        def is_answered() -> bool:
            bridge.publish(TOPICS.latch_command, to_latch_command(command))  # again: the first ones may find nobody yet
            return states[-1].answers(command)

        wait_until(is_answered, 20.0)
        assert states[-1].loaded
        assert gazebo.attached == {0}
        node.send_signal(signal.SIGINT)
        assert node.wait(timeout=20.0) == 0
    finally:
        node.kill()
        node.communicate()
        running.stop()


@pytest.mark.slow
def test_a_whole_delivery_in_the_stand_in_over_dds(bridge: Ros2Transport, tmp_path: Path) -> None:
    """Agent and latch are two processes; Gazebo knows nothing of latches, nor the agent of Gazebo."""
    world = tmp_path / "world.txt"
    world.write_text(NEAR.replace(">   o   w", ">       w"))
    simulation = prepare(Settings(str(world)))
    plan = simulation.plan
    places = [option for x, y in order_from_plan(plan).warehouse for option in ("--warehouse", f"{x:.3f},{y:.3f}")]
    running = Running(Gazebo(simulation, bridge), rate=1.0)
    file = site_file(tmp_path, Site(len(plan.boxes), LATCH_REACH, plan.cell_size, plan.warehouse))
    processes: list[Any] = [wherry("ros2", "gazebo-latch", file, domain=WHOLE)]
    try:
        processes.append(wherry("ros2", "deliver", *places, "--json", "--wait", "60", domain=WHOLE))
        figures = ended(processes[-1], timeout=280.0)
    finally:
        for process in processes:
            process.kill()
            process.communicate()
        running.stop()
    assert (figures["delivered"], figures["remaining"]) == (len(plan.boxes), 0)
    assert running.gazebo.taken_in == [*range(len(plan.boxes))]
    assert running.gazebo.attached == set()
