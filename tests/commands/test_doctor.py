"""wherry doctor: checks, advice and exit status."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType

import pytest

from wherry.errors import InputError
from wherry.pipelines import installation
from wherry.pipelines.installation import CHECKS, CheckResult, failed_check
from wherry.ros.transports import ros1_messages
from wherry_testing.command_line import RunCommand


def replace_checks(monkeypatch: pytest.MonkeyPatch, checks: Mapping[str, Callable[[], CheckResult]]) -> None:
    monkeypatch.setattr(installation, "CHECKS", checks)


def test_every_check_is_printed(run_command: RunCommand) -> None:
    status, out, err = run_command("doctor", "--json")
    assert status == 0
    found = json.loads(out)
    assert list(found) == list(CHECKS)
    assert found["Python"]["works"]
    assert found["packages"]["works"]
    assert found["rendering"]["works"], found["rendering"]["detail"]
    for name in CHECKS:
        assert name in err


def test_a_broken_required_dependency_sets_the_exit_status(
    run_command: RunCommand, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken() -> CheckResult:
        raise OSError("gone")

    fine = CheckResult("fine", works=True, detail="1.0", advice="never printed")
    missing = CheckResult("extra", works=False, detail="not installed", advice="pip install extra")
    replace_checks(monkeypatch, {"fine": lambda: fine, "extra": lambda: missing})
    status, out, _ = run_command("doctor")
    assert status == 0
    assert "never printed" not in out
    assert "pip install extra" in out
    replace_checks(monkeypatch, {"packages": broken})
    status, out, _ = run_command("doctor")
    assert status == 1
    assert "Broken: packages" in out
    assert "OSError: gone" in out


def test_ros_1_is_found_where_rospy_can_be_imported(monkeypatch: pytest.MonkeyPatch) -> None:
    def not_installed(name: str) -> ModuleType:
        raise InputError("ROS 1", f"Python module {name}", "apt install it")

    monkeypatch.setattr(ros1_messages, "ros1_module", not_installed)
    assert CHECKS["ROS 1"]() == CheckResult("ROS 1", works=False, detail="not installed", advice="apt install it")
    monkeypatch.setattr(ros1_messages, "ros1_module", lambda name: json)
    assert CHECKS["ROS 1"]().detail == str(Path(json.__file__).parent)


def test_an_error_becomes_a_failed_check() -> None:
    assert failed_check("packages", ValueError("no")).is_required
    assert not failed_check("rendering", ValueError("no")).is_required


def test_missing_modules_programs_and_data_are_reported(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("WHERRY_DATA", str(tmp_path))
    assert not CHECKS["RViz"]().works
    assert not CHECKS["recorded logs"]().works
    assert not installation._check_module("nothing", "no_such.module", "none").works
    (tmp_path / "intel").mkdir()
    (tmp_path / "rviz2").touch(mode=0o755)
    assert CHECKS["RViz"]() == CheckResult(
        "RViz", works=True, detail=str(tmp_path / "rviz2"), advice=CHECKS["RViz"]().advice
    )
    assert CHECKS["recorded logs"]().works


def test_an_older_python_is_reported_as_broken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(installation, "MIN_PYTHON", (4, 0))
    assert not CHECKS["Python"]().works
