"""Recordings for the Rerun viewer, read with the command `rerun rrd print`."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.space.frame import CellFrame
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry.trace.records import (
    CellLayout,
    LearntModel,
    LearntRule,
    MapUpdate,
    Narration,
    PerceivedState,
    Phase,
    Record,
    RobotSnapshot,
    RunStarted,
    StepTaken,
)
from wherry.views.rerun_recording import rerun_recording

NO_POINTS = np.empty((0, 2), np.float32)
RECORDS: tuple[Record, ...] = (
    RunStarted("deliver", "small", "bayes", ("touch_N(robot, wall)", "box.in_bot"), ("N",), 0.2, 0.1),
    Narration(0.0, Phase.EXPLORE, "I know nothing."),
    MapUpdate(0.5, OccupancyGrid(np.array([[0.1, 0.9], [0.5, 0.1]], np.float32), 0.05, Pose(1.0, 2.0, 0.1)), 0.7, 1.0),
    CellLayout(1.0, CellFrame(Pose(0.0, 0.0, 0.1), 0.6), np.array([[0, 1]], np.int32), np.empty((0, 3), np.int32)),
    *(
        RobotSnapshot(
            time=1.0 + 0.5 * number,
            pose=Pose(1.0, 2.0, 0.3),
            lidar=Pose(0.9, 2.0, 0.3),
            points=np.ones((5, 2), np.float32),
            particles=np.ones((3, 3), np.float32),
            path=np.array([[0.0, 0.0], [1.0, 1.0]], np.float32),
            boxes=np.array([[2.0, 2.0]], np.float32),
            has_load=number == 2,
        )
        for number in range(3)
    ),
    PerceivedState(2.5, "01", ()),
    StepTaken(2.5, "01", "N", True, True, 7, 1, 2, NO_POINTS),
    LearntModel(2.5, (LearntRule("N", "0*", "robot.y += 1"),), (("N", ("1*",)),)),
)


def rows(path: Path) -> dict[str, int]:
    """Number of rows of each entity in a recording."""
    command = [sys.executable, "-m", "rerun", "rrd", "print", str(path)]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    found: dict[str, int] = {}
    for count, entity in re.findall(r"with (\d+) rows .*? - (/\S+)", printed):
        found[entity] = found.get(entity, 0) + int(count)
    return found


def test_every_record_type_is_in_the_recording(tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    with rerun_recording(path) as sink:
        for record in RECORDS:
            sink(record)
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.rrd"]
    found = rows(path)
    assert found["/map/scan"] == found["/map/particles"] == found["/map/path"] == found["/map/robot"] == 3
    for entity in ("grid", "warehouse", "plan", "robot/body", "boxes", "robot/load"):
        assert found[f"/map/{entity}"] >= 1
    for entity in ("/log", "/rules", "/terms/box.in_bot", "/counts/unknown", "/counts/delivered", "/counts/mapped"):
        assert found[entity] == 1


def test_an_interrupted_run_keeps_its_recording(tmp_path: Path) -> None:
    recording = rerun_recording(tmp_path / "run.rrd")
    recording.__enter__()(RECORDS[1])
    assert not recording.__exit__(KeyboardInterrupt, KeyboardInterrupt(), None)
    assert rows(tmp_path / "run.rrd")["/log"] == 1


def test_a_missing_folder_is_reported(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written"), rerun_recording(tmp_path / "no" / "run.rrd"):
        pass


def test_a_missing_rerun_sdk_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(InputError, match=r"wherry\[rerun\]"), rerun_recording(tmp_path / "run.rrd"):
        pass
    assert not list(tmp_path.iterdir())
