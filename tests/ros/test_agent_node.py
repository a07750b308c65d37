from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from wherry.robot import Odometry, Velocity
from wherry.ros import messages as ros
from wherry.ros.decoding import decode_occupancy_grid, decode_pose, decode_stamp, transforms_between
from wherry.ros.diagnostics import OK, diagnostic_status
from wherry.ros.names import load_names
from wherry.ros.nodes.agent import MAX_PARTICLES, TRANSFORM_TOLERANCE, AgentNode
from wherry.space.frame import CellFrame
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry.trace.records import (
    CellLayout,
    MapUpdate,
    Narration,
    PerceivedState,
    Phase,
    RobotSnapshot,
    RunStarted,
    StepTaken,
)
from wherry_testing.bus import Bus, wait_for

NAMES = load_names()
TERMS = ("touch_N", "touch_S", "on_box")


class Robot:
    """The part of `RosRobot` that the node uses."""

    def __init__(self) -> None:
        self.odometry = Odometry(5.0, Pose(1.0, 0.0, 0.5), Velocity())
        self.time = 5.0
        self.idle_callback: Callable[[], None] = lambda: None

    def status(self) -> ros.DiagnosticStatus:
        return diagnostic_status("wherry: robot", OK, "connected", {})


class Stage:
    def __init__(self, **options: bool) -> None:
        self.bus, self.robot = Bus(), Robot()
        self.node = AgentNode(self.robot, self.bus.node(), NAMES, **options)  # type: ignore[arg-type]
        self.node(RunStarted("deliver", "ROS", "Bayes", TERMS, ("N",), 0.2, 0.1))

    def observe(self, record: RobotSnapshot) -> None:
        """Publish a snapshot and wait for the robot."""
        self.node(record)
        self.robot.idle_callback()

    def published(self, name: str) -> list[Any]:
        return self.bus.heard[f"/{name}"]

    def markers(self, namespace: str) -> list[ros.Marker]:
        return [marker for marker in self.published("markers")[-1].markers if marker.ns == namespace]


def snapshot(boxes: int = 0, *, loaded: bool = False, particles: int = 0) -> RobotSnapshot:
    places = np.arange(2 * boxes, dtype=np.float32).reshape(-1, 2)
    path = np.array([[0, 0], [1, 1]], np.float32)
    cloud = np.ones((particles, 3), np.float32)
    return RobotSnapshot(5.0, Pose(3.0, 4.0, 1.0), Pose(), np.empty((0, 2), np.float32), cloud, path, places, loaded)


@pytest.fixture
def stage() -> Stage:
    return Stage()


def test_own_map_is_published_and_external_map_is_not(stage: Stage) -> None:
    grid = OccupancyGrid(np.eye(3, dtype=np.float32), 0.05)
    stage.node(MapUpdate(5.0, grid, 0.5, 1.0))
    np.testing.assert_array_equal(decode_occupancy_grid(stage.published("map")[0], "map").occupied, grid.occupied)
    external = Stage(publishes_map=False)
    external.node(MapUpdate(5.0, grid, 0.5, 1.0))
    assert external.published("map") == []


def test_paths_and_particles_are_published(stage: Stage) -> None:
    stage.observe(snapshot(particles=2000))
    assert len(stage.published("particlecloud")[0].poses) == MAX_PARTICLES
    assert decode_pose(stage.published("predicted_path")[0].poses[1].pose).x == 1.0
    plan = np.array([[0.3, 0.3], [0.9, 0.3], [0.9, 0.9]], np.float32)
    stage.node(StepTaken(5.0, "101", "N", False, True, 0, 0, 1, plan))
    assert [decode_pose(pose.pose).x for pose in stage.published("plan")[0].poses] == pytest.approx([0.3, 0.9, 0.9])


def test_latest_snapshot_is_published_when_idle(stage: Stage) -> None:
    stage.node(snapshot(particles=3))
    stage.node(snapshot(particles=4))
    assert not stage.published("particlecloud")
    stage.robot.idle_callback()
    stage.robot.idle_callback()
    assert [len(cloud.poses) for cloud in stage.published("particlecloud")] == [4]


