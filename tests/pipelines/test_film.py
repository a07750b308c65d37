"""Films of simulated runs."""

from __future__ import annotations

import sys
from pathlib import Path

import av
import numpy as np
import pytest

from wherry.errors import InputError
from wherry.floorplan.world_files import find_world
from wherry.pipelines.delivery.film import FRAME_PERIOD, HEIGHT, WIDTH, film_recording
from wherry.robot import Velocity
from wherry.simulation import Simulation, build
from wherry.space.pose import Pose
from wherry.trace.records import Narration, Phase, RobotSnapshot

NO_POINTS = np.empty((0, 2), np.float32)


@pytest.fixture
def simulation() -> Simulation:
    return build(find_world("small").with_boxes(()), np.random.default_rng(0))


def snapshot_at(time: float) -> RobotSnapshot:
    return RobotSnapshot(time, Pose(), Pose(), NO_POINTS, np.empty((0, 3), np.float32), NO_POINTS, NO_POINTS, False)


def test_frames_follow_the_robots_clock(simulation: Simulation, tmp_path: Path) -> None:
    path = tmp_path / "run.mp4"
    with film_recording(path, simulation) as sink:
        sink(snapshot_at(0.0))
        for _ in range(40):
            simulation.robot.command(Velocity(0.5, 0.0))
            simulation.robot.receive()
        sink(Narration(0.5, Phase.EXPLORE, "Narration is not filmed."))
        sink(snapshot_at(FRAME_PERIOD + 0.01))
        sink(snapshot_at(FRAME_PERIOD + 0.02))  # too soon for another frame
        sink(snapshot_at(10 * FRAME_PERIOD + 0.01))
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.mp4"]
    with av.open(path) as container:
        frames = [frame.to_ndarray(format="rgb24").astype(float) for frame in container.decode(video=0)]
    assert len(frames) == 11
    assert frames[0].shape == (HEIGHT, 2 * WIDTH, 3)
    overhead = [frame[:, WIDTH:] for frame in frames]
    assert np.abs(overhead[0] - overhead[1]).max() > 50  # the robot has moved
    assert np.abs(overhead[3] - overhead[2]).max() < 30  # and stays where the last snapshot showed it


@pytest.mark.parametrize(("name", "problem"), [("run.avi", "must end in .mp4"), ("no/run.mp4", "cannot be written")])
def test_an_unusable_path_is_rejected(simulation: Simulation, tmp_path: Path, name: str, problem: str) -> None:
    with pytest.raises(InputError, match=problem), film_recording(tmp_path / name, simulation):
        pass


def test_a_missing_encoder_is_reported(simulation: Simulation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(InputError, match=r"wherry\[video\]"), film_recording(tmp_path / "run.mp4", simulation):
        pass
