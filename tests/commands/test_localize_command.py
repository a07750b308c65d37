"""wherry localize: table, JSON, and the warning about a start pose outside the free space."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from wherry.space.map_files import save_map
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry_testing.command_line import RunCommand

OFF_THE_MAP = "The map has no free space at the start pose of the log; --global searches the whole map.\n"


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """Six scans of a robot that stands still in the middle of a room of 4 by 4 m."""
    angles = np.radians(np.arange(180) - 90.0)
    ranges = 2.0 / np.maximum(np.abs(np.cos(angles)), np.abs(np.sin(angles)))
    beams = " ".join(f"{distance:.3f}" for distance in ranges)
    lines = [f"FLASER 180 {beams} 0 0 0 0 0 0 {time:.1f} here {time:.1f}" for time in np.arange(6) / 2]
    path = tmp_path / "walk.clf"
    path.write_text("\n".join(lines) + "\n")
    return path


def map_at(folder: Path, x: float) -> Path:
    """The map file of the room, with its centre at (x, 0)."""
    probability = np.full((82, 82), 0.02, np.float32)
    probability[[0, -1]] = probability[:, [0, -1]] = 0.98
    return save_map(OccupancyGrid(probability, 0.05, Pose(x - 2.05, -2.05)), folder / "map.yaml")


def test_the_table_has_labels_and_json_has_field_names(run_command: RunCommand, log: Path, tmp_path: Path) -> None:
    status, out, err = run_command("localize", log, "--map", map_at(tmp_path, 0.0), "--json")
    assert status == 0
    metrics = json.loads(out)
    assert metrics["scans"] == 6
    assert metrics["rmse_m"] is None
    x, y, _ = metrics["final_pose"]
    assert f"x {x:.2f} m, y {y:.2f} m, heading " in err
    assert "Not measured: position error to the reference.\n" in err
    assert "final_pose" not in err
    assert OFF_THE_MAP not in err


def test_a_start_off_the_map_is_reported(run_command: RunCommand, log: Path, tmp_path: Path) -> None:
    status, out, _ = run_command("localize", log, "--map", map_at(tmp_path, 30.0))
    assert status == 0
    assert OFF_THE_MAP in out
