"""Usage errors, help, shell completion and output to pipes."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from wherry.cli import app
from wherry.commands.common import console_for, name_completion, say
from wherry_testing.command_line import RunCommand


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["deliver", "--boxes", "x"], "wherry: --boxes: must be a valid integer\n"),
        (["deliver", "--bixes", "3"], "wherry: --bixes: no such option (Possible options: --boxes"),
        (["learn", "taxi", "--seed", "-1"], "wherry: --seed: must be greater than or equal to 0\n"),
        (["learn", "taxi", "--size"], "wherry: --size: option '--size' requires an argument\n"),
        (["learn"], "wherry: DOMAIN: is missing\n"),
        (["deliver", "boxes"], "wherry: got unexpected extra argument(s) (boxes)\n"),
        (["dliver"], "wherry: no such command 'dliver'"),
        (["--nope"], "wherry: --nope: no such option\n"),
    ],
)
def test_wrong_usage_is_reported_in_one_line(run_command: RunCommand, arguments: list[str], line: str) -> None:
    status, out, err = run_command(*arguments)
    assert (status, out) == (2, "")
    assert err.startswith(line)
    assert err.count("\n") == 1


@pytest.mark.parametrize("group", [(), ("worlds",), ("export",), ("ros1",), ("ros2",)])
def test_help_is_printed_without_a_command(run_command: RunCommand, group: tuple[str, ...]) -> None:
    status, out, err = run_command(*group)
    assert (status, err) == (0, "")
    assert out.startswith(f"Usage: {' '.join(('wherry', *group))} [OPTIONS] COMMAND")


def test_shells_complete_commands_and_values() -> None:
    def completions(line: str) -> list[str]:
        words = {"_WHERRY_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(len(line.split(" ")) - 1)}
        done = subprocess.run(
            [sys.executable, "-m", "wherry"], env=os.environ | words, capture_output=True, text=True, check=False
        )
        return done.stdout.split()

    assert completions("wherry le") == ["learn"]
    assert completions("wherry learn ta") == ["taxi"]


def test_completions_start_with_the_typed_text() -> None:
    assert name_completion(("bayes", "doormax", "doormax-letter"))("door") == ["doormax", "doormax-letter"]


def test_pipes_get_no_colours_and_quiet_prints_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    console_for(as_json=False).print("[bold red]loud[/]")
    console_for(as_json=False, quiet=True).print("said")
    console_for(as_json=True).print("[bold]for people[/]")
    assert capsys.readouterr() == ("loud\n", "for people\n")


def test_a_path_is_printed_unwrapped_and_unchanged(capsys: pytest.CaptureFixture[str]) -> None:
    path = f"runs/[bold]{'x' * 100} 17"
    say(console_for(as_json=False), f"Written: {path}")
    assert capsys.readouterr().out == f"Written: {path}\n"


def commands_of(command: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """The words of every command and group, depth first."""
    yield path
    for name, child in getattr(command, "commands", {}).items():
        yield from commands_of(child, (*path, name))


COMMANDS = list(commands_of(typer.main.get_command(app)))


def test_commands_of_every_group_are_found() -> None:
    assert {("learn",), ("worlds", "list"), ("ros1", "deliver"), ("ros2", "gazebo-latch")} <= set(COMMANDS)


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_every_command_has_help(words: tuple[str, ...]) -> None:
    done = CliRunner().invoke(app, [*words, "--help"], prog_name="wherry")
    assert done.exit_code == 0
    assert done.output.startswith(f"Usage: {' '.join(('wherry', *words))} [OPTIONS]")
