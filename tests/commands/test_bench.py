"""wherry bench: tables, ratios, and external implementations."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from wherry.commands import bench as command
from wherry.experiments import bench
from wherry.experiments.bench import BENCHES, BenchResult, BenchSettings, Timing, TimingSource
from wherry.pipelines.grids.learning import LearningResult, LearningSettings, Repetition
from wherry_testing.command_line import RunCommand


def test_ratios_are_relative_to_wherrys_first_timing_of_the_same_task() -> None:
    rows = (
        Timing.own("a", 2.0),
        Timing.own("a", 4.0, "slow"),
        Timing.published("a", "x", 30.0),
        Timing("b", "x", 1.0),
    )
    result = BenchResult("mine", rows, "load 0.0 on 2 cores")
    assert [result.ratio(row) for row in rows] == [None, None, 15.0, None]


def test_timings_are_printed_as_table_and_json(run_command: RunCommand, monkeypatch: pytest.MonkeyPatch) -> None:
    def quick(settings: BenchSettings, progress: Callable[[str], None]) -> list[Timing]:
        progress("something")
        return [Timing.own("a step", 0.5), Timing.published("a step", "another", 100.0)]

    monkeypatch.setattr(bench, "BENCHES", {"learning": quick})
    status, out, err = run_command("bench", "learning", "--json")
    assert status == 0
    assert json.loads(out)["times"][1] == {
        "task": "a step",
        "who": "another",
        "ms": 100.0,
        "ratio": 200.0,
        "source": "published, on another machine",
    }
    assert "learning: medians, at a load" in err
    assert "another machine" in err


def test_a_localization_update_takes_less_than_20_ms(tmp_path: Path) -> None:
    own, *external = BENCHES["localization"](BenchSettings(tmp_path), lambda _: None)
    assert own.implementation == "wherry"
    assert 0.0 < own.milliseconds < 20.0
    assert external[-1].source is TimingSource.PUBLISHED


def test_pypi_amcl_is_timed_on_the_same_drive(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A fake amcl module records its updates; the real one is not a dependency."""
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
        AMCL=Filter,
        Vector3D=Vector,
        MotionParameters=dict,
        LaserParameters=dict,
        create_occupancy_grid_from_list=lambda *arguments: None,
        create_diagonal_covariance=lambda *arguments: None,
        create_laser_scan_from_list=lambda readings, range_max: readings,
    )
    monkeypatch.setitem(sys.modules, "amcl", module)
    monkeypatch.setattr(bench.importlib.util, "find_spec", lambda name: module)
    times = BENCHES["localization"](BenchSettings(tmp_path), lambda _: None)
    assert [row.implementation for row in times] == ["wherry", "PyPI amcl", "ROS 1 amcl"]
    assert len(updates) == bench.UPDATES
    assert {count for count, _ in updates} == {bench.BEAMS}
    assert updates[-1][1] - updates[0][1] == pytest.approx(bench.STEP * (bench.UPDATES - 1))


@pytest.fixture
def stubbed_learning(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace the learning experiment by one that takes no time."""

    class Experiment:
        def __init__(self, settings: LearningSettings) -> None:
            self.settings = settings

        def repetitions(self) -> list[Repetition]:
            return []

        def result(self) -> LearningResult:
            return LearningResult.of(self.settings, [Repetition(10, True, 0.002, ((10, 6),))])

    monkeypatch.setattr(bench, "LearningExperiment", Experiment)


@pytest.mark.usefixtures("stubbed_learning")
def test_efficient_rl_runs_in_its_own_environment(tmp_path: Path) -> None:
    """A fake interpreter records its arguments and prints a time per step."""
    interpreter = tmp_path / "python"
    interpreter.write_text(f'#!/bin/sh\necho "$1 $OMP_NUM_THREADS" >{tmp_path}/asked\necho 24.5\n')
    interpreter.chmod(0o755)
    times = BENCHES["learning"](BenchSettings(tmp_path, interpreter), lambda _: None)
    assert (tmp_path / "asked").read_text() == f"{bench.EFFICIENT_RL_SCRIPT} 1\n"
    assert bench.EFFICIENT_RL_SCRIPT.exists()
    small, large = (row for row in times if row.implementation == "DOORMAX, efficient_rl")
    assert small == Timing("a step of Taxi 5×5", "DOORMAX, efficient_rl", 24.5)
    assert large.source is TimingSource.PUBLISHED


@pytest.mark.usefixtures("stubbed_learning")
def test_without_efficient_rl_its_published_times_are_used(tmp_path: Path) -> None:
    times = BENCHES["learning"](BenchSettings(tmp_path), lambda _: None)
    small, large = (row for row in times if row.implementation == "DOORMAX, efficient_rl")
    assert small == Timing.published("a step of Taxi 5×5", "DOORMAX, efficient_rl", 27.45)
    assert large == Timing.published("a step of Taxi 10×10", "DOORMAX, efficient_rl", 320.6)


@pytest.mark.usefixtures("stubbed_learning")
def test_an_environment_without_efficient_rl_is_reported_in_one_line(run_command: RunCommand, tmp_path: Path) -> None:
    missing = run_command("bench", "learning", "--efficient-rl", tmp_path / "nothing", "--quiet")
    assert missing == (2, "", f"wherry: {tmp_path / 'nothing'}: efficient_rl: No such file or directory\n")
    status, _, err = run_command("bench", "learning", "--efficient-rl", sys.executable, "--quiet")
    assert status == 2
    assert err == f"wherry: {sys.executable}: efficient_rl: ModuleNotFoundError: No module named 'efficient_rl'\n"


def test_an_unknown_bench_is_rejected(run_command: RunCommand) -> None:
    line = "wherry: NAME: chess: is none of learning, slam, localization, planning\n"
    assert run_command("bench", "chess") == (2, "", line)
    assert tuple(BENCHES) == command.NAMES


def test_a_missing_log_is_reported_in_one_line(run_command: RunCommand, tmp_path: Path) -> None:
    advice = "set WHERRY_DATA or --data to the folder of recorded logs, and see docs/how-to/logs.md"
    line = f"is missing; {advice} for where public logs come from"
    log = tmp_path / "intel" / "intel_910_rawodom.clf.gz"
    assert run_command("bench", "slam", "--data", tmp_path, "--quiet") == (2, "", f"wherry: {log}: {line}\n")
