"""The command line: one-line errors, JSON output, exit status and start-up time."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from wherry.floorplan.world_files import find_world, format_world
from wherry_testing.command_line import RunCommand

COMMAND = [sys.executable, "-m", "wherry"]
SMALL = format_world(find_world("small"))
HEAVY = ("matplotlib", "numba", "mujoco", "gymnasium", "pydantic", "scipy", "numpy", "rich", "starlette", "jinja2")


INVALID_WORLDS = {
    "no warehouse": ([("w", " "), ("w", " ")], "has no warehouse"),
    "no robot": ([(">", " ")], "has no robot"),
    "a robot in an obstacle": ([(">  ", "#>#")], "inside an obstacle"),
    "a robot in a wall": ([("+---", "+->-")], "inside a wall"),
    "two boxes in a cell": ([(">  ", ">oo")], "a box"),
    "a box under the robot": ([(">  ", ">o ")], "where the robot starts"),
    "a word for a number": ([("boxes: 2", "boxes: two")], "boxes: must be a whole number"),
    "a negative count": ([("boxes: 2", "boxes: -2")], "boxes"),
    "an unknown field": ([("boxes: 2", "crates: 2")], "line "),
    "another version": ([("wherry-world: 1", "wherry-world: 9")], "wherry-world"),
    "a hole in the outer wall": ([("+---", "+   ")], "line "),
}


@pytest.mark.parametrize("case", INVALID_WORLDS)
def test_an_invalid_world_is_rejected_in_one_line(case: str, run_command: RunCommand, tmp_path: Path) -> None:
    changes, reason = INVALID_WORLDS[case]
    fields, drawing = SMALL.split("\n\n")
    for old, new in changes:
        if old in drawing:
            drawing = drawing.replace(old, new, 1)
        else:
            assert old in fields, old
            fields = fields.replace(old, new, 1)
    file = tmp_path / "world.txt"
    file.write_text(f"{fields}\n\n{drawing}", encoding="utf-8")
    status, out, err = run_command("deliver", "--world", file, "--out", tmp_path / "out")
    assert (status, out) == (2, "")
    assert err.startswith(f"wherry: {file}: ")
    assert err.count("\n") == 1
    assert reason in err
    assert not (tmp_path / "out").exists()


INVALID_FILES = {
    "--map": {
        "no yaml": ("map.yaml", b"\x00{[", "map.yaml"),
        "no mapping": ("map.yaml", b"- 1\n", "mapping"),
        "no resolution": ("map.yaml", b"image: a.pgm\norigin: [0, 0, 0]\n", "resolution"),
        "no image": ("map.yaml", b"image: gone.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n", "gone.pgm"),
        "too large": ("map.yaml", b"#" * 70_000, "larger than"),
    },
    "--rules": {
        "no json": ("rules.json", b"{", "rules.json"),
        "a list": ("rules.json", b"[]", "rules.json"),
        "an empty object": ("rules.json", b"{}", "rules.json"),
        "invalid UTF-8": ("rules.json", b"\xff\xfe", "UTF-8"),
        "too large": ("rules.json", b" " * 20_000_001, "larger than"),
    },
}


@pytest.mark.parametrize(
    ("option", "case"), [(option, case) for option, cases in INVALID_FILES.items() for case in cases]
)
def test_an_invalid_file_is_rejected_in_one_line(
    option: str, case: str, run_command: RunCommand, tmp_path: Path
) -> None:
    name, content, reason = INVALID_FILES[option][case]
    file = tmp_path / name
    file.write_bytes(content)
    status, out, err = run_command("deliver", "--world", "small", option, file, "--out", tmp_path / "out")
    assert (status, out) == (2, "")
    assert err.startswith("wherry: ")
    assert str(tmp_path) in err
    assert reason in err
    assert err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_map_without_walls_is_rejected(run_command: RunCommand, tmp_path: Path) -> None:
    (tmp_path / "map.pgm").write_bytes(b"P5\n10 10\n255\n" + bytes([254]) * 100)
    (tmp_path / "map.yaml").write_text("image: map.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n", encoding="utf-8")
    status, _, err = run_command("deliver", "--world", "small", "--map", tmp_path / "map.yaml")
    assert (status, err) == (2, f"wherry: {tmp_path / 'map.yaml'}: image: shows no walls\n")


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--boxes", "-1"], "--boxes: -1 is negative"),
        (["--boxes", "500"], "there is room for"),
        (["--world", "nowhere"], "nowhere: is neither a file nor one of the worlds"),
        (["--learner", "magic"], "--learner: magic: is none of"),
        (["--map", "gone.yaml"], "gone.yaml: No such file"),
        (["--rules", "gone.json"], "gone.json: No such file"),
    ],
)
def test_an_invalid_option_is_rejected_in_one_line(
    arguments: list[str],
    reason: str,
    run_command: RunCommand,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    monkeypatch.chdir(tmp_path)
    status, out, err = run_command("deliver", *arguments)
    assert (status, out) == (2, "")
    assert reason in err
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_an_unwritable_folder_is_rejected(run_command: RunCommand, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    status, _, err = run_command("deliver", "--world", "small", "--out", tmp_path / "file" / "out")
    assert status == 2
    assert err == f"wherry: {tmp_path / 'file' / 'out'}: cannot be created: Not a directory\n"


def run_process(*arguments: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run the command in a process of its own."""
    return subprocess.run(
        [*COMMAND, *map(str, arguments)], cwd=cwd, capture_output=True, text=True, timeout=120, check=False
    )


