"""wherry bench: its tables, its ratios, and that optional competitors really run beside."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from wherry.commands import bench as command
from wherry.experiments import bench
from wherry.experiments.bench import BENCHES, ELSEWHERE, MEASURED, Bench, Outside, Time
from wherry.pipelines.grids.learning import LearningResult, LearningSettings, Repetition

Call = Callable[..., tuple[int, str, str]]


def test_ratios_are_to_our_first_time_for_the_same_task() -> None:
    rows = (
        Time("a", "wherry", 2.0),
        Time("a", "wherry, slow", 4.0),
        Time("a", "x", 30.0, ELSEWHERE),
        Time("b", "x", 1.0),
    )
    measured = Bench("mine", rows, "load 0.0 on 2 cores")
    assert [measured.ratio(row) for row in rows] == [None, None, 15.0, None]


def test_a_table_and_json(call: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    def quick(outside: Outside, progress: Callable[[str], None]) -> list[Time]:
        progress("something")
        return [Time("a step", "wherry", 0.5), Time("a step", "another", 100.0, ELSEWHERE)]

    monkeypatch.setattr(bench, "BENCHES", {"learning": quick})
    status, out, err = call("bench", "learning", "--json")
    assert status == 0
    assert json.loads(out)["times"][1] == {
        "task": "a step", "who": "another", "ms": 100.0, "ratio": 200.0, "source": ELSEWHERE
    }  # fmt: skip
    assert "learning: medians, at a load" in err
    assert "another machine" in err


def test_an_update_is_timed_and_quick(tmp_path: Path) -> None:
    first, *others = BENCHES["localization"](Outside(tmp_path), lambda _: None)
    assert first.who == "wherry"
    assert 0.0 < first.milliseconds < 20.0
    assert others[-1].source == ELSEWHERE


def test_the_amcl_of_the_index_gets_the_same_drive(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A stand-in with amcl's names notes what it is given; the real one is no dependency."""
    updates: list[tuple[int, float]] = []

    class Vector:
        def __init__(self, x: float, y: float, theta: float) -> None:
            self.x = x

    class Filter:
        def __init__(self, **options: object) -> None:
            assert options["max_particles"] == bench.PARTICLES

        def __getattr__(self, name: str) -> Callable[..., None]:
            return lambda *arguments: None

        def update(self, scan: list[list[float]], odometry: Vector) -> None:
            updates.append((len(scan), odometry.x))

    module = ModuleType("amcl")
    module.__dict__.update(
        AMCL=Filter, Vector3D=Vector, MotionParameters=dict, LaserParameters=dict,
        create_occupancy_grid_from_list=lambda *arguments: None, create_diagonal_covariance=lambda *arguments: None,
        create_laser_scan_from_list=lambda readings, range_max: readings,
    )  # fmt: skip
    monkeypatch.setitem(sys.modules, "amcl", module)
    monkeypatch.setattr(bench.importlib.util, "find_spec", lambda name: module)
    times = BENCHES["localization"](Outside(tmp_path), lambda _: None)
    assert [row.who for row in times] == ["wherry", "PyPI amcl", "ROS 1 amcl"]
    assert len(updates) == bench.UPDATES
    assert {count for count, _ in updates} == {bench.BEAMS}
    assert updates[-1][1] - updates[0][1] == pytest.approx(bench.STEP * (bench.UPDATES - 1))


@pytest.fixture
def stubbed_learning(monkeypatch: pytest.MonkeyPatch) -> None:
    """Our own learners take no time."""

    class Experiment:
        def __init__(self, settings: LearningSettings) -> None:
            self.settings = settings

        def repetitions(self) -> list[Repetition]:
            return []

        def result(self) -> LearningResult:
            return LearningResult.of(self.settings, [Repetition(10, True, 0.002, ((10, 6),))])

    monkeypatch.setattr(bench, "LearningExperiment", Experiment)


@pytest.mark.usefixtures("stubbed_learning")
def test_efficient_rl_runs_in_an_environment_of_its_own(tmp_path: Path) -> None:
    """A stand-in for the interpreter says what it is asked to run, and what a step took there."""
    interpreter = tmp_path / "python"
    interpreter.write_text(f'#!/bin/sh\necho "$1 $OMP_NUM_THREADS" >{tmp_path}/asked\necho 24.5\n')
    interpreter.chmod(0o755)
    times = BENCHES["learning"](Outside(tmp_path, interpreter), lambda _: None)
    assert (tmp_path / "asked").read_text() == f"{bench.EFFICIENT_RL} 1\n"
    assert bench.EFFICIENT_RL.exists()
    small, large = (row for row in times if row.who == "DOORMAX, efficient_rl")
    assert small == Time("a step of Taxi 5×5", "DOORMAX, efficient_rl", 24.5, MEASURED)
    assert large.source == ELSEWHERE


@pytest.mark.usefixtures("stubbed_learning")
def test_without_efficient_rl_its_published_times_stand(tmp_path: Path) -> None:
    times = BENCHES["learning"](Outside(tmp_path), lambda _: None)
    theirs = [row for row in times if row.who == "DOORMAX, efficient_rl"]
    assert [(row.milliseconds, row.source) for row in theirs] == [(27.45, ELSEWHERE), (320.6, ELSEWHERE)]


@pytest.mark.usefixtures("stubbed_learning")
def test_an_environment_without_efficient_rl_is_told_in_one_line(call: Call, tmp_path: Path) -> None:
    missing = call("bench", "learning", "--efficient-rl", tmp_path / "nothing", "--quiet")
    assert missing == (2, "", f"wherry: {tmp_path / 'nothing'}: efficient_rl: No such file or directory\n")
    status, _, err = call("bench", "learning", "--efficient-rl", sys.executable, "--quiet")
    assert status == 2
    assert err == f"wherry: {sys.executable}: efficient_rl: ModuleNotFoundError: No module named 'efficient_rl'\n"


def test_what_there_is_not_is_refused(call: Call) -> None:
    assert call("bench", "chess") == (
        2, "", "wherry: NAME: chess: is none of learning, slam, localization, planning\n"
    )  # fmt: skip
    assert tuple(BENCHES) == command.NAMES


def test_a_missing_log_is_told_in_one_line(call: Call, tmp_path: Path) -> None:
    status, _, err = call("bench", "slam", "--data", tmp_path, "--quiet")
    assert status == 2
    assert err.count("\n") == 1
