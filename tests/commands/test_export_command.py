"""wherry export: the files for Gazebo."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.testing import assert_allclose
from typer.testing import CliRunner

from wherry.cli import app
from wherry.floorplan.generation import place_boxes
from wherry.floorplan.world_files import find_world
from wherry.pipelines.delivery.ros import parse_order
from wherry.realization.mission import order_from_plan
from wherry.simulation import build


def test_the_world_equals_that_of_deliver_with_the_same_seed(tmp_path: Path) -> None:
    folder = tmp_path / "a" / "b"
    result = CliRunner().invoke(
        app, ["export", "gazebo", "rooms", str(folder), "--boxes", "3", "--seed", "4", "--json"]
    )
    assert result.exit_code == 0
    names = json.loads(result.stdout.splitlines()[-1])["files"]
    assert sorted(names) == sorted(path.name for path in folder.iterdir())
    box_rng, physics_rng, _ = np.random.default_rng(4).spawn(3)
    simulation = build(place_boxes(find_world("rooms"), 3, box_rng), physics_rng)
    world = ElementTree.fromstring((folder / "world.sdf").read_text())  # noqa: S314 - just written
    for index in range(3):
        pose = [float(word) for word in world.findtext(f"world/model[@name='box_{index}']/pose", "").split()]
        assert_allclose(pose[:2], simulation.physics.box_positions[index, :2], atol=1e-9)
    line = result.stderr.splitlines()[-1]
    assert line.startswith("The agent: wherry ros2 deliver --warehouse ")
    order = parse_order(line.replace("--warehouse", "").split()[5:], simulation.plan.cell_size)
    assert_allclose(order.warehouse, order_from_plan(simulation.plan).warehouse, atol=1e-5)
    compile((folder / "gazebo.launch.py").read_text(), "gazebo.launch.py", "exec")
    ElementTree.fromstring((folder / "classic.launch").read_text())  # noqa: S314 - just written
