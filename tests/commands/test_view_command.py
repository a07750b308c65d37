"""wherry view and wherry worlds: pages, printed worlds, and rejected input."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from wherry.cli import app
from wherry.errors import InputError
from wherry.floorplan.world_files import built_in_worlds, find_world, parse_world
from wherry.trace.recordings import TRACE_FILE_NAME, TraceRecorder
from wherry_testing.runs import short_run


def test_worlds_are_listed_with_their_sizes() -> None:
    result = CliRunner().invoke(app, ["worlds", "list"])
    assert result.exit_code == 0
    assert [line.split()[0] for line in result.output.splitlines()] == list(built_in_worlds())
    assert "17 × 17  cells   10.2 × 10.2 m  4 boxes" in result.output


@pytest.mark.parametrize("name", built_in_worlds())
def test_a_shown_world_can_be_parsed_again(name: str) -> None:
    result = CliRunner().invoke(app, ["worlds", "show", name])
    assert parse_world(result.output, name) == find_world(name)


def test_a_recording_is_written_as_a_page(tmp_path: Path) -> None:
    with TraceRecorder(tmp_path / TRACE_FILE_NAME) as recorder:
        for record in short_run():
            recorder(record)
    out = tmp_path / "page.html"
    result = CliRunner().invoke(app, ["view", str(tmp_path), "--out", str(out)])
    assert result.exit_code == 0
    assert out.read_text(encoding="utf-8").startswith("<!doctype html>")


@pytest.mark.parametrize("arguments", [["view"], ["worlds", "edit"]])
def test_commands_that_always_serve_a_page_have_no_view_option(arguments: list[str]) -> None:
    output = CliRunner().invoke(app, [*arguments, "--help"]).output
    assert "--host" in output
    assert "--view" not in output


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["view", "nowhere"], "No such file"),
        (["view", "{folder}"], "No such file"),
        (["view", "{folder}/text"], "no trace"),
        (["learn", "taxi", "--host", "::1"], "--host: ::1: needs --view"),
        (["learn", "taxi", "--port", "8000"], "--port: 8000: needs --view"),
        (["worlds", "show", "atlantis"], "neither a file nor one of the worlds"),
        (["worlds", "edit", "{folder}/text"], "is none of the fields"),
    ],
)
def test_invalid_arguments_are_reported(tmp_path: Path, arguments: list[str], words: str) -> None:
    (tmp_path / "text").write_text("hello: 1\n")
    result = CliRunner().invoke(app, [argument.format(folder=tmp_path) for argument in arguments])
    assert isinstance(result.exception, InputError)
    assert words in str(result.exception)
