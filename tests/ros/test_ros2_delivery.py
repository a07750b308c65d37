"""The whole delivery over DDS alone: the agent and the simulator are two processes that share nothing else."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wherry.pipelines.delivery.simulator import Settings, prepare
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
RATE = 1.0  # × real time; the faster, the more a loaded machine's pauses hurt
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


class Audience:
    """RViz, as it were: what the agent says."""

    def __init__(self, transport: Ros2Transport) -> None:
        self.heard: dict[str, list[Any]] = {}
        for topic in (
            TOPICS.map,
            TOPICS.particlecloud,
            TOPICS.plan,
            TOPICS.predicted_path,
            TOPICS.markers,
            TOPICS.diagnostics,
            TOPICS.tf,
        ):
            transport.subscribe(topic, self.heard.setdefault(topic.name, []).append)

    def markers(self, namespace: str) -> list[ros.Marker]:
        return [marker for array in self.heard["/markers"] for marker in array.markers if marker.ns == namespace]


@pytest.fixture
def audience(monkeypatch: pytest.MonkeyPatch) -> Iterator[Audience]:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(DOMAIN))
    with Ros2Transport() as transport:
        yield Audience(transport)


def test_two_boxes_are_delivered_over_dds_alone(audience: Audience, tmp_path: Path) -> None:
    world = tmp_path / "world.txt"
    world.write_text(WORLD)
    plan = prepare(Settings(str(world))).plan
    places = [option for x, y in order_from_plan(plan).warehouse for option in ("--warehouse", f"{x:.3f},{y:.3f}")]
    with simulator(world, DOMAIN, "--rate", str(RATE), "--duration", "900") as robot:
        agent = wherry("ros2", "deliver", *places, "--json", "--out", str(tmp_path), domain=DOMAIN)
        try:
            figures = ended(agent, timeout=600.0)
        finally:
            agent.kill()
        verdict = ended(robot, signal.SIGINT)
    assert agent.returncode == 0
    assert (figures["delivered"], figures["remaining"]) == (2, 0)
    assert (verdict["delivered"], verdict["boxes"], verdict["collisions"]) == (2, 2, 0)
    assert (tmp_path / "rules.json").exists()
    _check_what_was_said(audience, load_map(tmp_path / "map.yaml").shape)


def _check_what_was_said(audience: Audience, shape: tuple[int, int]) -> None:
    grid = decode_occupancy_grid(audience.heard["/map"][-1], "map")
    assert grid.shape == shape
    assert 0.0 < grid.occupied.mean() < 0.5
    cloud = next(message for message in reversed(audience.heard["/particlecloud"]) if message.poses)
    assert cloud.header.frame_id == "map"
    assert any(len(path.poses) > 1 for path in audience.heard["/predicted_path"])
    assert any(len(path.poses) > 1 for path in audience.heard["/plan"])
    shown = {marker.id for marker in audience.markers("boxes") if marker.action == ros.Marker.ADD}
    assert {0, 1} <= shown  # and what looked like a box for a while
    assert audience.markers("boxes")[-1].action == ros.Marker.DELETE
    assert len({marker.id for marker in audience.markers("warehouse")}) == 1
    conditions = {marker.text.partition("\n")[0] for marker in audience.markers("condition")}
    assert any(condition.endswith("11") for condition in conditions)  # over the warehouse, with a box
    links = [link for message in audience.heard["/tf"] for link in transforms_between(message, "map", "odom")]
    stamps = np.array([link.time for link in links])
    assert (np.diff(stamps) > 0).all()
    assert np.quantile(np.diff(stamps), 0.99) < 1.0
    said = {status.name for message in audience.heard["/diagnostics"] for status in message.status}
    assert said == {"wherry: agent", "wherry: robot", "wherry: simulator"}