def test_the_installed_command_reports_one_line_and_exits_with_2(tmp_path: Path) -> None:
    done = run_process("deliver", "--world", "nowhere", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("wherry: nowhere: is neither a file")
    assert done.stderr.count("\n") == 1


def test_json_is_the_only_standard_output(tmp_path: Path) -> None:
    done = run_process("deliver", "--world", "taxi", "--boxes", "0", "--json", "--out", "out", cwd=tmp_path)
    assert done.returncode == 0
    result = json.loads(done.stdout)
    assert done.stdout.count("\n") == 1
    documented_keys = (
        "delivered boxes collisions learning_steps actions path_ratio localization_rmse_m map_error_m sim_seconds "
        "wall_seconds real_time_factor seed world"
    )
    assert set(documented_keys.split()) <= set(result)
    assert (result["world"], result["delivered"]) == ("taxi", 0)
    assert (tmp_path / "out" / "report.html").exists()


def test_ctrl_c_exits_with_130_and_saves_the_rules(tmp_path: Path) -> None:
    with subprocess.Popen(
        [*COMMAND, "deliver", "--world", "small", "--out", "out"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    ) as process:
        assert process.stdout is not None
        process.stdout.readline()  # the first narration
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=120)
    assert process.returncode == 130
    assert (tmp_path / "out" / "rules.json").exists()


def test_help_imports_no_heavy_package() -> None:
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "wherry", "--help"], capture_output=True, text=True, check=True
    )
    imported = {line.split("|")[-1].strip().partition(".")[0] for line in done.stderr.splitlines()}
    assert "typer" in imported
    assert imported.isdisjoint(HEAVY)


def test_help_takes_less_than_half_a_second() -> None:
    def cpu_time() -> float:
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        return usage.ru_utime + usage.ru_stime

    times = []  # CPU times, which depend less on the load than the wall clock; minimum of three
    for _ in range(3):
        before = cpu_time()
        subprocess.run([*COMMAND, "--help"], capture_output=True, check=True)
        times.append(cpu_time() - before)
    assert min(times) < 0.5


@pytest.mark.parametrize("arguments", [["--help"], ["-h"], ["deliver", "--help"]])
def test_help_is_printed(arguments: list[str], run_command: RunCommand) -> None:
    status, out, err = run_command(*arguments)
    assert (status, err) == (0, "")
    assert "deliver" in out


def test_the_version_is_printed(run_command: RunCommand) -> None:
    status, out, _ = run_command("--version")
    assert status == 0
    assert out.startswith("wherry ")
