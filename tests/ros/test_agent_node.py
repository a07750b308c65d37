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
from wherry.ros.nodes.agent import MOST_PARTICLES, TOLERANCE, AgentNode
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
    """What the node asks a robot."""

    def __init__(self) -> None:
        self.odometry = Odometry(5.0, Pose(1.0, 0.0, 0.5), Velocity())
        self.time = 5.0
        self.in_spare_time: Callable[[], None] = lambda: None

    def status(self) -> ros.DiagnosticStatus:
        return diagnostic_status("wherry: robot", OK, "well", {})


class Stage:
    def __init__(self, **options: bool) -> None:
        self.bus, self.robot = Bus(), Robot()
        self.node = AgentNode(self.robot, self.bus.node(), NAMES, **options)  # type: ignore[arg-type]
        self.node(RunStarted("deliver", "ROS", "Bayes", TERMS, ("N",), 0.2, 0.1))

    def see(self, record: RobotSnapshot) -> None:
        """As when the agent then waits for the robot."""
        self.node(record)
        self.robot.in_spare_time()

    def heard(self, name: str) -> list[Any]:
        return self.bus.heard[f"/{name}"]

    def markers(self, namespace: str) -> list[ros.Marker]:
        return [marker for marker in self.heard("markers")[-1].markers if marker.ns == namespace]


def seen(boxes: int = 0, *, loaded: bool = False, particles: int = 0) -> RobotSnapshot:
    places = np.arange(2 * boxes, dtype=np.float32).reshape(-1, 2)
    path = np.array([[0, 0], [1, 1]], np.float32)
    cloud = np.ones((particles, 3), np.float32)
    return RobotSnapshot(5.0, Pose(3.0, 4.0, 1.0), Pose(), np.empty((0, 2), np.float32), cloud, path, places, loaded)


@pytest.fixture
def stage() -> Stage:
    return Stage()


def test_the_map_is_told_if_it_is_ours(stage: Stage) -> None:
    grid = OccupancyGrid(np.eye(3, dtype=np.float32), 0.05)
    stage.node(MapUpdate(5.0, grid, 0.5, 1.0))
    np.testing.assert_array_equal(decode_occupancy_grid(stage.heard("map")[0], "map").occupied, grid.occupied)
    somebody_elses = Stage(owns_map=False)
    somebody_elses.node(MapUpdate(5.0, grid, 0.5, 1.0))
    assert somebody_elses.heard("map") == []


def test_paths_and_particles_are_told(stage: Stage) -> None:
    stage.see(seen(particles=2000))
    assert len(stage.heard("particlecloud")[0].poses) == MOST_PARTICLES
    assert decode_pose(stage.heard("predicted_path")[0].poses[1].pose).x == 1.0
    plan = np.array([[0.3, 0.3], [0.9, 0.3], [0.9, 0.9]], np.float32)
    stage.node(StepTaken(5.0, "101", "N", False, True, 0, 0, 1, plan))
    assert [decode_pose(pose.pose).x for pose in stage.heard("plan")[0].poses] == pytest.approx([0.3, 0.9, 0.9])


def test_what_is_seen_is_drawn_in_spare_time_and_only_the_last_of_it(stage: Stage) -> None:
    """After the velocity that came of it; the transform does not wait."""
    stage.node(seen(particles=3))
    stage.node(seen(particles=4))
    assert not stage.heard("particlecloud")
    stage.robot.in_spare_time()
    stage.robot.in_spare_time()
    assert [len(cloud.poses) for cloud in stage.heard("particlecloud")] == [4]


def test_an_agent_that_has_no_time_to_spare_draws_once_a_second_and_at_the_end(stage: Stage) -> None:
    with stage.node:
        for tenth in range(25):
            stage.node(replace(seen(), time=5.0 + tenth / 10))
    drawn = [decode_stamp(path.header.stamp) for path in stage.heard("predicted_path")]
    assert drawn == pytest.approx([6.0, 7.0, 7.4])


def test_boxes_come_and_go(stage: Stage) -> None:
    stage.see(seen(boxes=3))
    assert [marker.action for marker in stage.markers("boxes")] == [ros.Marker.ADD] * 3
    assert stage.markers("boxes")[1].scale == ros.Vector3(0.2, 0.2, 0.3)
    stage.see(seen(boxes=1, loaded=True))
    first, load, gone = stage.markers("boxes")
    assert (first.id, load.id, gone.id) == (0, 1, 2)
    assert load.pose.position == ros.Point(3.0, 4.0, 0.15)
    assert gone.action == ros.Marker.DELETE


def test_the_condition_is_shown_term_by_term(stage: Stage) -> None:
    stage.see(seen())
    assert stage.heard("markers") == []
    stage.node(PerceivedState(5.0, "101", ()))
    stage.see(seen())
    text, bits = stage.markers("condition")
    assert text.text.split("\n") == ["101", "touch_N", "on_box"]
    assert len(bits.points) == len(bits.colors) == 3
    assert bits.colors[0] == bits.colors[2] != bits.colors[1]


def test_warehouse_and_walls_are_where_the_cells_are(stage: Stage) -> None:
    frame = CellFrame(Pose(1.0, 2.0, 0.0), 0.6)
    walls = np.array([[0, 0, 1], [0, 0, 0]], np.int32)
    stage.node(CellLayout(5.0, frame, np.array([[2, 1]], np.int32), walls))
    (tile,) = stage.markers("warehouse")
    assert (tile.pose.position.x, tile.pose.position.y) == pytest.approx((2.5, 2.9))
    (lines,) = stage.markers("cells")
    ends = [(point.x, point.y) for point in lines.points]
    np.testing.assert_allclose(ends, [(1.0, 2.6), (1.6, 2.6), (1.6, 2.0), (1.6, 2.6)])


def test_the_heartbeat_keeps_the_transform_young_and_tells_each_instant_once(stage: Stage) -> None:
    stage.see(seen())
    with stage.node:
        wait_for(lambda: len(stage.heard("tf")) == 1)
        time.sleep(0.2)
        assert len(stage.heard("tf")) == 1  # the robot's time stands still
        stage.robot.time = 5.1
        wait_for(lambda: len(stage.heard("tf")) == 2)
    links = [link for message in stage.heard("tf") for link in transforms_between(message, "map", "odom")]
    assert [link.time for link in links] == pytest.approx([5.0 + TOLERANCE, 5.1 + TOLERANCE])
    there = links[0].pose @ stage.robot.odometry.pose
    assert (there.x, there.y, there.theta) == pytest.approx((3.0, 4.0, 1.0))


def test_somebody_elses_transform_is_left_to_them() -> None:
    stage = Stage(owns_pose=False)
    stage.see(seen())
    with stage.node:
        time.sleep(0.15)
    assert stage.heard("tf") == []


def test_what_was_drawn_once_is_drawn_again_for_those_who_come_later(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stage.node, "_diagnostics_period", 0.05)
    stage.node(CellLayout(5.0, CellFrame(Pose(), 0.6), np.array([[2, 1]], np.int32), np.empty((0, 3), np.int32)))
    with stage.node:
        wait_for(lambda: len(stage.heard("markers")) >= 3)
    assert len(stage.markers("warehouse")) == 1


def test_what_is_said_is_a_diagnosis(stage: Stage) -> None:
    stage.node(Narration(5.0, Phase.EXPLORE, "I drive on."))
    agent, robot = stage.heard("diagnostics")[0].status
    assert (agent.name, agent.message, agent.level) == ("wherry: agent", "I drive on.", OK)
    assert robot.name == "wherry: robot"
