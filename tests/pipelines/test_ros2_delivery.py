"""A whole delivery over DDS: the agent and the simulator are two processes that share nothing else."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wherry.pipelines.delivery.simulator import SimulatorSettings, build_simulation
from wherry.realization.mission import order_from_plan
from wherry.ros import messages as ros
from wherry.ros.decoding import decode_occupancy_grid, transforms_between
from wherry.ros.names import load_names
from wherry.ros.transports.ros2 import Ros2Transport
from wherry.space.map_files import load_map
from wherry_testing.bus import free_domain
from wherry_testing.dds import ended, simulator, wherry

pytestmark = [pytest.mark.slow, pytest.mark.realtime]

TOPICS = load_names().topics
DOMAIN = free_domain()
RATE = 1.0  # simulated seconds per second; at higher rates a loaded machine loses scans
WORLD = """\
wherry-world: 1
name: tiny

+---+---+---+---+---+---+
| >             |       |
+   +   +   +   +   +   +
|         o           w |
+   +   +   +   +   +   +
|     o                 |
+---+---+---+---+---+---+
"""


class Subscriber:
    """A stand-in for RViz: collects what the agent publishes."""

    def __init__(self, transport: Ros2Transport) -> None:
        self.messages: dict[str, list[Any]] = {}
        for topic in (
            TOPICS.map,
            TOPICS.particlecloud,
            TOPICS.plan,
            TOPICS.predicted_path,
            TOPICS.markers,
            TOPICS.diagnostics,
            TOPICS.tf,
        ):
            transport.subscribe(topic, self.messages.setdefault(topic.name, []).append)

    def markers(self, namespace: str) -> list[ros.Marker]:
        return [marker for array in self.messages["/markers"] for marker in array.markers if marker.ns == namespace]


@pytest.fixture
def subscriber(monkeypatch: pytest.MonkeyPatch) -> Iterator[Subscriber]:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(DOMAIN))
    with Ros2Transport() as transport:
        yield Subscriber(transport)


def test_two_boxes_are_delivered_over_dds(subscriber: Subscriber, tmp_path: Path) -> None:
    world = tmp_path / "world.txt"
    world.write_text(WORLD)
    plan = build_simulation(SimulatorSettings(str(world))).plan
    cells = [option for x, y in order_from_plan(plan).warehouse for option in ("--warehouse", f"{x:.3f},{y:.3f}")]
    with simulator(world, DOMAIN, "--rate", str(RATE), "--duration", "900") as robot:
        agent = wherry("ros2", "deliver", *cells, "--json", "--out", str(tmp_path), domain=DOMAIN)
        try:
            summary = ended(agent, timeout=600.0)
        finally:
            agent.kill()
        result = ended(robot, signal.SIGINT)
    assert agent.returncode == 0
    assert (summary["delivered"], summary["remaining"]) == (2, 0)
    assert (result["delivered"], result["boxes"], result["collisions"]) == (2, 2, 0)
    assert (tmp_path / "rules.json").exists()
    _check_publications(subscriber, load_map(tmp_path / "map.yaml").shape)


def _check_publications(subscriber: Subscriber, shape: tuple[int, int]) -> None:
    grid = decode_occupancy_grid(subscriber.messages["/map"][-1], "map")
    assert grid.shape == shape
    assert 0.0 < grid.occupied.mean() < 0.5
    cloud = next(message for message in reversed(subscriber.messages["/particlecloud"]) if message.poses)
    assert cloud.header.frame_id == "map"
    assert any(len(path.poses) > 1 for path in subscriber.messages["/predicted_path"])
    assert any(len(path.poses) > 1 for path in subscriber.messages["/plan"])
    shown = {marker.id for marker in subscriber.markers("boxes") if marker.action == ros.Marker.ADD}
    assert {0, 1} <= shown  # false detections may have other numbers
    assert subscriber.markers("boxes")[-1].action == ros.Marker.DELETE
    assert len({marker.id for marker in subscriber.markers("warehouse")}) == 1
    conditions = {marker.text.partition("\n")[0] for marker in subscriber.markers("condition")}
    assert any(condition.endswith("11") for condition in conditions)  # over the warehouse, with a box
    links = [link for message in subscriber.messages["/tf"] for link in transforms_between(message, "map", "odom")]
    stamps = np.array([link.time for link in links])
    assert (np.diff(stamps) > 0).all()
    assert np.quantile(np.diff(stamps), 0.99) < 1.0
    names = {status.name for message in subscriber.messages["/diagnostics"] for status in message.status}
    assert names == {"wherry: agent", "wherry: robot", "wherry: simulator"}
