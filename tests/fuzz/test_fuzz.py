"""Damaged files are refused in one line or read as something possible, and the fuzzer finds loaders that do neither."""

from __future__ import annotations

import multiprocessing
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

import wherry
from fuzz.faulty_loaders import FAULTY_LOADERS
from fuzz.loader import Loader
from fuzz.loaders import LOADERS
from fuzz.runner import fuzz, write_valid_files
from fuzz.worker import Case, Verdict, loader_named, try_loading

FILES = 8_000
MAX_SECONDS = 500.0  # for all files, on a busy machine
AVAILABLE = [loader for loader in LOADERS if loader.is_available]
SOURCES = Path(wherry.__file__).parent

# Modules that read files, with the loaders that fuzz them, or the reason why none does.
READERS = {
    "documents.py": "names",
    "evaluation.py": "relations",
    "experiments/localization/foreign_maps.py": "maps of the recorded data, copied and then read by load_map",
    "experiments/results.py": "docs/results.md, our own file",
    "files.py": "names",
    "floorplan/world_files.py": "world",
    "gazebo/export.py": "the marker of our own export, of which only a key is looked up",
    "gazebo/latch_settings.py": "latch",
    "learning/rule_files/files.py": "rules-doormax",
    "localization/parameter_files.py": "amcl-nav2",
    "mapping/saved_graph.py": "pose-graph",
    "ros/body_files.py": "body",
    "ros/names.py": "names",
    "space/map_files.py": "map-scale",
    "space/wean_map.py": "wean-map",
    "trace/recordings.py": "trace",
    "views/web/editor.py": "world",
}
READING = re.compile(r"\b(read_text|read_bytes|read_yaml|load_yaml|load_json|read_rows|np\.load|gzip\.open)\(")
LOGS_AND_BAGS = ("logs/", "ros/bags/")  # whose readers are fuzzed as a whole


@pytest.mark.slow
def test_damaged_files_are_refused_or_read_as_something_possible() -> None:
    rows = fuzz(write_valid_files(AVAILABLE), FILES, workers=2, max_seconds=MAX_SECONDS)
    failures = [f"{case.loader} {case.number}: {found.reason}" for row in rows.values() for case, found in row.failures]
    assert not failures, "\n".join(failures)
    for name, row in rows.items():
        assert row.refused > 0, name
        assert row.accepted > 0, name


@pytest.mark.parametrize("loader", AVAILABLE, ids=lambda loader: loader.name)
def test_the_undamaged_files_are_accepted(loader: Loader, tmp_path: Path) -> None:
    outcome = try_loading(loader, loader.write(tmp_path))
    assert outcome.verdict is Verdict.ACCEPTED, outcome.reason


def test_every_module_that_reads_files_is_fuzzed() -> None:
    found = set()
    for path in SOURCES.rglob("*.py"):
        code = re.sub(r"resources\.files\([^)]*\)[^\n]*", "", path.read_text(encoding="utf-8"))
        name = str(path.relative_to(SOURCES))
        if READING.search(code) and not name.startswith(LOGS_AND_BAGS) and "templates" not in name:
            found.add(name)
    assert found == set(READERS)


EXPECTED = {
    "raises": "KeyError: 'file.txt' (faulty_loaders.py",
    "hangs": "hung for 3 s",
    "dies": "its process ended with -9",
    "hoards": "MemoryError",
    "accepts": "nonsense accepted, violated: probabilities",
}


@pytest.mark.slow
def test_faulty_loaders_are_found() -> None:
    faulty = [loader for loader in FAULTY_LOADERS if loader.name in {*EXPECTED, "refuses"}]
    rows = fuzz(write_valid_files(faulty), 2 * len(faulty), workers=2, max_wait=3.0)
    assert {name: row.files for name, row in rows.items()} == {loader.name: 2 for loader in faulty}
    assert (rows["refuses"].refused, rows["refuses"].failures) == (2, [])
    for name, expected in EXPECTED.items():
        assert [expected in outcome.reason for _, outcome in rows[name].failures] == [True, True], rows[name]
    assert multiprocessing.active_children() == []


def test_a_case_damages_the_files_in_the_same_way_every_time() -> None:
    valid = write_valid_files([loader_named("map-scale")])["map-scale"]
    first, again = ([Case("map-scale", 3, number).files(valid.files) for number in range(200)] for _ in range(2))
    assert first == again
    assert all(files != valid.files for files in first[:20])
    assert first != [Case("map-scale", 4, number).files(valid.files) for number in range(200)]


@pytest.mark.slow
def test_a_failing_file_is_saved_with_the_command_that_loads_it_again(tmp_path: Path) -> None:
    finished = _run("--loader", "raises", "--files", "1", "--workers", "1", "--out", str(tmp_path))
    assert finished.returncode == 1
    (command,) = re.findall(r"\./wherry fuzz (--repeat \S+)", finished.stdout)
    again = _run(*command.split())
    assert "failed: KeyError: 'file.txt'" in again.stdout
    assert again.returncode == 1


def _run(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command."""
    program = [sys.executable, "-m", "fuzz", *arguments]
    return subprocess.run(program, env=_environment(), capture_output=True, text=True, check=False, timeout=120)


def _environment() -> dict[str, str]:
    """The environment in which the command and this test's wherry are found."""
    paths = [str(Path(__file__).parents[1]), str(SOURCES.parent)]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_a_killed_run_leaves_no_processes(number: signal.Signals, tmp_path: Path) -> None:
    program = [sys.executable, "-m", "fuzz", "--loader", "hangs", "--workers", "2", "--files", "10", "--out", tmp_path]
    process = subprocess.Popen(program, env=_environment(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        workers = _wait_for(lambda: _workers(process.pid) if len(_workers(process.pid)) == 2 else [])
        process.send_signal(number)
        process.wait(60.0)
        _wait_for(lambda: [1] if not any(Path(f"/proc/{worker}/exe").exists() for worker in workers) else [])
    finally:
        process.kill()
        process.wait(60.0)


def _workers(parent: int) -> list[int]:
    """Running worker processes of a run."""
    children = Path(f"/proc/{parent}/task/{parent}/children").read_text().split()
    return [int(child) for child in children if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()]


def _wait_for(condition: Callable[[], list[int]]) -> list[int]:
    """What a condition returns as soon as that is not empty."""
    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline:
        if found := condition():
            return found
        time.sleep(0.05)
    pytest.fail("nothing happened within a minute")