def test_agent_that_is_never_idle_publishes_once_a_second_and_at_the_end(stage: Stage) -> None:
    with stage.node:
        for tenth in range(25):
            stage.node(replace(snapshot(), time=5.0 + tenth / 10))
    drawn = [decode_stamp(path.header.stamp) for path in stage.published("predicted_path")]
    assert drawn == pytest.approx([6.0, 7.0, 7.4])


def test_markers_of_removed_boxes_are_deleted(stage: Stage) -> None:
    stage.observe(snapshot(boxes=3))
    assert [marker.action for marker in stage.markers("boxes")] == [ros.Marker.ADD] * 3
    assert stage.markers("boxes")[1].scale == ros.Vector3(0.2, 0.2, 0.3)
    stage.observe(snapshot(boxes=1, loaded=True))
    first, load, gone = stage.markers("boxes")
    assert (first.id, load.id, gone.id) == (0, 1, 2)
    assert load.pose.position == ros.Point(3.0, 4.0, 0.15)
    assert gone.action == ros.Marker.DELETE


def test_condition_is_shown_as_true_terms_and_bits(stage: Stage) -> None:
    stage.observe(snapshot())
    assert stage.published("markers") == []
    stage.node(PerceivedState(5.0, "101", ()))
    stage.observe(snapshot())
    text, bits = stage.markers("condition")
    assert text.text.split("\n") == ["101", "touch_N", "on_box"]
    assert len(bits.points) == len(bits.colors) == 3
    assert bits.colors[0] == bits.colors[2] != bits.colors[1]


def test_warehouse_and_walls_are_placed_by_the_cell_frame(stage: Stage) -> None:
    frame = CellFrame(Pose(1.0, 2.0, 0.0), 0.6)
    walls = np.array([[0, 0, 1], [0, 0, 0]], np.int32)
    stage.node(CellLayout(5.0, frame, np.array([[2, 1]], np.int32), walls))
    (tile,) = stage.markers("warehouse")
    assert (tile.pose.position.x, tile.pose.position.y) == pytest.approx((2.5, 2.9))
    (lines,) = stage.markers("cells")
    ends = [(point.x, point.y) for point in lines.points]
    np.testing.assert_allclose(ends, [(1.0, 2.6), (1.6, 2.6), (1.6, 2.0), (1.6, 2.6)])


def test_heartbeat_publishes_the_transform_once_for_each_time(stage: Stage) -> None:
    stage.observe(snapshot())
    with stage.node:
        wait_for(lambda: len(stage.published("tf")) == 1)
        time.sleep(0.2)
        assert len(stage.published("tf")) == 1  # the robot's time stands still
        stage.robot.time = 5.1
        wait_for(lambda: len(stage.published("tf")) == 2)
    links = [link for message in stage.published("tf") for link in transforms_between(message, "map", "odom")]
    assert [link.time for link in links] == pytest.approx([5.0 + TRANSFORM_TOLERANCE, 5.1 + TRANSFORM_TOLERANCE])
    there = links[0].pose @ stage.robot.odometry.pose
    assert (there.x, there.y, there.theta) == pytest.approx((3.0, 4.0, 1.0))


def test_transform_of_an_external_localization_is_not_published() -> None:
    stage = Stage(publishes_pose=False)
    stage.observe(snapshot())
    with stage.node:
        time.sleep(0.15)
    assert stage.published("tf") == []


def test_lasting_markers_are_repeated_for_late_subscribers(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stage.node, "_diagnostics_period", 0.05)
    stage.node(CellLayout(5.0, CellFrame(Pose(), 0.6), np.array([[2, 1]], np.int32), np.empty((0, 3), np.int32)))
    with stage.node:
        wait_for(lambda: len(stage.published("markers")) >= 3)
    assert len(stage.markers("warehouse")) == 1


def test_narration_is_published_as_diagnostics(stage: Stage) -> None:
    stage.node(Narration(5.0, Phase.EXPLORE, "I drive on."))
    agent, robot = stage.published("diagnostics")[0].status
    assert (agent.name, agent.message, agent.level) == ("wherry: agent", "I drive on.", OK)
    assert robot.name == "wherry: robot"
