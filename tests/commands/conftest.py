"""A fixture that runs commands in this process and captures their output."""

from __future__ import annotations

import sys

import pytest

from wherry import cli
from wherry_testing.command_line import CommandResult, RunCommand


@pytest.fixture
def run_command(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> RunCommand:
    """A function that runs ``wherry`` with the given arguments, in an empty folder of its own."""
    monkeypatch.chdir(tmp_path_factory.mktemp("cwd"))

    def run(*arguments: object) -> CommandResult:
        monkeypatch.setattr(sys, "argv", ["wherry", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        out, err = capsys.readouterr()
        return CommandResult(int(stop.value.code or 0), out, err)

    return run
