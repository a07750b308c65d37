"""A whole delivery over DDS with a stand-in for Gazebo Sim."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from wherry.gazebo.latch_settings import GazeboLatchSettings
from wherry.pipelines.delivery.simulator import SimulatorSettings, build_simulation
from wherry.realization.mission import order_from_plan
from wherry.ros.transports.ros2 import Ros2Transport
from wherry.simulation.simulator import LATCH_REACH
from wherry_testing.bus import free_domain
from wherry_testing.dds import ended, wherry
from wherry_testing.gazebo import NEAR, FakeGazebo, RunningGazebo, settings_file

DOMAIN = free_domain()
WORLD = NEAR.replace(">   o", ">    ")  # without the box in front of the robot


@pytest.fixture
def bridge(monkeypatch: pytest.MonkeyPatch) -> Iterator[Ros2Transport]:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(DOMAIN))
    with Ros2Transport() as transport:
        yield transport


@pytest.mark.slow
def test_delivery_with_the_stand_in_over_dds(bridge: Ros2Transport, tmp_path: Path) -> None:
    """Agent and latch are two processes beside the stand-in."""
    world = tmp_path / "world.txt"
    world.write_text(WORLD)
    simulation = build_simulation(SimulatorSettings(str(world)))
    plan = simulation.plan
    cells = [option for x, y in order_from_plan(plan).warehouse for option in ("--warehouse", f"{x:.3f},{y:.3f}")]
    running = RunningGazebo(FakeGazebo(simulation, bridge), rate=1.0)
    file = settings_file(tmp_path, GazeboLatchSettings(len(plan.boxes), LATCH_REACH, plan.cell_size, plan.warehouse))
    processes: list[Any] = [wherry("ros2", "gazebo-latch", file, domain=DOMAIN)]
    try:
        processes.append(wherry("ros2", "deliver", *cells, "--json", "--wait", "60", domain=DOMAIN))
        summary = ended(processes[-1], timeout=280.0)
    finally:
        for process in processes:
            process.kill()
            process.communicate()
        running.stop()
    assert (summary["delivered"], summary["remaining"]) == (len(plan.boxes), 0)
    assert running.gazebo.removed == [*range(len(plan.boxes))]
    assert running.gazebo.attached == set()
