"""Groups of options: a command with dataclasses as parameters has their fields as options."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer
from typer.testing import CliRunner

from wherry.commands.option_groups import with_option_groups


@dataclass(frozen=True)
class Size:
    """A group with a required option and one with a default."""

    width: Annotated[int, typer.Option(help="Columns.")]
    height: Annotated[int, typer.Option("--rows", help="Rows.")] = 2


app = typer.Typer()


@app.command()
@with_option_groups
def draw(name: str, scale: int = 1, *, size: Size, quiet: bool = False) -> None:
    """Draw."""
    typer.echo(f"{name} {scale} {size} {quiet}")


def test_fields_of_a_group_become_options() -> None:
    done = CliRunner().invoke(app, ["hall", "--width", "3", "--quiet"])
    assert done.output == "hall 1 Size(width=3, height=2) True\n"
    done = CliRunner().invoke(app, ["hall", "--scale", "4", "--rows", "5", "--width", "3"])
    assert done.output == "hall 4 Size(width=3, height=5) False\n"


def test_a_required_field_is_a_required_option() -> None:
    done = CliRunner().invoke(app, ["hall"])
    assert done.exit_code == 2
    assert "--width" in done.output


def test_help_lists_options_in_the_order_of_parameters_and_fields() -> None:
    text = CliRunner().invoke(app, ["--help"]).output
    positions = [text.index(option) for option in ("--scale", "--width", "--rows", "--quiet")]
    assert positions == sorted(positions)
