"""The command line: its commands, and what becomes of errors.

Exit status: 0 all went well, 1 the run ended without reaching its goal, 2 the input cannot be used, 130 stopped by
Ctrl-C.
"""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from wherry import __version__
from wherry.commands.deliver import deliver
from wherry.commands.learn import learn
from wherry.commands.localize import localize
from wherry.commands.map import map_log
from wherry.commands.reproduce import reproduce
from wherry.errors import InputError

BAD_INPUT = 2
STOPPED = 130

app = typer.Typer(
    name="wherry",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain help: importing what makes it colourful takes longer than all the rest
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Robots that find out by themselves how their world works, and then deliver.",
)
app.command()(deliver)
app.command("map")(map_log)
app.command()(localize)
app.command()(learn)
app.command()(reproduce)


def main() -> None:
    """Run a command; turn bad input into one line and exit status 2."""
    try:
        app()
    except InputError as error:
        print(f"wherry: {error}", file=sys.stderr)  # noqa: T201 - the one place that prints errors
        sys.exit(BAD_INPUT)
    except KeyboardInterrupt:
        print("wherry: stopped", file=sys.stderr)  # noqa: T201
        sys.exit(STOPPED)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"wherry {__version__}")
        raise typer.Exit


@app.callback()
def common(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    """Options of wherry itself."""
