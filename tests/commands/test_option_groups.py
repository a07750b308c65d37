"""Commands that take groups of options."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer
from typer.testing import CliRunner

from wherry.commands.option_groups import OutputOptions, with_option_groups


@dataclass(frozen=True)
class SpeedOptions:
    """Options of a drive."""

    speed: Annotated[float, typer.Option(help="m/s.")] = 1.5
    is_reverse: Annotated[bool, typer.Option("--reverse")] = False


def invoke(*arguments: str) -> str:
    app = typer.Typer()

    @app.command()
    @with_option_groups
    def drive(place: Annotated[str, typer.Argument()], speed: SpeedOptions, *, output: OutputOptions) -> None:
        """Drive somewhere."""
        typer.echo(f"{place} {speed} {output}")

    return CliRunner().invoke(app, arguments).output


def test_options_are_passed_in_their_groups() -> None:
    printed = invoke("dock", "--speed", "0.5", "--reverse", "--json")
    assert "dock SpeedOptions(speed=0.5, is_reverse=True) OutputOptions(as_json=True, quiet=False)" in printed


def test_options_have_the_defaults_of_their_groups() -> None:
    printed = invoke("dock")
    assert "dock SpeedOptions(speed=1.5, is_reverse=False) OutputOptions(as_json=False, quiet=False)" in printed


def test_help_lists_the_options_of_all_groups() -> None:
    printed = invoke("--help")
    assert "Drive somewhere." in printed
    assert all(option in printed for option in ("--speed", "--reverse", "--json", "--quiet"))


def test_unknown_options_are_rejected() -> None:
    assert "No such option" in invoke("dock", "--height", "2")
